//! Whether a steady state reaches each reference, and the inputs can hold it within their bounds.

use crate::numbers::apart;
use crate::{Finding, Subject, named, short};
use pinc_analysis::{HeldPoint, OperatingPoint};
use pinc_config::ControlSpec;

pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let Some(control) = &subject.experiment.control else {
        return Vec::new();
    };
    let mut findings = Vec::new();
    for (k, (reference, hold)) in control.references.iter().zip(&subject.holds).enumerate() {
        let place = format!("control.references[{k}]");
        let value = named(control.controlled.iter().map(String::as_str), &reference.value);
        findings.push(match hold {
            HeldPoint::Within(point) => {
                let (x, u) = (subject.state(&point.x), subject.input(&point.u));
                Finding::fact(place, format!("{value} is held at {x} by {u}"))
            }
            HeldPoint::Outside(point) => outside(subject, control, &place, &value, point),
            HeldPoint::Nowhere(nearest) => {
                let at = (&*place, &*value);
                nowhere(subject, control, at, &reference.value, nearest.as_ref())
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
    point: &OperatingPoint,
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
                let needed = apart(*value, if *value < low { low } else { high }).0;
                let ends = format!("bounds {} to {}", short(low), short(high));
                needs.push(format!("{} = {needed} ({ends})", variable.name));
            }
        }
    }
    let what = format!("{value} cannot be held within bounds: it needs {}", needs.join(", "));
    Finding::warning(place, what)
        .because("the controller will sit at its bounds with an offset, whatever its model")
        .change(
            "move the reference, or widen control.input_low, input_high, state_low or \
         state_high if the plant allows it",
        )
}

fn nowhere(
    subject: &Subject<'_>,
    control: &ControlSpec,
    (place, value): (&str, &str),
    wanted: &[f64],
    nearest: Option<&OperatingPoint>,
) -> Finding {
    let miss = |point: &OperatingPoint| {
        // Two numbers that differ are shown with the digits in which they do.
        let pairs = subject.controlled().into_iter().zip(wanted).zip(&control.controlled);
        let shown = pairs.map(|((i, wanted), name)| {
            let (found, wanted) = (point.x[i], *wanted);
            let off = (found - wanted).abs() > 1e-6 * subject.region.width(i);
            let text = if off { apart(found, wanted).0 } else { short(found) };
            format!("{name} = {text}")
        });
        shown.collect::<Vec<_>>().join(", ")
    };
    let nearest = nearest.map_or_else(String::new, |point| {
        format!("; a steady state near it has {} at {}", miss(point), subject.input(&point.u))
    });
    Finding::warning(place, format!("{value} is no steady state, with any input{nearest}"))
        .because(
            "no controller can hold it: there will be an offset, or the input will not come \
         to rest",
        )
        .change("a reference that is a steady state, or fewer controlled states")
}
