//! Checks of `control.free_time`, `control.end_state` and `control.periodic`.

use super::values::{alone, names, place, value};
use super::{Checked, Problem};
use crate::estimator::DisturbanceSpec::{Input, States};
use crate::{ControlSpec, CostSpec, EstimatorSpec, Experiment, Profile, Variables};

const KEY: &str = "control.free_time";

/// All three keys.
pub(super) fn free_time(
    experiment: &Experiment,
    control: &ControlSpec,
    variables: &Variables,
) -> Checked {
    end_state(control, variables)?;
    periodic(control, variables)?;
    let Some(name) = &control.free_time else { return Ok(()) };
    let found = || format!("{name:?}");
    let place = place(KEY, name, &variables.input_names())?;
    if control.input_low.get(place).is_some_and(|low| *low <= 0.0) {
        let key = format!("control.input_low[{place}]");
        let expected = format!("a positive number: {name} is a factor on lengths of stages");
        return value(&key, control.input_low[place], &expected);
    }
    if control.n2 < 2 || control.nu < 2 {
        let found = format!("{name:?} with n2 = {}, nu = {}", control.n2, control.nu);
        return value(KEY, found, "no such key, or n2 and nu of 2 or more");
    }
    let other_model = control.models.iter().find(|kind| kind.integrator().is_none());
    if let Some(kind) = other_model {
        let expected = format!("no such key with the model {:?}: integrators only", kind.name());
        return value(KEY, found(), &expected);
    }
    if experiment.plant.equations().is_none() {
        return value(KEY, found(), "no such key with a plant whose equations are not known");
    }
    let by_time = |of: &EstimatorSpec| matches!(of.disturbance, Input | States(_));
    let others = [
        ("`t` in [control.cost]", control.cost.as_ref().is_some_and(CostSpec::has_time)),
        ("more than one of control.references", control.references.len() > 1),
        ("control.bound_schedule", !control.bound_schedule.is_empty()),
        ("control.parameter_preview", control.parameter_preview),
        ("control.scenarios", control.scenarios.is_some()),
        ("weights_profile = \"cumulative\"", control.weights_profile == Profile::Cumulative),
        ("control.input_differences", !control.input_differences.is_empty()),
        ("disturbances of inputs or states", control.estimator.as_ref().is_some_and(by_time)),
    ];
    alone(KEY, found(), "key", &others)
}

fn end_state(control: &ControlSpec, variables: &Variables) -> Checked {
    let known = variables.state_names();
    for (name, &number) in &control.end_state {
        let key = format!("control.end_state.{name}");
        let place = place(&key, name, &known)?;
        if !number.is_finite() {
            return Err((key, Problem::NotFinite(number)));
        }
        let low = control.bound(0, place).unwrap_or(f64::NEG_INFINITY);
        let high = control.bound(3, place).unwrap_or(f64::INFINITY);
        if !(low..=high).contains(&number) {
            return value(&key, number, &format!("from {low} to {high}, the bounds of {name}"));
        }
    }
    if !control.end_state.is_empty() && !control.bound_schedule.is_empty() {
        let expected = "no such table with control.bound_schedule";
        return value("control.end_state", "a table", expected);
    }
    Ok(())
}

fn periodic(control: &ControlSpec, variables: &Variables) -> Checked {
    const KEY: &str = "control.periodic";
    let known = variables.state_names();
    names(KEY, &control.periodic, &known)?;
    for (i, name) in control.periodic.iter().enumerate() {
        if control.end_state.contains_key(name) {
            let expected = "a state that is not in control.end_state";
            return value(&format!("{KEY}[{i}]"), format!("{name:?}"), expected);
        }
    }
    let others = [
        ("control.free_time", control.free_time.is_some()),
        ("control.scenarios", control.scenarios.is_some()),
        ("[control.uncertainty]", control.uncertainty.is_some()),
        ("control.sqp.real_time", control.sqp.real_time),
    ];
    if control.periodic.is_empty() { Ok(()) } else { alone(KEY, "a list", "key", &others) }
}
