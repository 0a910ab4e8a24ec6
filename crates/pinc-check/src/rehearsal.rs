//! A rehearsal of the closed loop with an integrator: failed steps, references that are missed and
//! broken bounds.

use crate::{Finding, Rehearsal, Subject};
use pinc_analysis::HeldPoint;
use pinc_config::{ControlSpec, NetErrorSpec, UncertaintySpec};
use pinc_record::{advice, is_failure};

/// An offset is more than slow if it is so many times as large as where a quantity counts as settled, and of
/// a state at least this part of the region.
const FAR: f64 = 10.0;
const VISIBLE: f64 = 0.05;

pub(crate) fn examine(subject: &Subject<'_>) -> Vec<Finding> {
    let (Some(control), Some(rehearsal)) =
        (&subject.experiment.control, &subject.evidence.rehearsal)
    else {
        return Vec::new();
    };
    let rehearsal = match rehearsal {
        Ok(rehearsal) => rehearsal,
        Err(error) => {
            // Only RK4 has not been asked for where no integrator is in the config.
            return vec![
                Finding::error("control", format!("with an integrator as the model: {error}"))
                    .because(
                        "a controller that fails with the plant's own equation will not work \
                         with a net",
                    )
                    .change(
                        "other bounds, references or a shorter T; more rk4_substeps if the \
                         equation is stiff",
                    ),
            ];
        }
    };
    let mut findings = judged(subject, control, rehearsal);
    findings.extend(left_out(control));
    findings
}

/// What the rehearsed loop does without, though `pinc control` does not.
fn left_out(control: &ControlSpec) -> Option<Finding> {
    let uncertain = control.uncertainty.as_ref();
    let has_net_error = |of: &UncertaintySpec| of.net_error != NetErrorSpec::NONE;
    let keys = [
        ("control.plant", control.plant.is_some()),
        ("control.plant_schedule", !control.plant_schedule.is_empty()),
        ("control.loads", !control.loads.is_empty()),
        ("control.parameters", !control.parameters.is_empty()),
        ("control.parameter_schedule", !control.parameter_schedule.is_empty()),
        ("control.estimator", control.estimator.is_some()),
        ("control.uncertainty.estimate", uncertain.is_some_and(|of| of.estimate)),
        ("control.uncertainty.net_error", uncertain.is_some_and(has_net_error)),
        ("control.budget_us", control.budget_us.is_some()),
    ];
    let keys: Vec<&str> = keys.iter().filter_map(|(key, given)| given.then_some(*key)).collect();
    let what = || {
        format!(
            "the rehearsed loop has the models' own plant, known states and no clock; it leaves out {}",
            keys.join(", ")
        )
    };
    (!keys.is_empty()).then(|| Finding::fact("control", what()))
}

/// The statuses of its steps, what it misses and what it breaks.
fn judged(subject: &Subject<'_>, control: &ControlSpec, rehearsal: &Rehearsal) -> Vec<Finding> {
    let (model, steps) = (rehearsal.model.title(), rehearsal.status.values().sum::<usize>());
    let failures = || rehearsal.status.iter().filter(|(status, _)| is_failure(status));
    let failed: usize = failures().map(|(_, steps)| steps).sum();
    let Some((worst, _)) = failures().max_by_key(|(_, steps)| **steps) else {
        let what = match rehearsal.left_out {
            0 => format!("all {steps} steps of the closed loop with {model} succeed"),
            more => format!(
                "the first {steps} steps of the closed loop with {model} succeed; the other {more} \
                 were left out, since they would take long"
            ),
        };
        let mut findings = vec![Finding::fact("control", what)];
        findings.extend(missed(subject, control, rehearsal));
        findings.extend(broken(subject, rehearsal));
        return findings;
    };
    let what = format!(
        "{failed} of {steps} steps of the closed loop with {model} fail, most with the status {worst}"
    );
    let share = failed as f64 / steps as f64;
    if share <= control.max_failed_share {
        return vec![Finding::fact("control", what)];
    }
    vec![
        Finding::warning("control", what)
            .because(
                "a step that fails follows the plan of the step before, or none: what the loop does \
                 then says little of the model",
            )
            .change(advice(worst, rehearsal.model)),
    ]
}

/// What does not reach its references, of which no other finding says why: the quantity that ends
/// farthest off.
fn missed(subject: &Subject<'_>, control: &ControlSpec, rehearsal: &Rehearsal) -> Option<Finding> {
    let of = &rehearsal.references;
    let counts = |segment: usize| {
        let is_whole = rehearsal.left_out == 0 || segment + 1 < of.reference_start_s.len();
        let start_s = of.reference_start_s.get(segment);
        is_whole && start_s.is_some_and(|start_s| is_held(subject, control, *start_s))
    };
    let time_unit = subject.experiment.time_unit;
    let states = subject.plant.states();
    // A target moves the references of inputs to what the others leave.
    let inputs = subject.plant.inputs();
    let moved = |quantity: &str| control.target && inputs.iter().any(|u| u.name == quantity);
    let missed = control.controlled.iter().filter(|quantity| !moved(quantity));
    let missed = missed.filter_map(|quantity| {
        let (_, offset, what) = of.not_reached(quantity, time_unit, counts)?;
        let place = states.iter().position(|state| state.name == *quantity);
        let visible = place.map_or(0.0, |i| VISIBLE * subject.region.width(i));
        let far = offset / (FAR * of.settled_within.get(quantity)?).max(visible);
        (far >= 1.0).then_some((far, what))
    });
    let missed: Vec<(f64, String)> = missed.collect();
    let (_, what) = missed.iter().max_by(|a, b| a.0.total_cmp(&b.0))?;
    Some(
        Finding::warning("control", in_the_loop(rehearsal, what, missed.len()))
            .because(
                "the model is the plant's own equation, and all states are known: another model \
                 does no better",
            )
            .change(
                "more time between references, other weights, a longer horizon, preview = false, \
                 bounds that leave the inputs room, or control.first_plan where plans end in a \
                 local minimum",
            ),
    )
}

/// What is said of the worst of so many quantities.
fn in_the_loop(rehearsal: &Rehearsal, what: &str, quantities: usize) -> String {
    let (model, what) = (rehearsal.model.title(), what.trim_end_matches('.'));
    let others = match quantities - 1 {
        0 => String::new(),
        others => format!(" (and so for {others} more)"),
    };
    format!("in the closed loop with {model} {what}{others}")
}

/// Whether the reference at a time can be held within the bounds, as far as is known.
fn is_held(subject: &Subject<'_>, control: &ControlSpec, time_s: f64) -> bool {
    let begun = |of: &&pinc_config::ReferenceStep| of.start_s <= time_s + 0.5 * subject.step_s();
    let Some(reference) = control.references.iter().take_while(begun).last() else { return true };
    let held = subject.holds.iter();
    let mut held = held.filter(|held| control.references[held.first].value == reference.value);
    held.all(|held| held.kept.is_some() || matches!(held.point, HeldPoint::Within(_)))
}

/// Hard bounds that the plant broke: the one that was broken by the largest share.
fn broken(subject: &Subject<'_>, rehearsal: &Rehearsal) -> Option<Finding> {
    let broken: Vec<_> =
        rehearsal.violations.iter().filter(|violation| violation.is_noteworthy()).collect();
    let worst = broken.iter().max_by(|a, b| a.share.total_cmp(&b.share))?;
    let (what, advice) = worst.note(subject.experiment.time_unit);
    Some(
        Finding::warning("control", in_the_loop(rehearsal, &what, broken.len()))
            .because("bounds are kept as far as plans see them")
            .change(advice.trim_end_matches('.')),
    )
}
