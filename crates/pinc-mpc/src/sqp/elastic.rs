//! The elastic mode: hard constraints on states made soft where they contradict each other.

use super::hessian::Hessian;
use super::{Outcome, PlanState, Sqp};
use crate::kkt::KktResidual;
use crate::merit::{limits_after, violations};
use crate::solution::Solution;
use crate::transcription::admit_given;
use crate::{NmpcProblem, Softness, SqpStatus};
use pinc_qp::{Kind, OcpDims, Qp, Row};

/// The weight of a violation where it cannot be avoided, in terms of the cost's largest slope and curvature.
const ELASTIC_WEIGHT: f64 = 1e3;

impl Sqp {
    /// Makes more of the hard constraints on states soft; false if all are.
    #[inline(never)]
    pub(super) fn soften_more(&mut self) -> bool {
        if !self.elastic.soften_more(&self.qp) {
            return false;
        }
        self.acceleration.reset();
        let qp = match self.hessian.current() {
            Hessian::GaussNewton => &self.qp,
            Hessian::Exact => &self.curved,
        };
        let size = |values: &[f64]| values.iter().fold(0.0_f64, |size, v| size.max(v.abs()));
        let parts = [&qp.gradient, &qp.q, &qp.r, &qp.t, &qp.w];
        let weight = ELASTIC_WEIGHT * parts.map(|part| size(part)).iter().sum::<f64>().max(1.0);
        let weight = self.weight.filter(|_| self.keeps_weight).unwrap_or(weight);
        self.weight = Some(weight);
        self.elastic.write(&mut self.qp, weight);
        self.elastic.write(&mut self.trial, weight);
        true
    }

    /// Keeps the weight of violations for the rest of the control step, whose plans are compared.
    pub(crate) fn keep_weight(&mut self) {
        self.keeps_weight = true;
    }

    /// Makes hard constraints as they were.
    pub(super) fn leave_elastic(&mut self) {
        self.elastic.leave([&mut self.qp, &mut self.trial]);
    }

    /// Gives a program in the plant's units the weights of violations that the last step needed.
    pub(crate) fn soften(&self, qp: &mut Qp) {
        let mut found = self.base.multipliers.clone();
        found.bounds.copy_from_slice(&self.qp.bounds.penalty);
        found.rows.copy_from_slice(&self.qp.rows.penalty);
        self.transcription.units.convert(&mut found, true);
        (qp.bounds.penalty, qp.rows.penalty) = (found.bounds, found.rows);
    }

    /// What violations of soft constraints cost at the last plan that was evaluated.
    pub(super) fn price_of_violations(&self) -> f64 {
        let limits = self.qp.limits().into_iter().filter(|_| self.is_soft);
        let price = limits.map(|(_, limits)| violations(limits, std::iter::repeat(&0.0))).sum();
        self.transcription.units.plain_cost(price)
    }

    /// Judges the end by the problem's own hard constraints, and adds to the cost what violations of soft
    /// ones cost.
    pub(super) fn finalize(
        &mut self,
        mut outcome: Outcome,
        plan: &Solution,
        conflict: Option<Row>,
    ) -> Outcome {
        if self.elastic.is_soft() {
            self.elastic.harden(&mut self.qp);
            admit_given(&mut self.qp);
            outcome.last = match outcome.plan_state {
                PlanState::Evaluated => self.residual(plan),
                PlanState::Stepped | PlanState::Partial => {
                    KktResidual::new(&self.qp, &self.base, &mut self.work)
                }
            };
            let tolerance = self.config.tolerance;
            if outcome.last.max() <= tolerance && outcome.status == SqpStatus::Stalled {
                outcome.status = SqpStatus::Converged;
            }
            if outcome.last.bounds > tolerance {
                let limits = self.qp.limits().into_iter().flat_map(|(kind, limits)| {
                    limits.iter().enumerate().map(move |(index, limits)| (kind, index, limits))
                });
                let worst = worst_row(limits).map(|(_, row)| row);
                outcome.violated = worst.or(conflict).map(|row| self.transcription.name(row));
                if matches!(outcome.status, SqpStatus::Converged | SqpStatus::Stalled) {
                    outcome.status = SqpStatus::InfeasibleQp;
                }
            }
        }
        outcome.cost += self.price_of_violations();
        if !outcome.last.max().is_finite() {
            outcome.status = SqpStatus::NumericalTrouble;
        }
        outcome
    }

    /// The hard row that the step violates most, of the QP at the plan and beyond the tolerance.
    pub(super) fn broken_by_step(&mut self) -> Option<Row> {
        // What the problem has as soft where it must be is not broken.
        self.elastic.harden(&mut self.qp);
        let (excess, row) = worst_row(limits_after(&self.qp, &self.step.d))?;
        (excess > self.config.tolerance).then_some(row)
    }
}

/// Which bounds and rows the problem has as soft where they have to be. How a plan ends is none of them.
pub(super) fn exact(problem: &NmpcProblem, dims: OcpDims) -> [Vec<bool>; 2] {
    let is_exact = |softness: &Softness| *softness == Softness::Exact;
    let states = is_exact(&problem.state_softness);
    let bounds = (0..dims.unknowns()).map(|v| {
        let at_end = v < dims.all_states() && dims.tree.depth(v / dims.nx + 1) == problem.horizon;
        states && !(at_end && problem.is_met_at_end(v % dims.nx))
    });
    let rows = (0..dims.all_rows()).map(|v| match v % dims.rows() < dims.general() {
        true => is_exact(&problem.constraint_softness),
        false => is_exact(&problem.output_softness),
    });
    [bounds.collect(), rows.collect()]
}

/// The hard row of which 0 is furthest outside, and by how much.
fn worst_row(limits: impl Iterator<Item = (Kind, usize, [f64; 3])>) -> Option<(f64, Row)> {
    let hard = limits.filter(|(_, _, [_, _, penalty])| penalty.is_infinite());
    let rows = hard.map(|(kind, index, [low, high, _])| {
        (low.max(-high), Row { kind, index, upper: -high > low })
    });
    rows.max_by(|(a, _), (b, _)| a.total_cmp(b))
}
