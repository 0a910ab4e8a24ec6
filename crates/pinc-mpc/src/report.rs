//! The report of a control step.

use crate::constraint::Constraint;
use crate::guard::Trust;
use crate::kkt::KktResidual;
use crate::sqp::Outcome;
use crate::{SqpStatus, StepWork};

/// The result of a control step.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct StepReport<'a> {
    /// The input to apply, within its bounds whatever the status.
    pub u: &'a [f64],
    /// How the optimization ended.
    pub status: SqpStatus,
    /// How many QPs were solved, and iterations of the barrier method taken.
    pub sqp_iterations: usize,
    /// Other work; work done in [`Nmpc::prepare`](crate::Nmpc::prepare) counts towards the next step.
    pub work: StepWork,
    /// The residual of the plan that the optimization ended with (of a real-time iteration: that it
    /// began with); not finite if the model has no value there.
    pub kkt: KktResidual,
    /// A hard constraint that cannot be met, if that is what kept the step from being optimal.
    pub violated: Option<Constraint>,
    /// Whether `u` is of the plan that the optimization ended with; otherwise it is the next one of
    /// the last plan.
    pub followed: bool,
    /// Whether negative curvature was dropped at the plan: it then meets the first-order conditions
    /// at best, and is not known to be a minimum. Only steps that keep active limits active count. Only
    /// with a stage cost that leaves its Hessian to the optimization.
    pub curvature_dropped: bool,
    /// The cost J of the plan, with that of violations, if it is `followed`; otherwise NaN.
    pub cost: f64,
    /// From which of [`SqpConfig::starts`](crate::SqpConfig) the plan was found, 0 being the start
    /// without others, in a step that tried several.
    pub start: Option<usize>,
    /// Whether the model was trusted in the plan's first step. Of a step that was made over by a
    /// substitute all else is the substitute's.
    pub trust: Trust,
}

/// A [`StepReport`] without the input, which is empty.
pub(crate) type Planned = StepReport<'static>;

impl Planned {
    /// A step that was optimized, not yet judged.
    pub(crate) fn of(outcome: &Outcome, status: SqpStatus, followed: bool, work: StepWork) -> Self {
        let Outcome { iterations, last, violated, curvature_dropped, cost, .. } = *outcome;
        Self {
            status,
            sqp_iterations: iterations,
            kkt: last,
            violated,
            followed,
            curvature_dropped,
            cost: if followed { cost } else { f64::NAN },
            ..Self::held(work)
        }
    }

    /// A step without a state, in which the last input is held.
    pub(crate) fn held(work: StepWork) -> Self {
        Self {
            u: &[],
            status: SqpStatus::BadArgument,
            sqp_iterations: 0,
            work,
            kkt: KktResidual::unknown(),
            violated: None,
            followed: false,
            curvature_dropped: false,
            cost: f64::NAN,
            start: None,
            trust: Trust::NotJudged,
        }
    }

    pub(crate) fn report(self, u: &[f64]) -> StepReport<'_> {
        StepReport { u, ..self }
    }
}
