//! Names of states, inputs and outputs as names of columns.

use super::{Finding, value};
use crate::PlantSpec;
use crate::registry::Variables;

/// The tables of a run have a state's truth, its reference and its initial value beside it, and an
/// output's reference, in columns named by these endings.
const ENDINGS: [&str; 3] = ["_truth", "_ref", "_0"];

/// Columns of their own in these tables.
const TAKEN: [&str; 3] = ["t", "mark", "scenario"];

/// Checks that no variable has the name of another's column.
pub(super) fn column_names(plant: &PlantSpec, variables: &Variables) -> Finding {
    let own = variables.own_outputs().into_iter();
    let lists = [("states", &variables.states), ("inputs", &variables.inputs)];
    let listed = lists.into_iter().flat_map(|(list, all)| {
        all.iter().enumerate().map(move |(i, v)| (format!("{list}[{i}]"), v.name.as_ref()))
    });
    let outputs = own.map(|(_, v)| (format!("outputs.{}", v.name), v.name.as_ref()));
    let stems: Vec<&str> =
        variables.states.iter().chain(&variables.outputs).map(|v| v.name.as_ref()).collect();
    for (place, name) in listed.chain(outputs) {
        let belongs_to = ENDINGS.iter().find_map(|ending| {
            let stem = name.strip_suffix(ending)?;
            stems.contains(&stem).then_some(stem)
        });
        let expected = match belongs_to {
            Some(stem) => {
                format!("another name: that of a column that belongs to {stem} in tables of runs")
            }
            None if TAKEN.contains(&name) => {
                "another name: that of a column of the tables of runs".to_owned()
            }
            None => continue,
        };
        let key = match plant {
            PlantSpec::Expression(_) => format!("plant.expression.{place}"),
            _ => "plant".to_owned(),
        };
        return value(&key, format!("{name:?}"), &expected);
    }
    Ok(())
}
