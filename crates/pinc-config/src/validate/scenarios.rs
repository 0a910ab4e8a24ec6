//! Checks of `[control.scenarios]`.

use super::Checked;
use super::values::{NO_PARAMETERS, alone, each, known_to_net, length, place, positive, value};
use crate::{Combine, ControlSpec, Experiment, OnError, ScenarioSpec};
use pinc_mpc::QpMethod;

const SECTION: &str = "control.scenarios";

/// The most nodes that a tree may have: about so many points are linearized in each iteration.
const NODES: usize = 100_000;

pub(super) fn scenarios(experiment: &Experiment, control: &ControlSpec) -> Checked {
    let Some(spec) = &control.scenarios else { return Ok(()) };
    values(experiment, control, spec)?;
    tree(control, spec)?;
    let told = |name: &String| spec.values.contains_key(name);
    let scheduled = spec.values.keys().any(|name| control.schedules(name));
    let others = [
        ("control.stages_s", control.stages_s.is_some()),
        ("control.input_differences", !control.input_differences.is_empty()),
        ("control.first_plan", control.first_plan.is_some()),
        ("control.bound_schedule", !control.bound_schedule.is_empty()),
        ("control.parameter_preview", control.parameter_preview),
        ("control.delay_steps", control.delay_steps > 0),
        ("the same parameter in control.parameters", control.parameters.keys().any(told)),
        ("[control.estimator]", control.estimator.is_some()),
        ("on_error = \"correct\"", control.on_error == OnError::Correct),
        ("sqp.qp = \"condensed\"", control.sqp.qp == QpMethod::Condensed),
        ("the same parameter measured", control.measured_parameters.iter().any(told)),
        ("the same parameter in control.parameter_schedule", scheduled),
    ];
    alone(SECTION, "a table", "table", &others)
}

/// The parameters and their values.
fn values(experiment: &Experiment, control: &ControlSpec, spec: &ScenarioSpec) -> Checked {
    let known = experiment.plant.parameter_names();
    if spec.values.is_empty() {
        let expected = "lists of values of one or more parameters";
        return value(&format!("{SECTION}.values"), "{}", expected);
    }
    for (name, values) in &spec.values {
        let key = format!("{SECTION}.values.{name}");
        if known.is_empty() {
            return value(&key, format!("{values:?}"), NO_PARAMETERS);
        }
        place(&key, name, &known)?;
        if values.is_empty() || values.iter().any(|value| !value.is_finite()) {
            return value(&key, format!("{values:?}"), "one or more finite numbers");
        }
        known_to_net(&key, format!("{values:?}"), name, (experiment, control))?;
        if spec.combine == Combine::InOrder && spec.branches() != Some(values.len()) {
            let expected = "as many values as each other parameter has: they are combined in order";
            return value(&key, format!("{values:?}"), expected);
        }
    }
    if spec.combine == Combine::Draws(0) {
        return value(&format!("{SECTION}.combine.draws"), 0, "1 or more");
    }
    Ok(())
}

/// The sizes of the tree.
fn tree(control: &ControlSpec, spec: &ScenarioSpec) -> Checked {
    let branches = spec.branches().unwrap_or(usize::MAX);
    if let Some(weights) = &spec.weights {
        let key = format!("{SECTION}.weights");
        length(&key, weights, branches, "branch")?;
        each(&key, weights, positive)?;
        let sum: f64 = weights.iter().sum();
        if !sum.is_finite() {
            return value(&key, sum, "weights with a finite sum");
        }
    }
    let key = format!("{SECTION}.robust_horizon");
    let horizon = spec.robust_horizon;
    if horizon == 0 || branches > 1 && horizon >= control.nu {
        let expected = format!("from 1 to less than the control horizon `nu`, {}", control.nu);
        return value(&key, horizon, &expected);
    }
    let paths = (0..horizon).try_fold(1_usize, |paths, _| paths.checked_mul(branches));
    let nodes = paths.and_then(|paths| paths.checked_mul(control.n2)).unwrap_or(usize::MAX);
    if nodes > NODES {
        let found = format!("{horizon}, with {branches} branches");
        let expected = format!("at most {NODES} nodes: branches^robust_horizon times `n2`");
        return value(&key, found, &expected);
    }
    Ok(())
}
