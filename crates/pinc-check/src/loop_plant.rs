//! Checks that the plant of the loop, if it differs from the models', can hold the references.

use crate::references::{nowhere, outside};
use crate::{Finding, HeldPoint, MOST_REFERENCES, Subject};
use pinc_analysis::{OperatingPoint, StateSpace};
use pinc_config::{ControlSpec, PlantInTheLoop};
use pinc_ode::DynRhs;
use std::ops::Range;

pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let control = subject.experiment.control.as_ref().filter(|control| control.has_mismatch());
    let Some(control) = control.filter(|_| !subject.controlled().is_empty()) else {
        return Vec::new();
    };
    let Some(step_s) = subject.experiment.sample_time_s() else { return Vec::new() };
    let cases = cases(subject, control, step_s);
    let looked_at = cases.len().min(MOST_REFERENCES);
    let mut findings: Vec<Finding> =
        cases[..looked_at].iter().filter_map(|case| judge(subject, control, case)).collect();
    findings.extend(other_sign(subject, control, step_s));
    let others = match cases.len() - looked_at {
        0 => String::new(),
        more => format!("; {more} further references and times were not looked at"),
    };
    if findings.is_empty() {
        let what = format!("the plant of the loop can hold what the models' plant can{others}");
        findings.push(Finding::fact("control.plant", what));
    }
    findings
}

/// The plants that the loop has one after the other; of very many, some of them.
fn plants(subject: &Subject<'_>, step_s: f64) -> Vec<PlantInTheLoop> {
    let all = subject.experiment.plants_in_the_loop(step_s);
    let every = all.len().div_ceil(MOST_REFERENCES).max(1);
    all.into_iter().step_by(every).collect()
}

/// A plant of the loop whose gain has another sign than the gain of the models' plant.
fn other_sign(subject: &Subject<'_>, control: &ControlSpec, step_s: f64) -> Option<Finding> {
    let controlled = subject.controlled();
    let gain = |plant: &dyn DynRhs, point: &OperatingPoint| {
        let tangent = StateSpace::tangent(plant, point, &controlled)?;
        tangent.scaled(&subject.region.widths()).static_gain()
    };
    let plants = plants(subject, step_s);
    subject.steady_points().into_iter().find_map(|(name, point)| {
        let of_model = gain(subject.plant, point)?;
        plants.iter().find_map(|plant| {
            // Where the plant of the loop holds the same values, or else where the same input
            // leads it.
            let held: Vec<f64> = controlled.iter().map(|&i| point.x[i]).collect();
            let there = match subject.hold(&*plant.plant, &held)?.steady() {
                Some(there) => there.clone(),
                None => subject.search_of(&*plant.plant).settle(&point.u)?,
            };
            let of_plant = gain(&*plant.plant, &there)?;
            of_plant.reverses(&of_model).then(|| reversed(subject, control, &name, plant, step_s))
        })
    })
}

fn reversed(
    subject: &Subject<'_>,
    control: &ControlSpec,
    place: &str,
    plant: &PlantInTheLoop,
    step_s: f64,
) -> Finding {
    let from = match plant.from_step {
        0 => String::new(),
        step => format!(" from {} on", subject.time(step as f64 * step_s)),
    };
    let what = format!(
        "{place}: with the plant of the loop{from} the static gain from {} to {} has another sign \
         than with the models' plant",
        subject.inputs(),
        control.controlled.join(", ")
    );
    Finding::warning("control.plant", what)
        .because(
            "at steady state an input that the model says to help moves the plant the other way: \
             an estimator of disturbances, or any integral action, drives the loop to its bounds",
        )
        .change("a model whose gain has the plant's sign, or control of fewer states")
}

/// A value of the references that is asked of a plant.
struct Case {
    /// The place of the reference.
    reference: usize,
    plant: PlantInTheLoop,
    /// When the plant is this one, in s.
    during_s: Range<f64>,
}

/// All of them that the plant of the models can hold, each value once per plant.
fn cases(subject: &Subject<'_>, control: &ControlSpec, step_s: f64) -> Vec<Case> {
    let plants = plants(subject, step_s);
    let mut starts: Vec<f64> = plants.iter().map(|p| p.from_step as f64 * step_s).collect();
    starts.push(control.duration_s);
    let held: Vec<&[f64]> = subject
        .holds
        .iter()
        .filter(|held| matches!(held.point, HeldPoint::Within(_)))
        .map(|held| &control.references[held.first].value[..])
        .collect();
    let mut cases: Vec<Case> = Vec::new();
    for (plant, ends) in plants.into_iter().zip(starts.windows(2)) {
        let first = cases.len();
        for (reference, step) in control.references.iter().enumerate() {
            let until = control.references.get(reference + 1).map_or(f64::INFINITY, |r| r.start_s);
            let meets = step.start_s < ends[1] && ends[0] < until;
            let known = |case: &Case| control.references[case.reference].value == step.value;
            if meets && held.contains(&&step.value[..]) && !cases[first..].iter().any(known) {
                let during_s = ends[0]..ends[1];
                cases.push(Case { reference, plant: plant.clone(), during_s });
            }
        }
    }
    cases
}

/// What is wrong with a reference and a plant, if anything is.
fn judge(subject: &Subject<'_>, control: &ControlSpec, case: &Case) -> Option<Finding> {
    let wanted = &control.references[case.reference].value;
    let place = format!("control.references[{}]", case.reference);
    let value = subject.controlled_values(wanted);
    let finding = match subject.hold(&*case.plant.plant, wanted)? {
        HeldPoint::Within(_) => return None,
        HeldPoint::Outside(point) => outside(subject, control, &place, &value, &point),
        HeldPoint::Nowhere(nearest) => {
            nowhere(subject, control, (&place, &value), wanted, nearest.as_ref())
        }
    };
    let Range { start, end } = case.during_s;
    let when = match (start > 0.0, end < control.duration_s) {
        (false, false) => String::new(),
        (true, false) => format!(" from {} on", subject.time(start)),
        (_, true) => format!(" from {} to {}", subject.time(start), subject.time(end)),
    };
    let what = format!("with the plant of the loop{when}: {}", finding.what);
    Some(Finding { what, ..finding })
}
