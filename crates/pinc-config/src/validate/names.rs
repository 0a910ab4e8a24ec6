//! Names of states, inputs and outputs as names of columns; names of parameters.

use super::Checked;
use super::values::{parameters, value};
use crate::registry::Variables;
use crate::{DataSpec, Experiment, PlantSpec};
use pinc_net::Domain;
use pinc_toml::nearest;

/// The tables of a run have a state's truth, reference, initial value, standard deviation, error and
/// bound beside it, and an output's reference, in columns named by these endings.
const ENDINGS: [&str; 6] = ["_truth", "_ref", "_0", "_sd", "_err", "_bound"];

/// How the columns of what is measured begin, and those of disturbances.
const MEASURED: [&str; 2] = ["y_", "innovation_"];
const DISTURBANCE: &str = "d_";

/// Columns of their own in these tables.
const TAKEN: [&str; 7] = ["t", "mark", "scenario", "nis", "nees", "rejected", "error"];

/// Checks that names and units have no control characters, which files of runs and exports cannot have.
pub(super) fn printable(place: &str, plant: &PlantSpec) -> Checked {
    let variables = plant.variables();
    let lists = [
        ("states", &variables.states),
        ("inputs", &variables.inputs),
        ("outputs", &variables.outputs),
    ];
    for (list, all) in lists {
        for (i, variable) in all.iter().enumerate() {
            for (field, text) in [("name", &variable.name), ("unit", &variable.unit)] {
                if !text.contains(char::is_control) {
                    continue;
                }
                let key = match (plant, list) {
                    (PlantSpec::Expression(_), "outputs") => {
                        format!("{place}.expression.outputs.{}", variable.name)
                    }
                    (PlantSpec::Expression(_), _) => {
                        format!("{place}.expression.{list}[{i}].{field}")
                    }
                    _ => place.to_owned(),
                };
                let found = format!("the {field} {text:?}");
                return value(&key, found, "a text without control characters");
            }
        }
    }
    Ok(())
}

/// Checks that no variable has the name of another's column.
pub(super) fn column_names(plant: &PlantSpec, variables: &Variables) -> Checked {
    let own = variables.own_outputs().into_iter();
    let lists = [("states", &variables.states), ("inputs", &variables.inputs)];
    let listed = lists.into_iter().flat_map(|(list, all)| {
        all.iter().enumerate().map(move |(i, v)| (format!("{list}[{i}]"), v.name.as_ref()))
    });
    let outputs = own.map(|(_, v)| (format!("outputs.{}", v.name), v.name.as_ref()));
    let columns = columns(variables);
    for (place, name) in listed.chain(outputs) {
        let belongs_to = columns.iter().find(|(column, _)| column == name).map(|(_, of)| of);
        let expected = match belongs_to {
            Some(stem) => {
                format!("another name: this one is a column of {stem} in tables of runs")
            }
            None if TAKEN.contains(&name) => {
                "another name: this one is a column of the tables of runs".to_owned()
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

/// The columns of variables, each with the name of the variable.
fn columns(variables: &Variables) -> Vec<(String, &str)> {
    let Variables { states, inputs, outputs } = variables;
    let named = || states.iter().chain(outputs);
    let ended = named().flat_map(|v| ENDINGS.map(|ending| (v, ending)));
    let ended = ended.map(|(v, ending)| (format!("{}{ending}", v.name), v.name.as_ref()));
    let measured = named().flat_map(|v| MEASURED.map(|start| (start, v)));
    let begun = measured.chain(named().chain(inputs).map(|v| (DISTURBANCE, v)));
    ended.chain(begun.map(|(start, v)| (format!("{start}{}", v.name), v.name.as_ref()))).collect()
}

/// Checks the parameters that are trained with the net.
pub(super) fn unknown_parameters(experiment: &Experiment, data: &DataSpec) -> Checked {
    if !experiment.varying().is_empty() {
        let expected = "no such key with [domain.parameters]: files do not say of which plant";
        return value("data.files", format!("{:?}", data.files), expected);
    }
    parameters(|i| format!("data.parameters[{i}]"), &data.parameters, experiment)?;
    let expected = "no such key with data.parameters: the last net is kept";
    match data.parameters.is_empty() || data.held_out.is_empty() {
        true => Ok(()),
        false => value("data.held_out", format!("{:?}", data.held_out), expected),
    }
}

/// Checks that the parameters that vary in [domain] and [validation] are ones of the plant.
pub(super) fn varying_parameters(experiment: &Experiment) -> Checked {
    let names = |domain: &Domain| -> Vec<String> {
        domain.parameters.iter().map(|range| range.name.clone()).collect()
    };
    let own = experiment.control.iter().flat_map(|control| control.parameters.keys());
    for name in own {
        if !experiment.varying().contains(&name.as_str()) {
            let key = format!("control.parameters.{name}");
            let found = "a parameter that the models do not take";
            return value(&key, found, "one of [domain.parameters]");
        }
    }
    let Some(domain) = &experiment.domain else { return Ok(()) };
    let known = experiment.plant.parameter_names();
    let varying = names(domain);
    if let Some(unknown) = varying.iter().find(|name| !known.contains(name)) {
        let key = format!("domain.parameters.{unknown}");
        let nearest = nearest(unknown, &known);
        let found = "a parameter that the plant does not have";
        let expected = match (nearest, &known[..]) {
            (Some(nearest), _) => format!("one of its parameters: did you mean `{nearest}`?"),
            (None, []) => "no such key: the plant has no parameters that could vary".to_owned(),
            (None, known) => format!("one of {}", known.join(", ")),
        };
        return value(&key, found, &expected);
    }
    if let Some(validation) = &experiment.validation
        && names(&validation.domain) != varying
    {
        let found = format!("{:?}", names(&validation.domain));
        let expected = format!("the parameters of [domain], {varying:?}, or no such key");
        return value("validation.domain.parameters", found, &expected);
    }
    Ok(())
}
