//! The elastic mode: hard constraints on states made soft where they contradict each other.

use super::hessian::Hessian;
use super::{Outcome, PlanState, Sqp};
use crate::SqpStatus;
use crate::kkt::KktResidual;
use crate::merit::limits_after;
use crate::solution::Solution;
use pinc_qp::{Kind, Qp, Row};

/// The weight of a violation where it cannot be avoided, in terms of the cost's largest slope and
/// curvature.
const ELASTIC_WEIGHT: f64 = 1e3;

impl Sqp {
    /// Makes the hard constraints on states soft.
    #[inline(never)]
    pub(super) fn enter_elastic(&mut self) {
        self.elastic = true;
        self.acceleration.reset();
        let qp = match self.hessian.current() {
            Hessian::GaussNewton => &self.qp,
            Hessian::Exact => &self.curved,
        };
        let size = |values: &[f64]| values.iter().fold(0.0_f64, |size, v| size.max(v.abs()));
        let parts = [&qp.gradient, &qp.q, &qp.r, &qp.t, &qp.w];
        let weight = ELASTIC_WEIGHT * parts.map(|part| size(part)).iter().sum::<f64>().max(1.0);
        let states = qp.dims.all_states();
        for qp in [&mut self.qp, &mut self.trial] {
            let rows = qp.bounds.penalty[..states].iter_mut().chain(&mut qp.rows.penalty);
            rows.filter(|penalty| penalty.is_infinite()).for_each(|penalty| *penalty = weight);
        }
    }

    /// Makes them as they were.
    pub(super) fn leave_elastic(&mut self) {
        if self.elastic {
            self.elastic = false;
            self.restore([true; 3]);
        }
    }

    /// Gives bounds on states, h and g, and bounds on outputs the penalties that the problem has.
    #[inline(never)]
    fn restore(&mut self, [states, general, outputs]: [bool; 3]) {
        for qp in [&mut self.qp, &mut self.trial] {
            let dims = qp.dims;
            if states {
                qp.bounds.penalty.copy_from_slice(&self.penalties[0]);
            }
            for (v, penalty) in qp.rows.penalty.iter_mut().enumerate() {
                let output = v % dims.rows() >= dims.general();
                if if output { outputs } else { general } {
                    *penalty = self.penalties[1][v];
                }
            }
        }
    }

    /// Gives a program in the plant's units the weights of violations that the last step needed.
    pub(crate) fn soften(&self, qp: &mut Qp) {
        let mut found = self.base.multipliers.clone();
        found.bounds.copy_from_slice(&self.qp.bounds.penalty);
        found.rows.copy_from_slice(&self.qp.rows.penalty);
        self.transcription.units.convert(&mut found, true);
        (qp.bounds.penalty, qp.rows.penalty) = (found.bounds, found.rows);
    }

    /// Judges the end by the problem's own hard constraints.
    pub(super) fn finalize(
        &mut self,
        mut outcome: Outcome,
        plan: &Solution,
        conflict: Option<Row>,
    ) -> Outcome {
        if self.elastic {
            self.restore(self.exact.map(|exact| !exact));
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
                if outcome.status == SqpStatus::Converged {
                    outcome.status = SqpStatus::InfeasibleQp;
                }
            }
        }
        if !outcome.last.max().is_finite() {
            outcome.status = SqpStatus::NumericalTrouble;
        }
        outcome
    }

    /// The hard row that the step violates most, of the QP at the plan and beyond the tolerance.
    pub(super) fn broken_by_step(&mut self) -> Option<Row> {
        // What the problem has as soft where it must be is not broken.
        self.restore(self.exact.map(|exact| !exact));
        let (excess, row) = worst_row(limits_after(&self.qp, &self.step.d))?;
        (excess > self.config.tolerance).then_some(row)
    }
}

/// The hard row of which 0 is furthest outside, and by how much.
fn worst_row(limits: impl Iterator<Item = (Kind, usize, [f64; 3])>) -> Option<(f64, Row)> {
    let hard = limits.filter(|(_, _, [_, _, penalty])| penalty.is_infinite());
    let rows = hard.map(|(kind, index, [low, high, _])| {
        (low.max(-high), Row { kind, index, upper: -high > low })
    });
    rows.max_by(|(a, _), (b, _)| a.total_cmp(b))
}
