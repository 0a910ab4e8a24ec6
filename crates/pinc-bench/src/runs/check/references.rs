//! Whether a steady state reaches each reference, and the inputs can hold it within their bounds.

use super::steady::{Point, SteadyStateResult};
use super::{Finding, Subject, named, short};
use crate::spec::ControlSpec;

pub(super) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let Some(control) = &subject.experiment.control else {
        return Vec::new();
    };
    let mut findings = Vec::new();
    for (k, (reference, hold)) in control.references.iter().zip(&subject.holds).enumerate() {
        let place = format!("control.references[{k}]");
        let value = named(control.controlled.iter().map(String::as_str), &reference.value);
        findings.push(match hold {
            SteadyStateResult::Within(point) => {
                let (x, u) = (subject.state(&point.x), subject.input(&point.u));
                Finding::fact(place, format!("{value} is held at {x} by {u}"))
            }
            SteadyStateResult::Outside(point) => outside(subject, control, &place, &value, point),
            SteadyStateResult::Nowhere(nearest) => {
                nowhere(subject, control, &place, &value, nearest.as_ref())
            }
        });
    }
    findings
}

/// The variables of a point outside the controller's bounds.
fn outside(
    subject: &Subject<'_>,
    control: &ControlSpec,
    place: &str,
    value: &str,
    point: &Point,
) -> Finding {
    let sides = [
        (subject.plant.states(), &point.x, control.state_low.as_ref(), control.state_high.as_ref()),
        (subject.plant.inputs(), &point.u, Some(&control.input_low), Some(&control.input_high)),
    ];
    let mut needs = Vec::new();
    for (variables, values, low, high) in sides {
        for (i, (variable, value)) in variables.iter().zip(values).enumerate() {
            let low = low.map_or(f64::NEG_INFINITY, |low| low[i]);
            let high = high.map_or(f64::INFINITY, |high| high[i]);
            if *value < low || *value > high {
                let (low, high) = (short(low), short(high));
                needs.push(format!(
                    "{} = {} (bounds {low} to {high})",
                    variable.name,
                    short(*value)
                ));
            }
        }
    }
    let what = format!("{value} cannot be held within bounds: it needs {}", needs.join(", "));
    Finding::warning(place, what)
        .because("the controller will sit at its bounds with an offset, whatever its model")
        .change("move the reference, or widen control.input_low, input_high, state_low or state_high if the plant allows it")
}

fn nowhere(
    subject: &Subject<'_>,
    control: &ControlSpec,
    place: &str,
    value: &str,
    nearest: Option<&Point>,
) -> Finding {
    let nearest = nearest.map_or_else(String::new, |point| {
        let y: Vec<f64> = subject.controlled().iter().map(|&i| point.x[i]).collect();
        let y = named(control.controlled.iter().map(String::as_str), &y);
        format!("; a steady state near it has {y} at {}", subject.input(&point.u))
    });
    Finding::warning(place, format!("{value} is no steady state, with any input{nearest}"))
        .because("no controller can hold it: there will be an offset, or the input will not come to rest")
        .change("a reference that is a steady state, or fewer controlled states")
}
