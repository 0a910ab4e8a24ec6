//! Trajectories that leave the training domain: the validation's scenarios, the free run, and the
//! closed loop with RK4 as the model.

use crate::groups::groups;
use crate::{Finding, Subject, numbers, short};
use pinc_analysis::OperatingPoint;
use pinc_config::{ControlSpec, Experiment, ModelKind};
use pinc_net::Domain;
use pinc_ode::{Simulator, Variable};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use std::ops::Range;

/// Random scenarios, and samples per T.
const SCENARIOS: usize = 10;
const SAMPLES: usize = 9;

/// Local error tolerance: enough to see where a trajectory goes.
const TOLERANCE: f64 = 1e-6;

/// Beyond the domain by less than this share of its width is not worth a warning.
const SLACK: f64 = 1e-3;

/// What a proposed domain leaves beyond what was seen, of its width.
const MARGIN: f64 = 0.05;

pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let mut findings = Vec::new();
    let mut seen = Extent::default();
    for (place, extent) in uses(subject, &mut findings) {
        if let Some(domain) = &subject.experiment.domain {
            findings.extend(compare(subject, &place, &extent, domain));
        }
        seen.merge(&extent);
    }
    findings.extend(parameters(subject.experiment));
    let left = findings.iter().any(|finding| finding.place == "domain");
    if left && let Some(domain) = &subject.experiment.domain {
        findings.push(proposal(subject, &seen, domain));
    } else if subject.experiment.domain.is_some() && !seen.ends.is_empty() && findings.is_empty() {
        findings.push(Finding::fact(
            "domain",
            "trajectories stay in the training domain, free ones and closed loops",
        ));
    }
    findings
}

/// The parameters with which the controller uses the net outside the ranges of its training.
fn parameters(experiment: &Experiment) -> Vec<Finding> {
    let ranges = experiment.domain.iter().flat_map(|domain| &domain.parameters);
    let control = experiment.control.as_ref();
    let Some(control) = control.filter(|of| of.models.contains(&ModelKind::Pinc)) else {
        return Vec::new();
    };
    let own = experiment.model_parameters();
    let outside = ranges.zip(own).filter_map(|(range, own)| {
        let name = range.name.as_str();
        let told = told_values(control, name).chain([own]);
        let (low, high) = told.fold((own, own), |(low, high), p| (low.min(p), high.max(p)));
        let said = match (low < range.low, high > range.high) {
            (false, false) => return None,
            (true, false) => format!("{name} down to {}", short(low)),
            (false, true) => format!("{name} up to {}", short(high)),
            (true, true) => format!("{name} from {} to {}", short(low), short(high)),
        };
        Some(format!("{said}, but trained from {} to {}", range.low, range.high))
    });
    let finding = |what: String| {
        Finding::warning("domain.parameters", format!("the net is used with {what}"))
            .because("outside the box it was trained on a net is wrong")
            .change("a wider range in [domain.parameters], or other values in [control]")
    };
    outside.map(finding).collect()
}

/// What the models are told of a parameter in the course of a loop, or ahead of it.
fn told_values<'a>(control: &'a ControlSpec, name: &'a str) -> impl Iterator<Item = f64> + 'a {
    let is_measured = control.measured_parameters.iter().any(|of| of == name);
    let measured = control.plant_schedule.iter().filter(move |_| is_measured);
    let steps = control.parameter_schedule.iter().chain(measured);
    let branches = control.scenarios.iter().filter_map(|of| of.values.get(name)).flatten();
    let intervals = control.uncertainty.iter().filter_map(|of| of.parameters.get(name)).flatten();
    let steps = steps.filter_map(|step| step.values.get(name));
    steps.chain(branches).chain(intervals).copied()
}

/// The least and the largest value of each variable, states first.
#[derive(Default)]
struct Extent {
    ends: Vec<(f64, f64)>,
}

impl Extent {
    fn add(&mut self, values: impl Iterator<Item = f64>) {
        for (i, v) in values.enumerate() {
            match self.ends.get_mut(i) {
                Some((low, high)) => (*low, *high) = (low.min(v), high.max(v)),
                None => self.ends.push((v, v)),
            }
        }
    }

    fn merge(&mut self, other: &Self) {
        self.add(other.ends.iter().map(|ends| ends.0));
        self.add(other.ends.iter().map(|ends| ends.1));
    }
}

/// The uses that the config makes of the net, and where each goes.
fn uses(subject: &Subject<'_>, findings: &mut Vec<Finding>) -> Vec<(String, Extent)> {
    let Experiment { validation, prediction, seed, .. } = subject.experiment;
    let mut uses = Vec::new();
    let mut rng = ChaCha8Rng::seed_from_u64(*seed);
    let mut draw = |low: &[f64], high: &[f64]| -> Vec<f64> {
        low.iter().zip(high).map(|(a, b)| a + (b - a) * rng.random::<f64>()).collect()
    };
    let mut free = Vec::new();
    if let Some(spec) = validation {
        let Domain { state_low, state_high, input_low, input_high, .. } = &spec.domain;
        for _ in 0..SCENARIOS {
            let x = draw(state_low, state_high);
            let steps = pinc_config::steps(spec.duration_s, subject.step_s());
            free.push((x, (0..steps).map(|_| draw(input_low, input_high)).collect::<Vec<_>>()));
        }
        uses.push(("the validation's scenarios".to_owned(), simulate(subject, &free, findings)));
    }
    if let Some(spec) = prediction {
        let steps = pinc_config::steps(spec.duration_s, subject.step_s());
        let inputs = (0..steps).map(|_| draw(&spec.input_low, &spec.input_high)).collect();
        let run = [(spec.initial_state.clone(), inputs)];
        uses.push(("the free run of [prediction]".to_owned(), simulate(subject, &run, findings)));
    }
    if let Some(Ok(rehearsal)) = &subject.evidence.rehearsal {
        let (trace, mut extent) = (&rehearsal.trace, Extent::default());
        for i in 0..trace.len() {
            extent.add(trace.state(i).iter().chain(trace.input(i)).copied());
        }
        uses.push((format!("the closed loop with {}", rehearsal.model.title()), extent));
    }
    uses
}

type Scenario = (Vec<f64>, Vec<Vec<f64>>);

fn simulate(subject: &Subject<'_>, runs: &[Scenario], findings: &mut Vec<Finding>) -> Extent {
    let mut extent = Extent::default();
    let part = subject.step_s() / SAMPLES as f64;
    let mut broken = 0;
    let mut first = None;
    'runs: for (start, inputs) in runs {
        let mut x = start.clone();
        let mut truth = Simulator::new(subject.plant, TOLERANCE);
        for u in inputs {
            extent.add(x.iter().chain(u).copied());
            for _ in 0..SAMPLES {
                if let Err(error) = truth.integrate(&mut x, u, part) {
                    broken += 1;
                    first.get_or_insert((OperatingPoint { x: x.clone(), u: u.clone() }, error));
                    continue 'runs;
                }
                extent.add(x.iter().chain(u).copied());
            }
        }
    }
    if let Some((point, error)) = first {
        let place = subject.at(&point);
        let what = format!(
            "the plant breaks off in {broken} of {} free runs, the first at {place}: {error}",
            runs.len()
        );
        findings.push(
            Finding::error("plant", what)
                .because("there is no truth to compare a net with, and validation fails")
                .change(
                    "inputs and initial states that keep the plant where it is defined, or \
                 shorter runs",
                ),
        );
    }
    extent
}

/// One finding for every variable that leaves the domain.
fn compare(subject: &Subject<'_>, place: &str, extent: &Extent, domain: &Domain) -> Vec<Finding> {
    let (states, inputs) = (subject.plant.states(), subject.plant.inputs());
    let variables = states.iter().chain(inputs);
    let lows = domain.state_low.iter().chain(&domain.input_low);
    let highs = domain.state_high.iter().chain(&domain.input_high);
    let all: Vec<_> = variables.zip(&extent.ends).zip(lows.zip(highs)).collect();
    let later =
        groups(inputs).into_iter().map(|(_, at)| at.start + states.len()..at.end + states.len());
    let mut left = Vec::new();
    for places in groups(states).into_iter().map(|(_, at)| at).chain(later) {
        let places = places.start..places.end.min(all.len());
        // For an array, the elements that go farthest.
        let below = |i: &usize| (all[*i].1.0 - all[*i].0.1.0) / (all[*i].1.1 - all[*i].1.0);
        let above = |i: &usize| (all[*i].0.1.1 - all[*i].1.1) / (all[*i].1.1 - all[*i].1.0);
        let lowest = places.clone().max_by(|a, b| below(a).total_cmp(&below(b)));
        let highest = places.max_by(|a, b| above(a).total_cmp(&above(b)));
        if let Some(i) = lowest.filter(|i| below(i) > SLACK) {
            let ((variable, (from, _)), (low, _)) = all[i];
            let from = short(*from);
            left.push(format!("{} goes down to {from} (domain from {low})", variable.name));
        }
        if let Some(i) = highest.filter(|i| above(i) > SLACK) {
            let ((variable, (_, to)), (_, high)) = all[i];
            left.push(format!("{} goes up to {} (domain to {high})", variable.name, short(*to)));
        }
    }
    if left.is_empty() {
        return Vec::new();
    }
    vec![
        Finding::warning("domain", format!("{place}: {}", left.join(", ")))
            .because("outside the box it was trained on a net is wrong")
            .change("a larger domain (see below), or narrower ranges there"),
    ]
}

/// A domain that holds all that was seen.
fn proposal(subject: &Subject<'_>, seen: &Extent, domain: &Domain) -> Finding {
    let states = domain.state_low.len();
    let ends = |i: usize, low: f64, high: f64| {
        let (from, to) = seen.ends.get(i).copied().unwrap_or((low, high));
        let margin = MARGIN * (to - from);
        // An end that holds stays; a level or an angle keeps its sign.
        let low = if from < low { rounded(from - margin, f64::floor, from) } else { low };
        let high = if to > high { rounded(to + margin, f64::ceil, to) } else { high };
        (low, high)
    };
    let pairs = |lows: &[f64], highs: &[f64], first: usize| -> (Vec<f64>, Vec<f64>) {
        let both = lows.iter().zip(highs).enumerate();
        both.map(|(i, (low, high))| ends(first + i, *low, *high)).unzip()
    };
    // A list has one entry per array.
    let per_group = |variables: &[Variable], (low, high): (Vec<f64>, Vec<f64>)| {
        let of_group = |(_, places): (String, Range<usize>)| {
            let both = low[places.clone()].iter().chain(&high[places]);
            numbers::ends(both.copied())
        };
        groups(variables).into_iter().map(of_group).unzip()
    };
    let (plant, of_states) = (subject.plant, pairs(&domain.state_low, &domain.state_high, 0));
    let of_inputs = pairs(&domain.input_low, &domain.input_high, states);
    let (state_low, state_high): (Vec<f64>, Vec<f64>) = per_group(plant.states(), of_states);
    let (input_low, input_high): (Vec<f64>, Vec<f64>) = per_group(plant.inputs(), of_inputs);
    let text = format!(
        "[domain]\nstate_low = {state_low:?}\nstate_high = {state_high:?}\ninput_low = \
         {input_low:?}\n\
         input_high = {input_high:?}"
    );
    Finding::fact("domain", "a box that holds all of these trajectories").change(text)
}

/// Outwards to two digits; a positive value does not become negative, nor the other way round.
fn rounded(value: f64, outwards: impl Fn(f64) -> f64, seen: f64) -> f64 {
    if value * seen < 0.0 {
        return 0.0;
    }
    let digit = 10f64.powf(value.abs().max(1e-12).log10().floor() - 1.0);
    let rounded = outwards(value / digit) * digit;
    // Without the tail of a decimal fraction's binary form.
    format!("{rounded:.12}").parse().unwrap_or(rounded)
}

#[cfg(test)]
mod tests {
    use super::rounded;

    #[test]
    fn ends_are_rounded_outwards_to_two_digits() {
        for (value, down, up) in
            [(123.4, 120.0, 130.0), (-0.01234, -0.013, -0.012), (5.0, 5.0, 5.0), (9.96, 9.9, 10.0)]
        {
            let ends = [rounded(value, f64::floor, value), rounded(value, f64::ceil, value)];
            assert_eq!(ends.to_vec(), [down, up], "{value}");
        }
        let signs = [rounded(-0.2, f64::floor, 0.1), rounded(0.2, f64::ceil, -0.1)];
        assert_eq!(signs.to_vec(), [0.0; 2]);
    }
}
