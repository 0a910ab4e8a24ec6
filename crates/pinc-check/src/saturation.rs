//! Inputs that have no effect beyond some value, as of an actuator whose limits stand in the equation.

use crate::{Finding, Subject, short};
use pinc_analysis::OperatingPoint;

/// Random points at which an input has to be without effect.
const POINTS: usize = 50;

/// The part of an input's range in which it has to be without effect.
const LEAST: f64 = 0.01;

/// Halvings of the way from a value with an effect to one without.
const HALVINGS: usize = 40;

pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let Some(control) = &subject.experiment.control else { return Vec::new() };
    let points: Vec<_> = subject.region.points(subject.experiment.seed).take(POINTS).collect();
    let mut findings = Vec::new();
    for (input, variable) in subject.plant.inputs().iter().enumerate() {
        let (low, high) = (control.input_low[input], control.input_high[input]);
        for (key, beyond, from, end) in [("low", "below", high, low), ("high", "above", low, high)]
        {
            let Some(last) = saturation(subject, &points, input, [from, end]) else { continue };
            let name = &variable.name;
            let what = format!("{name} has no effect {beyond} {}", short(last));
            let finding = Finding::warning(format!("control.input_{key}"), what)
                .because(format!(
                    "a plan with {name} there has no slope to follow: steps stall, or the plan stays there"
                ))
                .change(format!("{} as this bound of {name}", short(last)));
            findings.push(finding);
        }
    }
    findings
}

/// The value from which on `input` has no effect up to `end`, at any of the points, with some effect
/// between `from` and there.
fn saturation(
    subject: &Subject<'_>,
    points: &[OperatingPoint],
    input: usize,
    [from, end]: [f64; 2],
) -> Option<f64> {
    let range = end - from;
    if !range.is_finite() || range == 0.0 {
        return None;
    }
    let is_flat = |point: &OperatingPoint, share: f64| {
        let of = |value: f64| {
            let mut u = point.u.clone();
            u[input] = value;
            subject.rhs(&point.x, &u)
        };
        of(from + share * range) == of(end)
    };
    if !points.iter().all(|point| is_flat(point, 1.0 - LEAST)) {
        return None;
    }
    // The least share of the range beyond which the input has no effect, of all points.
    let mut flat_from: f64 = 0.0;
    for point in points.iter() {
        if is_flat(point, flat_from) {
            continue;
        }
        let (mut steep, mut flat) = (flat_from, 1.0 - LEAST);
        for _ in 0..HALVINGS {
            let middle = f64::midpoint(steep, flat);
            if is_flat(point, middle) { flat = middle } else { steep = middle }
        }
        flat_from = flat;
    }
    (flat_from > 0.0).then_some(from + flat_from * range)
}
