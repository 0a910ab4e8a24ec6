//! Checks of `[identify]`.

use super::Checked;
use super::estimator::some_names;
use super::values::{MEASURED, at_least_one, distinct, each, length, parameters, positive, value};
use crate::registry::Variables;
use crate::{Experiment, IdentifySpec, PlantSpec};

pub(super) fn identification(
    experiment: &Experiment,
    spec: &IdentifySpec,
    variables: &Variables,
) -> Checked {
    let mut known = variables.state_names();
    known.extend(variables.own_output_names());
    if let Some(measured) = &spec.measured {
        some_names("identify.measured", measured, &known)?;
    }
    let measured = spec.measurement().names(variables).len();
    if let Some(sd) = &spec.measurement_sd {
        length("identify.measurement_sd", sd, measured, MEASURED)?;
        each("identify.measurement_sd", sd, positive)?;
    }
    initial_state(spec, variables)?;
    if let Some(step_s) = spec.step_s {
        positive("identify.step_s", step_s)?;
    }
    let validation_rows = ("validation_rows", spec.validation_rows);
    let counts = [("starts", spec.starts), validation_rows, ("substeps", spec.substeps)];
    for (key, count) in counts.into_iter().filter_map(|(key, count)| Some((key, count?))) {
        at_least_one(&format!("identify.{key}"), count)?;
    }
    nets(experiment, spec)?;
    if spec.parameters.is_empty() && spec.nets.is_empty() && spec.initial_state.is_none() {
        let expected = "parameters to identify, or an initial_state to start from";
        return value("identify.parameters", "[]", expected);
    }
    estimated(experiment, spec)
}

fn initial_state(spec: &IdentifySpec, variables: &Variables) -> Checked {
    let states = variables.states.len();
    match (&spec.initial_state, &spec.fixed_initial_state) {
        (Some(state), None) => length("identify.initial_state", state, states, "state"),
        (None, Some(state)) => length("identify.fixed_initial_state", state, states, "state"),
        (Some(_), Some(_)) => {
            let expected = "no such key with identify.initial_state, which is the first guess of an unknown one";
            value("identify.fixed_initial_state", "a state", expected)
        }
        (None, None) => {
            let expected = "initial_state, the first guess of an unknown one, or fixed_initial_state, \
                            a known one";
            value("identify.initial_state", "nothing", expected)
        }
    }
}

fn nets(experiment: &Experiment, spec: &IdentifySpec) -> Checked {
    let known: Vec<String> = match &experiment.plant {
        PlantSpec::Expression(equations) => equations.nets.keys().cloned().collect(),
        _ => Vec::new(),
    };
    let key = |i: usize, name: &str| format!("identify.nets[{i}].{name}");
    let listed = spec.nets.iter().map(|net| &net.name);
    let none = "no such key: the plant has no plant.expression.nets";
    distinct(|i| key(i, "name"), listed, &known, [none, "each net once"])?;
    let mut nets = spec.nets.iter().enumerate();
    nets.try_for_each(|(i, net)| positive(&key(i, "weight_sd"), net.weight_sd))
}

fn estimated(experiment: &Experiment, spec: &IdentifySpec) -> Checked {
    let name_of = |i: usize| format!("identify.parameters[{i}].name");
    parameters(name_of, spec.parameters.iter().map(|parameter| &parameter.name), experiment)?;
    for (i, parameter) in spec.parameters.iter().enumerate() {
        let key = |name: &str| format!("identify.parameters[{i}].{name}");
        if let Some(sd) = parameter.sd {
            positive(&key("sd"), sd)?;
        }
        let identified =
            spec.nets.iter().any(|net| parameter.name.split('[').next() == Some(&net.name));
        if identified {
            let expected = "a parameter that is not a weight of identify.nets";
            return value(&name_of(i), format!("{:?}", parameter.name), expected);
        }
        let low = parameter.low.unwrap_or(f64::NEG_INFINITY);
        let high = parameter.high.unwrap_or(f64::INFINITY);
        if low >= high {
            return value(&key("low"), low, &format!("less than the upper end, {high}"));
        }
        if parameter.initial < low || parameter.initial > high {
            let expected = format!("a start within its bounds, {low} to {high}");
            return value(&key("initial"), parameter.initial, &expected);
        }
    }
    Ok(())
}
