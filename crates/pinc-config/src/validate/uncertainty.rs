//! Checks of `[control.uncertainty]`.

use super::Checked;
use super::values::{
    NO_PARAMETERS, alone, at_least_one, each, known_to_net, length, not_negative, place, value,
};
use crate::registry::Variables;
use crate::{
    ControlSpec, Experiment, FeedbackSpec, ModelKind, NetErrorSpec, OnError, UncertaintySpec,
};

const SECTION: &str = "control.uncertainty";

pub(super) fn uncertainty(
    experiment: &Experiment,
    control: &ControlSpec,
    variables: &Variables,
) -> Checked {
    let Some(spec) = &control.uncertainty else { return Ok(()) };
    sources(spec, control, variables)?;
    intervals(experiment, control, spec)?;
    let tightenings = format!("{SECTION}.tightenings");
    at_least_one(&tightenings, spec.tightenings)?;
    let others = [("sqp.real_time", control.sqp.real_time && spec.tightenings > 1)];
    alone(&tightenings, spec.tightenings, "number", &others)?;
    if let FeedbackSpec::Matrix(rows) = &spec.feedback {
        let key = format!("{SECTION}.feedback");
        let inputs = variables.inputs.len();
        if rows.len() != inputs {
            let expected = format!("{inputs}, one per input");
            return value(&key, format!("{} rows", rows.len()), &expected);
        }
        for (i, row) in rows.iter().enumerate() {
            length(&format!("{key}[{i}]"), row, variables.states.len(), "state")?;
        }
    }
    let others = [
        ("[control.scenarios]", control.scenarios.is_some()),
        ("control.stages_s", control.stages_s.is_some()),
        ("control.free_time", control.free_time.is_some()),
        ("control.delay_steps", control.delay_steps > 0),
        ("on_error = \"integrator\"", control.on_error == OnError::Integrator),
        ("on_error = \"correct\"", control.on_error == OnError::Correct),
    ];
    alone(SECTION, "a table", "table", &others)
}

/// The sources, and what they need.
fn sources(spec: &UncertaintySpec, control: &ControlSpec, variables: &Variables) -> Checked {
    let key = |name: &str| format!("{SECTION}.{name}");
    if !spec.process_sd.is_empty() {
        length(&key("process_sd"), &spec.process_sd, variables.states.len(), "state")?;
    }
    each(&key("process_sd"), &spec.process_sd, not_negative)?;
    let known = variables.state_names();
    for (name, &limit) in &spec.boxes {
        place(&key("boxes"), name, &known)?;
        not_negative(&format!("{SECTION}.boxes.{name}"), limit)?;
    }
    if let Some(chance) = spec.chance().filter(|chance| !(0.5..1.0).contains(chance)) {
        let expected = "from 0.5 to less than 1, or \"worst-case\"";
        return value(&key("probability"), chance, expected);
    }
    let unbounded = [("process_sd", !spec.process_sd.is_empty()), ("estimate", spec.estimate)];
    let mut worst_case =
        unbounded.iter().filter(|(_, is_there)| *is_there && spec.chance().is_none());
    if let Some((name, _)) = worst_case.next() {
        let expected = "no such key with probability = \"worst-case\": it has no limit";
        return value(&key(name), "a value", expected);
    }
    if spec.estimate && control.estimator.is_none() {
        return value(&key("estimate"), true, "[control.estimator], which has a covariance");
    }
    if spec.net_error != NetErrorSpec::NONE && !control.models.contains(&ModelKind::Pinc) {
        return value(&key("net_error"), "the error of a net", "\"pinc\" among control.models");
    }
    if spec.is_nothing() {
        let expected = "one of process_sd, boxes, parameters, estimate = true, net_error";
        return value(SECTION, "nothing uncertain", expected);
    }
    Ok(())
}

/// The intervals of parameters.
fn intervals(experiment: &Experiment, control: &ControlSpec, spec: &UncertaintySpec) -> Checked {
    let known = experiment.plant.parameter_names();
    let estimated = control.estimator.iter().flat_map(|estimator| &estimator.parameters);
    let estimated: Vec<&String> = estimated.map(|parameter| &parameter.name).collect();
    for (name, &[low, high]) in &spec.parameters {
        let key = format!("{SECTION}.parameters.{name}");
        let found = || format!("[{low}, {high}]");
        if known.is_empty() {
            return value(&key, found(), NO_PARAMETERS);
        }
        place(&key, name, &known)?;
        if !(low <= high && low.is_finite() && high.is_finite()) {
            return value(&key, found(), "two finite numbers, the lower one first");
        }
        known_to_net(&key, found(), name, (experiment, control))?;
        let others = [
            ("measured", control.measured_parameters.contains(name)),
            ("estimated", estimated.contains(&name)),
            ("in control.parameter_schedule", control.schedules(name)),
        ];
        if let Some((other, _)) = others.iter().find(|(_, is_there)| *is_there) {
            return value(&key, found(), &format!("a parameter that is not {other}"));
        }
    }
    Ok(())
}
