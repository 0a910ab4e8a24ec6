//! Failures of closed loops, and advice about them.

#[cfg(test)]
mod tests;

use crate::consistency;
use crate::metrics::{ControlMetrics, Metrics, ReferenceMetrics, is_failure};
use crate::violation::ViolationMetrics;
use pinc_config::{ModelKind, TimeUnit};
use pinc_mpc::SqpStatus;
use std::fmt;

/// An offset this many times another is due to more than the moment at which a loop settles.
const CLEARLY: f64 = 1.5;

/// Something that a reader of a run's results should know: what happened, and what to do next.
#[derive(Debug, PartialEq)]
pub(crate) struct Finding {
    what: String,
    advice: String,
}

impl Finding {
    pub(crate) fn new(what: String, advice: impl Into<String>) -> Self {
        Self { what, advice: advice.into() }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.what, self.advice)
    }
}

impl Metrics {
    /// Returns what went wrong in the closed loops, with advice, which is given once for
    /// consecutive findings that share it.
    #[must_use]
    pub fn loop_notes(&self) -> Vec<String> {
        let findings: Vec<Finding> = self.control.iter().flat_map(|of| self.findings(of)).collect();
        let note = |(place, finding): (usize, &Finding)| match findings.get(place + 1) {
            Some(next) if next.advice == finding.advice => finding.what.clone(),
            _ => finding.to_string(),
        };
        findings.iter().enumerate().map(note).collect()
    }

    fn findings(&self, of: &ControlMetrics) -> Vec<Finding> {
        let mut findings: Vec<Finding> =
            failed_steps(of).into_iter().chain(curvature_dropped(of)).collect();
        let broken = of.violations.iter().filter(|violation| violation.is_noteworthy());
        findings.extend(broken.map(|violation| {
            let (what, advice) = violation.note(self.time_unit);
            Finding::new(what, advice)
        }));
        findings.extend(of.references.offset.keys().filter_map(|name| self.not_reached(of, name)));
        if let Some(estimator) = &of.estimator {
            findings.extend(estimator.nearest_held.iter().map(not_held));
            let not_found = estimator.targets_not_found;
            findings.extend(not_found.map(|steps| targets_not_found(steps, of.steps())));
            findings.extend(consistency::findings(estimator, of.steps()));
        }
        for finding in &mut findings {
            finding.what = format!("With {} {}", self.title_of(of.model), finding.what);
        }
        findings
    }

    /// A controlled quantity that did not reach some of its references.
    fn not_reached(&self, of: &ControlMetrics, quantity: &str) -> Option<Finding> {
        let (segment, most, what) =
            of.references.not_reached(quantity, self.time_unit, |_| true)?;
        let reached = |other: &ControlMetrics| {
            let known = other.references.offset.get(quantity)?.get(segment).copied().flatten()?;
            let is_missed = other.references.missed(quantity).any(|(k, _)| k == segment);
            (!is_missed).then_some(known)
        };
        let others = || self.control.iter().filter(|other| other.model != of.model);
        let mut exact = others().filter(|other| may_be_blamed(of.model, other.model));
        let better =
            exact.find(|other| reached(other).is_some_and(|offset| CLEARLY * offset < most));
        Some(match better {
            Some(other) => {
                let advice = format!(
                    "With {} it does, so {} is not accurate enough there: use a larger net, more \
                     training or more substeps, or a [domain] that holds the loop.",
                    self.title_of(other.model),
                    self.title_of(of.model)
                );
                Finding::new(what, advice)
            }
            None if of.model == ModelKind::Policy && others().filter_map(reached).count() > 0 => {
                Finding::new(
                    what,
                    "Its net was trained too little (pinc shrink --samples), or does not know later \
                     references, as controllers with control.preview do: compare it with them under \
                     control.preview = false.",
                )
            }
            None => Finding::new(
                what,
                "Either no input within the bounds holds it (pinc check says which references are \
                 steady states), or the time was too short, or it is left early for the next one \
                 (control.preview), or the plant in the loop differs from the model's plant.",
            ),
        })
    }
}

/// Whether the accuracy of `model` may be why it misses a reference that is reached with `other`. A
/// black box is the plant, integrators have its equations, and nets approximate these; a policy has
/// no model.
fn may_be_blamed(model: ModelKind, other: ModelKind) -> bool {
    match model {
        ModelKind::Pinc | ModelKind::Integrator(_) => {
            matches!(other, ModelKind::Integrator(_) | ModelKind::BlackBox)
        }
        ModelKind::BlackBox | ModelKind::Policy => false,
    }
}

impl ReferenceMetrics {
    /// In words that a controlled quantity does not reach some of its references, of those that `counts` says,
    /// with the segment that ends farthest off and its offset.
    pub fn not_reached(
        &self,
        quantity: &str,
        time_unit: Option<TimeUnit>,
        counts: impl Fn(usize) -> bool,
    ) -> Option<(usize, f64, String)> {
        let references = self.offset.get(quantity)?.len();
        let missed = self.missed(quantity).filter(|(segment, _)| counts(*segment));
        let missed: Vec<(usize, f64)> = missed.collect();
        let &(segment, most) = missed.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let offset = significant(most);
        let which = match references {
            1 => format!("its reference: at the end it is {offset} off on average."),
            _ => {
                let start_s = self.reference_start_s.get(segment).copied();
                let start = TimeUnit::shown(start_s.unwrap_or_default(), time_unit);
                format!(
                    "{} of its {references} references: it ends {offset} off on average with the \
                     one from {start}.",
                    missed.len()
                )
            }
        };
        Some((segment, most, format!("{quantity} does not reach {which}")))
    }
}

/// Steps of the controller that failed.
fn failed_steps(of: &ControlMetrics) -> Option<Finding> {
    let failures = of.status.iter().filter(|(status, _)| is_failure(status));
    let (status, _) = failures.max_by_key(|(_, steps)| **steps)?;
    let (failed, steps) = (of.failed_steps(), of.steps());
    (failed > 0).then(|| {
        let what =
            format!("{failed} of {steps} control steps failed, most with the status {status}.");
        Finding::new(what, advice(status, of.model))
    })
}

/// Plans that may be no minima.
fn curvature_dropped(of: &ControlMetrics) -> Option<Finding> {
    let dropped = of.cost.as_ref().map(|cost| cost.curvature_dropped).filter(|n| *n > 0)?;
    let steps = of.steps();
    Some(Finding::new(
        format!(
            "negative curvature of the cost was dropped in {dropped} of {steps} control steps."
        ),
        "Their plans meet the first-order conditions, but are not proven to be minima: weight \
         moves of the inputs a little (r).",
    ))
}

impl ViolationMetrics {
    /// What was broken in words, and what to do about it.
    #[must_use]
    pub fn note(&self, time_unit: Option<TimeUnit>) -> (String, &'static str) {
        let is_between = self.is_between_steps();
        let when = if is_between {
            "between control steps".to_owned()
        } else if self.at_steps < 0.995 * self.amount {
            let most = significant(self.at_steps);
            format!("at control steps, by up to {most}{} there", self.unit_after_number())
        } else {
            "at control steps".to_owned()
        };
        let advice = if self.from_step > 1 {
            "Plans keep the bounds of outputs from step n1 on only: set control.n1 = 1, or tighten the \
             bound by as much."
        } else if is_between {
            "The controller keeps bounds at the ends of its steps only: shorten T, or tighten the \
             bound by as much."
        } else {
            "The model predicted otherwise, or the steps failed: use a more accurate model, or \
             tighten the bound by as much."
        };
        let what =
            format!("{} broke a hard bound {when}: it was {}.", self.of, self.shown(time_unit));
        (what, advice)
    }
}

/// A reference that cannot be held, with the nearest value that can.
fn targets_not_found(steps: usize, of: usize) -> Finding {
    let what =
        format!("the search for a steady-state target failed in {steps} of {of} control steps.");
    Finding::new(
        what,
        "They follow the references as they are. pinc check says which references are steady states: \
         choose such, or move references in smaller steps.",
    )
}

fn not_held((quantity, nearest): (&String, &f64)) -> Finding {
    let nearest = significant(*nearest);
    Finding::new(
        format!(
            "the last reference of {quantity} cannot be held: {nearest} is the nearest found that can."
        ),
        "The bounds, the estimated disturbances and the other references leave no more.",
    )
}

/// A number with three significant digits.
#[must_use]
pub fn significant(value: f64) -> String {
    match value.abs() {
        size if (1e2..1e6).contains(&size) => format!("{value:.0}"),
        size if (1e1..1e2).contains(&size) => format!("{value:.1}"),
        size if (1.0..1e1).contains(&size) => format!("{value:.2}"),
        size if (1e-1..1.0).contains(&size) => format!("{value:.3}"),
        size if (1e-2..1e-1).contains(&size) => format!("{value:.4}"),
        size if (1e-3..1e-2).contains(&size) => format!("{value:.5}"),
        0.0 => "0".to_owned(),
        _ => format!("{value:.2e}"),
    }
}

/// Returns advice for control steps with this model that end with this status, in the words of
/// [`SqpStatus`].
#[must_use]
pub fn advice(status: &str, model: ModelKind) -> &'static str {
    let is = |known: SqpStatus| known.to_string() == status;
    if is(SqpStatus::InfeasibleQp) {
        "No plan was found that keeps all bounds, those of end_state and of a cost's inequalities among \
         them: widen them, lengthen the horizon n2, let states leave their bounds where they must with \
         state_softness = \"exact\", or allow more of control.integer_programs for whole inputs."
    } else if (is(SqpStatus::IterationLimit) || is(SqpStatus::Stalled))
        && model == ModelKind::BlackBox
    {
        "The plans are as good as the simulator's precision allows: raise control.sqp.tolerance, and the \
         plant's difference_step where its answers are rounded or noisy."
    } else if is(SqpStatus::IterationLimit) {
        "Allow more of control.sqp.max_iterations, try control.sqp.hessian = \"adaptive\", shorten T, or \
         move the references in smaller steps."
    } else if is(SqpStatus::NumericalTrouble) {
        "The model or the cost gave no numbers that can be used, or the QP method failed on them: give \
         the model more substeps, or take \"rosenbrock\" for a stiff plant; a net should be trained on all of the box \
         where the loop goes; leave control.sqp.qp at \"auto\"."
    } else if is(SqpStatus::Stalled) {
        "The plans are as good as rounding or a kink of the model allows: raise control.sqp.tolerance, \
         give an integrator more substeps, or bound an input where the equation saturates it."
    } else {
        "steps.csv lists them."
    }
}
