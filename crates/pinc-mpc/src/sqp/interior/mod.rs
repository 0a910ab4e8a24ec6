//! The interior-point phase, for problems on which programs with active rows are slow.

#[cfg(test)]
mod tests;

use super::{Point, Sqp, StepInput};
use crate::SqpHessian;
use crate::curvature::Purpose;
use crate::horizon::Horizon;
use crate::kkt::KktResidual;
use crate::solution::Solution;
use pinc_ode::Memory;
use pinc_qp::{Barrier, OcpDims, Qp, QpWork};

/// So many programs are solved before they are slow enough.
const PATIENCE: usize = 32;
/// After a control step that needed the phase, so many begin with it.
const REPEATED: usize = 16;
/// tau at the beginning: from a plan that programs brought near, and from the last control step's, whose
/// active rows may not be those of the measured state; a small tau keeps the step from leaving them.
const TAU: [f64; 2] = [1e-2, 1e-1];
/// A phase that does not converge must bring the residual to this part of what it was.
const GAINED: f64 = 0.1;
/// The part of the promised decrease of the merit function that a step must bring.
const SUFFICIENT: f64 = 1e-4;
/// How often a step is halved.
const HALVINGS: usize = 30;
/// What rounding makes of the merit function, as part of it.
const NOISE: f64 = 1e-12;

/// The interior-point phase of the SQP.
///
/// Negative curvature of an economic cost is dropped to make a program convex, except along the rows that
/// stay active. Where each program has other active rows, the iteration converges slowly or not at all. A
/// barrier weighs all rows, active or not, so that less curvature has to be dropped: it finds a solution in
/// some 10 to 30 linearizations.
#[derive(Debug)]
pub(super) struct Interior {
    barrier: Barrier,
    /// The plan from which the phase starts.
    start: Solution,
    /// Whether it is still possible in this control step.
    possible: bool,
    need: Need,
}

/// How much the last control steps needed the phase.
#[derive(Clone, Copy, Debug, Default)]
struct Need {
    /// Whether programs were slow in this control step, and in the last one.
    now: bool,
    before: bool,
    /// How many control steps still begin with the phase.
    repeated: usize,
}

/// How the phase ended.
pub(super) enum Phase {
    /// With a better plan.
    Found(Point),
    /// The plan is as it was.
    Failed,
    /// The time is up.
    Expired(Point),
}

impl Interior {
    pub(super) fn new(qp: &Qp, dims: OcpDims) -> Self {
        let (barrier, start) = (Barrier::new(qp), Solution::new(dims));
        Self { barrier, start, possible: false, need: Need::default() }
    }

    /// A control step begins in which the phase is possible or not.
    pub(super) fn begin(&mut self, possible: bool) {
        self.possible = possible;
        self.need.begin();
    }

    /// Whether the phase is due, once in a control step, after so many programs, which are slow or not.
    pub(super) fn is_due(&mut self, programs: usize, slow: bool) -> bool {
        let due = self.possible && self.need.is_due(programs, slow);
        self.possible &= !due;
        due
    }

    /// The work since this was last asked.
    pub(super) fn take_work(&mut self) -> QpWork {
        self.barrier.take_work()
    }

    /// Forgets what the last control steps needed.
    pub(super) fn forget(&mut self) {
        self.need = Need::default();
    }

    /// Saves or restores what they needed.
    pub(super) fn remember(&mut self, memory: &mut Memory<'_>) {
        memory.flag(&mut self.need.now);
        memory.count(&mut self.need.repeated, REPEATED);
    }
}

impl Need {
    fn begin(&mut self) {
        self.before = std::mem::take(&mut self.now);
        self.repeated = self.repeated.saturating_sub(1);
    }

    fn is_due(&mut self, programs: usize, slow: bool) -> bool {
        self.now = self.repeated == 0 && programs >= PATIENCE && slow;
        self.now || self.repeated > 0
    }

    /// Two control steps that were slow are followed by some that begin with the phase, if that finds plans.
    fn end(&mut self, found: bool) {
        if !found {
            self.repeated = 0;
        } else if self.now && self.before {
            self.repeated = REPEATED;
        }
    }
}

impl Sqp {
    /// Leaves out the exact Hessian, and with it the phase.
    pub(crate) fn leave_out_exact_hessian(&mut self) {
        self.config.hessian = SqpHessian::GaussNewton;
        self.interior = None;
    }

    /// Goes on from the plan by the barrier method, to the tolerance or to the most iterations.
    #[inline(never)]
    pub(super) fn go_through_interior(
        &mut self,
        model: &mut Horizon,
        input: StepInput<'_>,
        plan: &mut Solution,
        (point, iterations): (Point, &mut usize),
        expired: &mut dyn FnMut() -> bool,
    ) -> Phase {
        let Some(mut interior) = self.interior.take() else { return Phase::Failed };
        let [near, shifted] = TAU;
        let tau = if *iterations == 0 { shifted } else { near };
        interior.start.copy_from(plan);
        interior.barrier.begin(&self.qp, &plan.multipliers, tau);
        interior.barrier.write(&mut plan.multipliers);
        let mut best = point;
        while best.kkt.max() > self.config.tolerance && *iterations < self.config.max_iterations {
            *iterations += 1;
            let from =
                self.interior_step(model, input, plan, (&mut interior.barrier, best), expired);
            match from {
                Some(next) => best = next,
                None => break,
            }
        }
        let phase = if best.kkt.max() <= self.config.tolerance.max(GAINED * point.kkt.max()) {
            Phase::Found(best)
        } else if expired() {
            Phase::Expired(best)
        } else {
            plan.copy_from(&interior.start);
            if self.try_point(model, input, plan, expired).is_some() {
                std::mem::swap(&mut self.qp, &mut self.trial);
                Phase::Failed
            } else {
                Phase::Expired(point)
            }
        };
        interior.need.end(matches!(phase, Phase::Found(_)));
        self.interior = Some(interior);
        phase
    }

    /// A step of the barrier method; `None` if there is none, or if the time is up.
    fn interior_step(
        &mut self,
        model: &mut Horizon,
        input: StepInput<'_>,
        plan: &mut Solution,
        (barrier, from): (&mut Barrier, Point),
        expired: &mut dyn FnMut() -> bool,
    ) -> Option<Point> {
        barrier.measure(&self.qp);
        barrier.lower_tau();
        self.curve(model, input, plan, (Purpose::Barrier, false), expired)?;
        let mut length = barrier.direct(&mut self.curved, &mut self.step.d, expired)?;
        let [start, slope] = barrier.begin_search(&self.qp, &self.step.d, from.cost);
        self.base.copy_from(plan);
        for _ in 0..HALVINGS {
            self.set_trial(plan, length, input.targets.previous);
            let Some(cost) = self.linearize_trial(model, input, plan, expired) else { break };
            let merit = barrier.merit(&self.trial, cost, length);
            if merit <= start + SUFFICIENT * length * slope + NOISE * start.abs() {
                barrier.advance(length);
                barrier.write(&mut plan.multipliers);
                std::mem::swap(&mut self.qp, &mut self.trial);
                let kkt = KktResidual::with_cost(cost, &self.qp, plan, &mut self.work);
                return Some(Point { kkt, cost });
            }
            length *= 0.5;
        }
        plan.copy_from(&self.base);
        None
    }
}
