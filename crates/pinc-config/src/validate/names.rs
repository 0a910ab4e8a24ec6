//! Names of states and inputs as names of columns.

use super::{Finding, value};
use crate::PlantSpec;
use crate::registry::Variables;

/// The tables of a run have a state's truth, its reference and its initial value beside it, in
/// columns named by these endings.
const ENDINGS: [&str; 3] = ["_truth", "_ref", "_0"];

/// Columns of their own in these tables.
const TAKEN: [&str; 3] = ["t", "mark", "scenario"];

/// Checks that no variable has the name of another's column.
pub(super) fn column_names(plant: &PlantSpec, variables: &Variables) -> Finding {
    let lists = [("states", &variables.states), ("inputs", &variables.inputs)];
    for (list, i, name) in lists.into_iter().flat_map(|(list, all)| {
        all.iter().enumerate().map(move |(i, v)| (list, i, v.name.as_ref()))
    }) {
        let belongs_to_state = ENDINGS.iter().find_map(|ending| {
            let state = name.strip_suffix(ending)?;
            variables.states.iter().any(|v| v.name == state).then_some(state)
        });
        let expected = match belongs_to_state {
            Some(state) => {
                format!("another name: that of a column that belongs to {state} in tables of runs")
            }
            None if TAKEN.contains(&name) => {
                "another name: that of a column of the tables of runs".to_owned()
            }
            None => continue,
        };
        let key = match plant {
            PlantSpec::Expression(_) => format!("plant.expression.{list}[{i}]"),
            _ => "plant".to_owned(),
        };
        return value(&key, format!("{name:?}"), &expected);
    }
    Ok(())
}
