//! The effect of the inputs at steady state: rank of the static gain, transmission zeros.

use crate::horizon::n2_of;
use crate::{Finding, LISTED, Subject, short};
use pinc_analysis::{
    OperatingPoint, StateSpace, StaticGain, TimeScales, TransmissionZeros, common_plane,
    common_ratio,
};

/// A zero this far below the fastest rate is at 0.
const AT_ZERO: f64 = 1e-6;

/// Random inputs whose steady states are compared.
const SAMPLES: usize = 40;

pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let controlled = subject.controlled();
    if controlled.is_empty() {
        return Vec::new();
    }
    let mut findings = Vec::new();
    // One point of each kind is enough: the others would repeat it.
    for (name, point) in subject.steady_points() {
        let Some(linear) = StateSpace::tangent(subject.plant, point, &controlled) else {
            continue;
        };
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

fn of_gain(subject: &Subject<'_>, place: &str, linear: &StateSpace) -> Vec<Finding> {
    let path = format!("from {} to {}", subject.inputs(), outputs(subject).join(", "));
    let widths = subject.region.widths();
    let gains = [linear.in_units(&widths), linear.scaled(&widths)].map(|of| of.static_gain());
    // Gains are told in the plant's units; which of them are 0 does not depend on these.
    let [Some(gain), Some(StaticGain { rank, .. })] = gains else {
        let what = format!("no static gain {path}: the plant integrates (an eigenvalue is 0)");
        return vec![Finding::fact(place, what)];
    };
    let values = gain.singular_values.iter().enumerate();
    let shown: Vec<_> =
        values.map(|(k, v)| if k < rank { short(*v) } else { "0".to_owned() }).collect();
    let what = format!("static gain {path}: singular values {}, rank {rank}", shown.join(", "));
    let wanted = subject.controlled().len();
    if rank >= wanted.min(subject.region.dims.nu) {
        return vec![Finding::fact(place, what)];
    }
    let line = relation(subject).map_or_else(String::new, |line| format!("; {line}"));
    vec![
        Finding::warning(place, format!("{what}: singular{line}"))
            .because(if wanted == 1 {
                "constant inputs have no effect on the controlled state at steady state".to_owned()
            } else {
                format!(
                    "at steady state the {wanted} controlled states cannot be chosen \
                     independently: a reference off what the gain reaches leaves an offset with \
                     any controller and any model"
                )
            })
            .change(
                "choose references that steady states reach, control fewer states, or change the \
                 plant's parameters",
            ),
    ]
}

/// What the controlled states have in common at all steady states, if that is a linear equation.
fn relation(subject: &Subject<'_>) -> Option<String> {
    let places = subject.controlled();
    let search = subject.search();
    let inputs = subject.region.points(subject.experiment.seed).take(SAMPLES);
    let settled = inputs.filter_map(|point| search.settle(&point.u));
    let outputs_of = |point: OperatingPoint| places.iter().map(|&i| point.x[i]).collect();
    let samples: Vec<Vec<f64>> = settled.map(outputs_of).collect();
    if samples.len() < SAMPLES / 2 {
        return None;
    }
    let names = outputs(subject);
    if let [one, two] = names[..]
        && let Some(ratio) = common_ratio(&samples)
    {
        return Some(format!("all steady states lie on the line {two}/{one} = {ratio:.4}"));
    }
    let widths: Vec<f64> = places.iter().map(|&i| subject.region.width(i)).collect();
    let plane = common_plane(&samples, &widths)?;
    let terms: Vec<_> =
        plane.normal.iter().zip(&names).map(|(a, name)| format!("{a:.4} {name}")).collect();
    Some(format!("all steady states have {} = {}", terms.join(" + "), short(plane.offset)))
}

fn of_zeros(subject: &Subject<'_>, place: &str, linear: &StateSpace) -> Vec<Finding> {
    let zeros = match linear.scaled(&subject.region.widths()).transmission_zeros() {
        TransmissionZeros::Finite(zeros) => zeros,
        TransmissionZeros::Degenerate { rank } => return vec![degenerate(subject, place, rank)],
    };
    let modes = linear.in_units(&subject.region.widths()).eigenvalues();
    let fastest = TimeScales::of(&modes).fastest.max(f64::MIN_POSITIVE);
    let is_zero = |s: f64| s.abs() < AT_ZERO * fastest;
    let shown: Vec<_> = zeros
        .iter()
        .map(|zero| match (is_zero(zero.re), is_zero(zero.im)) {
            (true, true) => "0".to_owned(),
            (_, true) => subject.rate(zero.re),
            _ => subject.complex_rate(zero.re, zero.im),
        })
        .collect();
    if zeros.is_empty() {
        return vec![Finding::fact(place, "no transmission zeros")];
    }
    let unit = subject.rate_unit();
    let what = match (&shown[..], zeros.len() > LISTED) {
        ([first, .., last], true) => {
            format!("{} transmission zeros, from {first} to {last} {unit}", zeros.len())
        }
        _ => format!("transmission zeros {} {unit}", shown.join(", ")),
    };
    if zeros.iter().any(|zero| is_zero(zero.re) && is_zero(zero.im)) {
        return vec![
            Finding::warning(place, format!("{what}: one is at s = 0"))
                .because(
                    "in one direction constant inputs have no lasting effect on the \
                 controlled states: no controller can hold an arbitrary reference there",
                )
                .change("references that steady states reach, or other parameters of the plant"),
        ];
    }
    let slowest =
        zeros.iter().map(|zero| zero.re).filter(|re| *re > 0.0).fold(f64::INFINITY, f64::min);
    let Some(control) = subject.experiment.control.as_ref().filter(|_| slowest.is_finite()) else {
        return vec![Finding::fact(place, what)];
    };
    let steps = (2.0 / (slowest * subject.step_s())).ceil();
    let horizon_s = control.horizon_s(subject.step_s());
    let too_short = horizon_s < steps * subject.step_s() * (1.0 - 1e-9);
    let what =
        format!("{what}: nonminimum phase, the response to an input first goes the wrong way");
    if too_short {
        vec![
            Finding::warning(place, format!("{what} for about {}", subject.time(1.0 / slowest)))
                .because(format!(
                    "a horizon of {} sees little more than that: the controller may then choose \
                     the wrong direction",
                    match control.stages_s {
                        Some(_) => subject.time(horizon_s),
                        None => format!("{} steps", control.n2),
                    }
                ))
                .change(format!(
                    "{}, or control.stages_s that become longer",
                    n2_of(steps, format!("control.n2 of about {steps:.0} or more, a longer T"))
                )),
        ]
    } else {
        vec![Finding::fact(place, what)]
    }
}

/// Fewer paths from the inputs to the controlled states than there are of these.
fn degenerate(subject: &Subject<'_>, place: &str, rank: usize) -> Finding {
    let what = match rank {
        0 => format!("{} has no effect on {}", subject.inputs(), outputs(subject).join(", ")),
        _ => "the controlled states do not respond independently at any frequency".to_owned(),
    };
    Finding::warning(place, what)
        .because("two inputs do the same, or a controlled state is out of the inputs' reach")
        .change("control other states, or fewer")
}
