//! Checks of plants without equations, and of what is done with them.

use super::Checked;
use super::values::{positive, value};
use crate::black_box::{FmuSpec, ProcessSpec};
use crate::plants::Plants;
use crate::{Experiment, ModelKind};
use pinc_ode::Variable;
use std::collections::BTreeMap;

/// A plant under `key` that is a process.
pub(super) fn program(key: &str, spec: &ProcessSpec, plants: &Plants) -> Checked {
    let key = format!("{key}.process");
    if spec.command.first().is_none_or(String::is_empty) {
        return value(&format!("{key}.command"), "no program", "a program and its arguments");
    }
    let ProcessSpec { states, inputs, nominal, difference_step, .. } = spec;
    variables(&key, [states, inputs], nominal, *difference_step)?;
    positive(&format!("{key}.time_limit_s"), spec.time_limit_s)?;
    allowed(&key, &format!("the program {}", spec.command[0]), plants)
}

/// A plant under `key` that is an FMU.
pub(super) fn fmu(key: &str, spec: &FmuSpec, plants: &Plants) -> Checked {
    let key = format!("{key}.fmu");
    let FmuSpec { states, inputs, nominal, difference_step, .. } = spec;
    variables(&key, [states, inputs], nominal, *difference_step)?;
    for (list, names, of, kind) in [
        (
            "variables",
            &spec.variables,
            [&states[..], &inputs[..], &spec.outputs[..]],
            "names of states, inputs and outputs",
        ),
        ("start_variables", &spec.start_variables, [&states[..], &[], &[]], "names of states"),
    ] {
        if let Some(name) = names.keys().find(|name| of.iter().all(|of| !has(of, name))) {
            return value(&format!("{key}.{list}"), format!("`{name}`"), kind);
        }
    }
    positive(&format!("{key}.time_limit_s"), spec.time_limit_s)?;
    allowed(&key, "a file with a binary", plants)?;
    match spec.open() {
        Ok(_) => Ok(()),
        Err(error) => {
            let expected = "an FMU of FMI 2.0 or 3.0 with these variables";
            let (key, file) = (format!("{key}.{}", error.key), spec.file.display());
            value(&key, format!("{file} ({error})"), expected)
        }
    }
}

fn has(variables: &[Variable], name: &str) -> bool {
    variables.iter().any(|variable| variable.name == name)
}

/// What a config would start, only where that is allowed.
fn allowed(key: &str, found: &str, plants: &Plants) -> Checked {
    match plants.processes_are_allowed() {
        true => Ok(()),
        false => value(key, found, "--allow-process on the command line"),
    }
}

fn variables(
    key: &str,
    [states, inputs]: [&[Variable]; 2],
    nominal: &BTreeMap<String, f64>,
    difference_step: f64,
) -> Checked {
    for (name, list) in [("states", states), ("inputs", inputs)] {
        if list.is_empty() {
            return value(&format!("{key}.{name}"), "[]", "one or more");
        }
    }
    for (name, &size) in nominal {
        let key = format!("{key}.nominal.{name}");
        if !has(states, name) && !has(inputs, name) {
            return value(&key, size, "a state or an input of the plant");
        }
        positive(&key, size)?;
    }
    positive(&format!("{key}.difference_step"), difference_step)
}

/// What needs an equation does not go with a plant that has none.
pub(super) fn uses(experiment: &Experiment) -> Checked {
    let is_black_box = experiment.plant.is_black_box();
    let models = experiment.control.iter().flat_map(|control| &control.models).enumerate();
    for (i, model) in models {
        let key = format!("control.models[{i}]");
        match (is_black_box, model) {
            (true, ModelKind::Integrator(_)) => {
                let expected = "\"pinc\" or \"black-box\": the plant has no equation";
                return value(&key, format!("\"{model}\""), expected);
            }
            (false, ModelKind::BlackBox) => {
                let expected = "another model: the plant has an equation";
                return value(&key, "\"black-box\"", expected);
            }
            _ => {}
        }
    }
    if !is_black_box {
        return Ok(());
    }
    if experiment.training.is_some() && !experiment.is_distilled() {
        let expected = "\"integrator\": a plant without an equation can be distilled only";
        return value("training.source", "\"physics\"", expected);
    }
    let weight = experiment.training.as_ref().and_then(|training| training.config.derivatives);
    if let (Some(weight), Some(plant)) = (weight, experiment.plant.dyn_plant().black_box())
        && !plant.has_derivatives()
    {
        let expected = "no such key: only an FMU for model exchange with directional derivatives, \
                        or an equation, has derivatives";
        return value("training.derivatives", weight, expected);
    }
    let control = experiment.control.as_ref();
    for (key, is_there) in [
        ("one_step", experiment.one_step.is_some()),
        ("identify", experiment.identify.is_some()),
        ("control.loads", control.is_some_and(|control| !control.loads.is_empty())),
    ] {
        if is_there {
            return value(key, "a section", "no such section: the plant has no equation");
        }
    }
    Ok(())
}
