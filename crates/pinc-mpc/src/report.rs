//! What a control step reports.

use crate::constraint::Constraint;
use crate::guard::Trust;
use crate::kkt::KktResidual;
use crate::{SqpStatus, StepWork};

/// The result of a control step.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct StepReport<'a> {
    /// The input to apply, within its bounds whatever the status.
    pub u: &'a [f64],
    /// How the optimization ended.
    pub status: SqpStatus,
    /// How many QPs were solved.
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
    /// Whether the model was trusted in the plan's first step. Of a step that was made over by a
    /// substitute all else is the substitute's.
    pub trust: Trust,
}

/// A [`StepReport`] without the input.
pub(crate) struct Planned {
    pub(crate) status: SqpStatus,
    pub(crate) sqp_iterations: usize,
    pub(crate) work: StepWork,
    pub(crate) kkt: KktResidual,
    pub(crate) violated: Option<Constraint>,
    pub(crate) followed: bool,
    pub(crate) trust: Trust,
}

impl Planned {
    pub(crate) fn report(self, u: &[f64]) -> StepReport<'_> {
        let Self { status, sqp_iterations, work, kkt, violated, followed, trust } = self;
        StepReport { u, status, sqp_iterations, work, kkt, violated, followed, trust }
    }
}
