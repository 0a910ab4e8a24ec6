//! Checks that the equation and its derivatives are finite in the domain.

use crate::{Finding, LISTED, Subject, short};
use pinc_analysis::OperatingPoint;
use pinc_config::{LoopParameters, TimeUnit};
use pinc_ode::{DynRhs, Variable};

/// Random points of the region.
const POINTS: usize = 1000;

/// Halvings of the way from a good point to a bad one.
const HALVINGS: usize = 40;

pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let region = &subject.region;
    let random: Vec<OperatingPoint> = region.points(subject.experiment.seed).take(POINTS).collect();
    let bad: Vec<&OperatingPoint> = random.iter().filter(|p| fault(subject, p).is_some()).collect();
    if let Some(first) = bad.first() {
        let share = format!("at {} of {POINTS} random points", bad.len());
        return vec![broken(subject, first, &share)];
    }
    let special = region.special_points();
    if let Some(point) = special.iter().find(|p| fault(subject, p).is_some()) {
        return vec![on_the_edge(subject, point)];
    }
    let mut fastest = vec![0.0f64; region.dims.nx];
    for point in &random {
        let velocity = subject.rhs(&point.x, &point.u);
        for (fastest, v) in fastest.iter_mut().zip(&velocity) {
            *fastest = fastest.max(v.abs());
        }
    }
    let states = subject.plant.states().iter().zip(&fastest);
    let unit = subject.experiment.time_unit.unwrap_or(TimeUnit::S);
    let rate = |(v, f): (&Variable, &f64)| {
        format!("|{}'| <= {} per {}", v.name, short(*f * unit.seconds()), unit.name())
    };
    let rates: Vec<_> = match fastest.len() {
        0..=LISTED => states.map(rate).collect(),
        _ => states.max_by(|a, b| a.1.total_cmp(b.1)).map(rate).into_iter().collect(),
    };
    let text = format!(
        "values and derivatives are finite at {POINTS} random points of {}; there {}",
        subject.region_name,
        rates.join(", ")
    );
    let mut findings = vec![Finding::fact("", text)];
    findings.extend(of_family(subject, &random));
    findings
}

/// Where the equation is not finite that has the loop's parameters as variables: x^n with a variable n,
/// for instance, has no value below 0.
fn of_family(subject: &Subject<'_>, random: &[OperatingPoint]) -> Option<Finding> {
    let LoopParameters { names, values: p, .. } = subject.experiment.loop_parameters();
    if names.is_empty() {
        return None;
    }
    let plant = subject.experiment.plant.family(&names);
    let faults = random.iter().filter_map(|point| Some((point, fault_of((&*plant, &p), point)?)));
    let bad: Vec<(&OperatingPoint, String)> = faults.collect();
    let (point, fault) = bad.first()?;
    let what = format!(
        "with {} as a variable the equation or a derivative is not finite at {} of {POINTS} random \
         points of {}: {fault} at {}",
        names.join(", "),
        bad.len(),
        subject.region_name,
        subject.at(point)
    );
    let finding = Finding::error("plant", what)
        .because(
            "models and nets take parameters that vary as inputs; x^n has no value below 0 where n \
             varies",
        )
        .change("guard what is below 0, as max(x, 0)^n, or keep the domain away from there");
    Some(finding)
}

/// What is not finite at a point, if anything is.
fn fault(subject: &Subject<'_>, point: &OperatingPoint) -> Option<String> {
    fault_of((subject.plant, &[]), point)
}

/// [`fault`] of a plant with the parameters p.
fn fault_of((plant, p): (&dyn DynRhs, &[f64]), point: &OperatingPoint) -> Option<String> {
    let names = |i: usize| &plant.states()[i].name;
    let mut velocity = vec![0.0; point.x.len()];
    plant.rhs(&point.x, &point.u, p, &mut velocity);
    if let Some(i) = velocity.iter().position(|v| !v.is_finite()) {
        let reason = plant.explain(&point.x, &point.u, p);
        let reason = reason.map_or(String::new(), |reason| format!(" ({reason})"));
        return Some(format!("{}' is {}{reason}", names(i), velocity[i]));
    }
    let jacobian = plant.jacobian(&point.x, &point.u, p);
    let inputs = plant.inputs().iter().chain(plant.parameters());
    let variables: Vec<_> = plant.states().iter().chain(inputs).map(|v| &v.name).collect();
    for k in 0..variables.len() {
        let column = jacobian.iter().skip(k).step_by(variables.len());
        if let Some((i, value)) = column.enumerate().find(|(_, v)| !v.is_finite()) {
            return Some(format!("the derivative of {}' in {} is {value}", names(i), variables[k]));
        }
    }
    None
}

fn broken(subject: &Subject<'_>, bad: &OperatingPoint, share: &str) -> Finding {
    let what = fault(subject, bad).unwrap_or_default();
    let place = subject.at(bad);
    let edge = match edge(subject, bad) {
        Some(edge) => format!(
            "; from the middle of {} on the way there it is finite up to {edge}",
            subject.region_name
        ),
        None => String::new(),
    };
    Finding::error("plant", format!("{what} at {place} ({share}){edge}"))
        .because(
            "the training asks for values and derivatives everywhere in the domain; one that \
         is not finite ends it",
        )
        .change(
            "keep [domain] away from there, or write the equation so that it is defined there \
             too: guard the \
             argument of sqrt, log and of a division, give algebraic variables a box and a start \
             with the root beside it",
        )
}

fn on_the_edge(subject: &Subject<'_>, bad: &OperatingPoint) -> Finding {
    let what = fault(subject, bad).unwrap_or_default();
    let place = subject.at(bad);
    Finding::warning("plant", format!("{what} at {place}, an edge of {} or 0", subject.region_name))
        .because(
            "random points do not meet it, but a measured state or a steady state can lie \
         there, and no step can be computed from it",
        )
        .change(
            "move the edge of [domain] and the controller's bounds away from it, or guard the \
         argument of sqrt, log and of a division",
        )
}

/// The last good point on the way from the middle to a bad one.
fn edge(subject: &Subject<'_>, bad: &OperatingPoint) -> Option<String> {
    let region = &subject.region;
    let good = region.centre();
    if fault(subject, &good).is_some() {
        return None;
    }
    let (mut good, mut bad) = (good.joined(), bad.joined());
    for _ in 0..HALVINGS {
        let middle = good.iter().zip(&bad).map(|(a, b)| f64::midpoint(*a, *b)).collect();
        let middle = region.split(middle);
        match fault(subject, &middle) {
            None => good = middle.joined(),
            Some(_) => bad = middle.joined(),
        }
    }
    let good = region.split(good);
    Some(subject.at(&good))
}
