//! Checks of `control.integer` and `control.target`.

use super::values::value;
use super::{Checked, Problem};
use crate::problem::nearest;
use crate::{ControlSpec, Variables};

const KEY: &str = "control.integer";

/// Inputs that are whole numbers.
pub(super) fn whole(control: &ControlSpec, variables: &Variables) -> Checked {
    let known = variables.input_names();
    for (i, name) in control.integer.iter().enumerate() {
        let key = format!("{KEY}[{i}]");
        let Some(place) = known.iter().position(|input| input == name) else {
            let (found, nearest) = (name.clone(), nearest(name, &known));
            return Err((key, Problem::Word { found, known, nearest }));
        };
        if control.integer[..i].contains(name) {
            return value(&key, format!("{name:?}"), "each of them once");
        }
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
    for (other, is_there) in [
        ("sqp.real_time", control.sqp.real_time),
        ("control.scenarios", control.scenarios.is_some()),
        ("control.bound_schedule", !control.bound_schedule.is_empty()),
    ] {
        if is_there && !control.integer.is_empty() {
            let expected = format!("no such key with {other}");
            return value(KEY, format!("{:?}", control.integer), &expected);
        }
    }
    Ok(())
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
    Ok(())
}
