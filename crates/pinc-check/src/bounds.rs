//! Checks start, references and bounds against each other and the training domain.

use crate::groups::groups;
use crate::{Finding, MOST_REFERENCES, Subject, short};
use pinc_analysis::OperatingPoint;
use pinc_config::{ControlSpec, Variables};
use pinc_net::Domain;
use std::ops::Range;

pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let Some(control) = &subject.experiment.control else {
        return Vec::new();
    };
    let mut findings = values(subject, control);
    findings.extend(outputs(subject, control));
    if let Some(domain) = &subject.experiment.domain {
        findings.extend(reach(subject, control, domain));
    }
    if findings.is_empty() {
        let text = match (&control.output_low, &control.output_high) {
            (None, None) => {
                "start and references are within the bounds, and these within the domain"
            }
            _ => {
                "start and references are within the bounds, also of outputs, and the bounds of \
                 states and inputs within the domain"
            }
        };
        findings.push(Finding::fact("", text));
    }
    findings
}

fn ends(control: &ControlSpec, i: usize) -> (f64, f64) {
    let low = control.state_low.as_ref().map_or(f64::NEG_INFINITY, |low| low[i]);
    (low, control.state_high.as_ref().map_or(f64::INFINITY, |high| high[i]))
}

/// Start and references against the bounds.
fn values(subject: &Subject<'_>, control: &ControlSpec) -> Vec<Finding> {
    let outside = |value: f64, (low, high): (f64, f64)| value < low || value > high;
    let states = subject.plant.states();
    let mut findings = Vec::new();
    for (_, places) in groups(states) {
        let is_out = |i: &usize| outside(control.initial_state[*i], ends(control, *i));
        // One element of an array is enough: the first.
        if let Some(i) = places.clone().find(is_out) {
            let value = control.initial_state[i];
            let what = format!("{} = {value} is outside its bounds", states[i].name);
            findings.push(
                Finding::warning("control.initial_state", what)
                    .because(
                        "the first predictions cannot keep the bounds: the first problems \
                     may be infeasible",
                    )
                    .change("start within control.state_low and state_high, or widen them"),
            );
        }
    }
    for (k, reference) in control.references.iter().enumerate() {
        for (&i, value) in subject.controlled().iter().zip(&reference.value) {
            if outside(*value, ends(control, i)) && findings.len() < MOST_REFERENCES {
                let what = format!("{} = {value} is outside its bounds", states[i].name);
                findings.push(
                    Finding::warning(format!("control.references[{k}]"), what)
                        .because("the controller keeps the bounds and leaves an offset")
                        .change("move the reference, or widen control.state_low and state_high"),
                );
            }
        }
    }
    findings
}

/// Random points that show how far outputs range.
const SAMPLES: usize = 40;

/// The bounds of outputs against the start and the references, for instance of a distance from an obstacle:
/// controlled outputs by their value, others where the states hold the reference.
fn outputs(subject: &Subject<'_>, control: &ControlSpec) -> Vec<Finding> {
    let variables = subject.plant.outputs();
    let problem = control.problem(&Variables::of(subject.plant), subject.step_s());
    let Some(bounds) = problem.output_bounds else { return Vec::new() };
    let at = |x: &[f64], u: &[f64]| {
        let mut y = vec![0.0; variables.len()];
        subject.plant.output(x, u, &[], &mut y);
        y
    };
    let samples = subject.region.points(subject.experiment.seed).take(SAMPLES);
    let samples: Vec<Vec<f64>> = samples.map(|point| at(&point.x, &point.u)).collect();
    let range = |i: usize| {
        let values = samples.iter().map(|y| y[i]).filter(|y| y.is_finite());
        values.clone().fold(0.0, f64::max) - values.fold(0.0, f64::min)
    };
    let is_out = |i: usize, [least, most]: [f64; 2]| {
        let slack = 1e-6 * most.abs().max(range(i));
        !(most >= bounds.low[i] - slack && least <= bounds.high[i] + slack)
    };
    let outside = |i: usize, value: f64, at: &str| {
        let [value, low, high] = [value, bounds.low[i], bounds.high[i]].map(short);
        format!("{} is {value} {at}, outside its bounds {low} to {high}", variables[i].name)
    };
    let mut findings = Vec::new();

    // An input may still bring an output back that it acts on at once.
    let given = control.initial_input.clone().unwrap_or_else(|| vec![0.0; control.input_low.len()]);
    let start = at(&control.initial_state, &given);
    let mut reach: Vec<[f64; 2]> = start.iter().map(|y| [*y; 2]).collect();
    for (input, ends) in control.input_low.iter().zip(&control.input_high).enumerate() {
        for end in [ends.0, ends.1] {
            let mut u = given.clone();
            u[input] = *end;
            let moved = at(&control.initial_state, &u);
            for (reach, (y, start)) in reach.iter_mut().zip(moved.iter().zip(&start)) {
                reach[usize::from(y > start)] += y - start;
            }
        }
    }
    let always = |i: &usize| reach[*i].iter().all(|y| y.is_finite()) && is_out(*i, reach[*i]);
    if let Some(i) = (0..variables.len()).find(always) {
        findings.push(
            Finding::warning("control.initial_state", outside(i, start[i], "there"))
                .because("no input moves it at once: the first problems may be infeasible")
                .change("start within control.output_low and output_high, or widen them"),
        );
    }

    let mut report = |reference: usize, i: usize, value: f64, at: &str| {
        if !is_out(i, [value; 2]) || findings.len() == MOST_REFERENCES {
            return;
        }
        findings.push(
            Finding::warning(format!("control.references[{reference}]"), outside(i, value, at))
                .because(
                    "the reference and a bound of the outputs exclude each other: the controller \
                     stops at the bound, or violates it where it is soft",
                )
                .change("move the reference, or widen control.output_low and output_high"),
        );
    };
    for (k, reference) in control.references.iter().enumerate() {
        for (name, value) in control.controlled.iter().zip(&reference.value) {
            let is_state = subject.plant.states().iter().any(|state| state.name == *name);
            let place = variables.iter().position(|output| output.name == *name);
            if let Some(i) = place.filter(|_| !is_state) {
                report(k, i, *value, "there");
            }
        }
    }
    for held in &subject.holds {
        let kept = held.kept.as_ref().map(|kept| &kept.point);
        let Some(OperatingPoint { x, u }) = kept.or(held.point.steady()) else { continue };
        for (i, value) in at(x, u).into_iter().enumerate() {
            report(held.first, i, value, "where the reference is held");
        }
    }
    findings
}

/// The bounds against the training domain.
fn reach(subject: &Subject<'_>, control: &ControlSpec, domain: &Domain) -> Vec<Finding> {
    let mut findings = Vec::new();
    let mut compare = |name: &str, (low, high): (f64, f64), (from, to): (f64, f64)| {
        if low < from || high > to {
            let change = if low.is_finite() && high.is_finite() {
                format!(
                    "a domain of {name} that holds {low} to {high}, or narrower bounds in [control]"
                )
            } else {
                format!("bounds of {name} in [control], within {from} to {to}")
            };
            findings.push(
                Finding::warning(
                    "domain",
                    format!(
                        "the bounds of {name} reach outside the \
                 training domain"
                    ),
                )
                .because(
                    "a net is wrong outside the box it was trained on, and the optimizer \
                     may plan there",
                )
                .change(change),
            );
        }
    };
    // For an array, the ends of all elements together.
    let together = |places: &Range<usize>, ends: &dyn Fn(usize) -> (f64, f64)| {
        let all = places.clone().map(ends);
        all.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (from, to)| {
            (low.min(from), high.max(to))
        })
    };
    for (name, places) in groups(subject.plant.states()) {
        let of_domain = |i: usize| (domain.state_low[i], domain.state_high[i]);
        let is_out = |i: &usize| {
            let ((low, high), (from, to)) = (ends(control, *i), of_domain(*i));
            low < from || high > to
        };
        if let Some(out) = places.clone().find(is_out) {
            compare(&name, together(&places, &|i| ends(control, i)), of_domain(out));
        }
    }
    for (i, input) in subject.plant.inputs().iter().enumerate() {
        let bounds = (control.input_low[i], control.input_high[i]);
        compare(&input.name, bounds, (domain.input_low[i], domain.input_high[i]));
    }
    findings
}
