//! The outcome of an optimization.

use crate::SqpStatus;
use crate::constraint::Constraint;
use crate::kkt::KktResidual;

/// What came of an optimization.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Outcome {
    pub(crate) status: SqpStatus,
    pub(crate) iterations: usize,
    /// The residual at the end.
    pub(crate) last: KktResidual,
    /// What is in the way, if hard constraints had to be made soft and are violated.
    pub(crate) violated: Option<Constraint>,
    /// What is known of the plan.
    pub(crate) plan_state: PlanState,
    /// Whether the plan is not known to be a minimum, since the cost's curvature is negative there;
    /// without convergence, whether the last program had to be made convex.
    pub(crate) curvature_dropped: bool,
    /// The cost of the last plan that was evaluated, with what violations of soft constraints cost.
    pub(crate) cost: f64,
}

impl Outcome {
    /// The cost of a plan that converged, and infinity for others.
    pub(crate) fn cost_if_converged(&self) -> f64 {
        if self.status == SqpStatus::Converged { self.cost } else { f64::INFINITY }
    }

    /// The time was up before the first linearization was complete.
    pub(super) fn expired_at_once() -> Self {
        Self { last: KktResidual::unknown(), ..Self::of_plan(SqpStatus::Deadline, f64::NAN) }
    }

    /// A plan that is true to the model and was not optimized.
    pub(crate) fn of_plan(status: SqpStatus, cost: f64) -> Self {
        Self {
            status,
            iterations: 0,
            last: KktResidual { dynamics: 0.0, ..KktResidual::unknown() },
            violated: None,
            plan_state: PlanState::Evaluated,
            curvature_dropped: false,
            cost,
        }
    }
}

/// What is known of the plan that an optimization ends with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PlanState {
    /// The residual is the plan's own.
    Evaluated,
    /// The time was up when a QP had been solved: the plan is its solution, not linearized at.
    Stepped,
    /// The time was up within a QP: the plan is on the way to its solution.
    Partial,
}
