//! Checks of `control.integer` and `control.target`.

use super::values::{alone, names, place, value};
use super::{Checked, Problem};
use crate::{ControlSpec, Variables};

const KEY: &str = "control.integer";

/// Inputs that are whole numbers.
pub(super) fn whole(control: &ControlSpec, variables: &Variables) -> Checked {
    let known = variables.input_names();
    names(KEY, &control.integer, &known)?;
    for name in &control.integer {
        let place = place(KEY, name, &known)?;
        let sides = [("input_low", &control.input_low), ("input_high", &control.input_high)];
        let initial = control.initial_input.as_ref().map(|input| ("initial_input", input));
        for (list, side) in sides.into_iter().chain(initial) {
            let number = side[place];
            if number.is_finite() && number.fract() != 0.0 {
                let expected = format!("a whole number, since {name} is in {KEY}");
                return value(&format!("control.{list}[{place}]"), number, &expected);
            }
        }
    }
    let others = [
        ("sqp.real_time", control.sqp.real_time),
        ("control.scenarios", control.scenarios.is_some()),
        ("control.uncertainty", control.uncertainty.is_some()),
        ("control.bound_schedule", !control.bound_schedule.is_empty()),
    ];
    if control.integer.is_empty() {
        Ok(())
    } else {
        alone(KEY, format!("{:?}", control.integer), "key", &others)
    }
}

/// Steady-state targets.
pub(super) fn target(control: &ControlSpec) -> Checked {
    if control.target && control.estimator.is_none() {
        let needed = "control.target needs its disturbances";
        return Err(("control.estimator".to_owned(), Problem::Section(needed)));
    }
    if control.target && control.controlled.is_empty() {
        return value("control.target", true, "false without controlled quantities");
    }
    let others = [
        ("control.bound_schedule", !control.bound_schedule.is_empty()),
        (KEY, !control.integer.is_empty()),
    ];
    if control.target { alone("control.target", true, "key", &others) } else { Ok(()) }
}
