//! What the inputs can do at steady state: the rank of the static gain, and the transmission zeros.

use super::linear::{Linear, singular_values};
use super::steady::{Point, settle};
use super::{Finding, Subject, short};
use faer::{Mat, Side};

/// Singular values this far below the largest count as 0.
const RANK: f64 = 1e-6;

/// Random inputs whose steady states are compared.
const SAMPLES: usize = 40;

pub(super) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let controlled = subject.controlled();
    if controlled.is_empty() {
        return Vec::new();
    }
    let mut findings = Vec::new();
    // One point of each kind is enough: the others would repeat it.
    for (name, point) in subject.operating_points() {
        let Some(linear) = Linear::at(subject, point) else { continue };
        let mut here = of_gain(subject, &name, &linear);
        if controlled.len() == subject.region.dims.nu {
            here.extend(of_zeros(subject, &name, &linear));
        }
        let serious = here.iter().any(|f| !f.why.is_empty());
        if serious || findings.is_empty() {
            findings = here;
        }
        if serious {
            break;
        }
    }
    findings
}

fn outputs<'a>(subject: &'a Subject<'_>) -> Vec<&'a str> {
    let states = subject.plant.states();
    subject.controlled().iter().map(|&i| states[i].name.as_ref()).collect()
}

fn of_gain(subject: &Subject<'_>, place: &str, linear: &Linear) -> Vec<Finding> {
    let inputs: Vec<_> = subject.plant.inputs().iter().map(|v| v.name.as_ref()).collect();
    let path = format!("from {} to {}", inputs.join(", "), outputs(subject).join(", "));
    let Some(gain) = linear.static_gain() else {
        let what = format!("no static gain {path}: the plant integrates (an eigenvalue is 0)");
        return vec![Finding::fact(place, what)];
    };
    let values = singular_values(&gain);
    let largest = values.first().copied().unwrap_or(0.0);
    let rank = values.iter().filter(|v| **v > RANK * largest).count();
    let shown: Vec<_> = values
        .iter()
        .map(|v| if *v > RANK * largest { short(*v) } else { "0".to_owned() })
        .collect();
    let what = format!("static gain {path}: singular values {}, rank {rank}", shown.join(", "));
    let wanted = subject.controlled().len();
    if rank >= wanted.min(inputs.len()) {
        return vec![Finding::fact(place, what)];
    }
    let line = relation(subject).map_or_else(String::new, |line| format!("; {line}"));
    vec![
        Finding::warning(place, format!("{what}: singular{line}"))
            .because(format!(
                "at steady state the {wanted} controlled states cannot be chosen independently: a reference off \
                 what the gain reaches leaves an offset with any controller and any model"
            ))
            .change(
                "choose references that steady states reach, control fewer states, or change the plant's parameters",
            ),
    ]
}

/// What the controlled states have in common at all steady states, if that is a linear equation.
fn relation(subject: &Subject<'_>) -> Option<String> {
    let outputs_of =
        |point: &Point| -> Vec<f64> { subject.controlled().iter().map(|&i| point.x[i]).collect() };
    let starts = subject.region.points(subject.experiment.seed).take(SAMPLES);
    let settled = starts.filter_map(|start| settle(subject, &start));
    let samples: Vec<Vec<f64>> = settled.map(|point| outputs_of(&point)).collect();
    if samples.len() < SAMPLES / 2 {
        return None;
    }
    let names = outputs(subject);
    if let [one, two] = names[..]
        && let Some(ratio) = common(samples.iter().map(|y| y[1] / y[0]))
    {
        return Some(format!("all steady states lie on the line {two}/{one} = {ratio:.4}"));
    }
    let (normal, offset) = plane(subject, &samples)?;
    let terms: Vec<_> =
        normal.iter().zip(&names).map(|(a, name)| format!("{a:.4} {name}")).collect();
    Some(format!("all steady states have {} = {}", terms.join(" + "), short(offset)))
}

/// The value that all have, to a millionth.
fn common(values: impl Iterator<Item = f64>) -> Option<f64> {
    let values: Vec<f64> = values.collect();
    let (low, high) = values
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(*v), high.max(*v)));
    (high - low <= 1e-6 * high.abs().max(low.abs())).then(|| f64::midpoint(low, high))
}

/// A plane a y = c with |a| = 1 that all samples lie on: a is the direction in which they do not vary.
fn plane(subject: &Subject<'_>, samples: &[Vec<f64>]) -> Option<(Vec<f64>, f64)> {
    let places = subject.controlled();
    let p = places.len();
    #[expect(clippy::cast_precision_loss, reason = "a few samples")]
    let count = samples.len() as f64;
    let width = |i: usize| subject.region.width(places[i]);
    let mean: Vec<f64> =
        (0..p).map(|i| samples.iter().map(|y| y[i]).sum::<f64>() / count).collect();
    let covariance = Mat::from_fn(p, p, |i, k| {
        let product = |y: &Vec<f64>| (y[i] - mean[i]) * (y[k] - mean[k]) / (width(i) * width(k));
        samples.iter().map(product).sum::<f64>() / count
    });
    // Eigenvalues in increasing order: squares of lengths, in widths of the region.
    let decomposition = covariance.self_adjoint_eigen(Side::Lower).ok()?;
    if decomposition.S().column_vector()[0] > 1e-12 {
        return None;
    }
    let direction: Vec<f64> = (0..p).map(|i| decomposition.U()[(i, 0)] / width(i)).collect();
    let length = direction.iter().map(|a| a * a).sum::<f64>().sqrt();
    let normal: Vec<f64> = direction.iter().map(|a| a / length).collect();
    let offset = normal.iter().zip(&mean).map(|(a, y)| a * y).sum();
    Some((normal, offset))
}

fn of_zeros(subject: &Subject<'_>, place: &str, linear: &Linear) -> Vec<Finding> {
    let Some(zeros) = linear.zeros() else {
        return vec![
            Finding::warning(
                place,
                "the controlled states do not respond independently at any frequency",
            )
            .because("two inputs do the same, or a controlled state is out of the inputs' reach")
            .change("control other states, or fewer"),
        ];
    };
    let rate = linear.rate();
    let is_zero = |s: f64| s.abs() < RANK * rate;
    let shown: Vec<_> = zeros
        .iter()
        .map(|&(re, im)| match (is_zero(re), is_zero(im)) {
            (true, true) => "0".to_owned(),
            (_, true) => format!("{re:.4}"),
            _ => format!("{re:.4} {im:+.4}i"),
        })
        .collect();
    if zeros.is_empty() {
        return vec![Finding::fact(place, "no transmission zeros")];
    }
    let what = format!("transmission zeros {} 1/s", shown.join(", "));
    if zeros.iter().any(|&(re, im)| is_zero(re) && is_zero(im)) {
        return vec![
            Finding::warning(place, format!("{what}: one is at s = 0"))
                .because("in one direction constant inputs have no lasting effect on the controlled states: no controller can hold an arbitrary reference there")
                .change("references that steady states reach, or other parameters of the plant"),
        ];
    }
    let slowest = zeros.iter().map(|z| z.0).filter(|re| *re > 0.0).fold(f64::INFINITY, f64::min);
    let Some(control) = subject.experiment.control.as_ref().filter(|_| slowest.is_finite()) else {
        return vec![Finding::fact(place, what)];
    };
    let steps = (2.0 / (slowest * subject.step_s())).ceil();
    #[expect(clippy::cast_precision_loss, reason = "a few steps")]
    let too_short = (control.n2 as f64) < steps;
    let what =
        format!("{what}: nonminimum phase, the response to an input first goes the wrong way");
    if too_short {
        vec![
            Finding::warning(place, format!("{what} for about {} s", short(1.0 / slowest)))
                .because(format!(
                    "a horizon of {} steps sees little more than that: the controller may then choose the wrong direction",
                    control.n2
                ))
                .change(format!("control.n2 of about {steps:.0} or more, or a longer T")),
        ]
    } else {
        vec![Finding::fact(place, what)]
    }
}
