//! The elastic mode: hard constraints on states made soft where they contradict each other.

use super::{Outcome, Sqp, Standing};
use crate::SqpStatus;
use crate::constraint::Constraint;
use crate::kkt::KktResidual;
use crate::solution::Solution;
use pinc_qp::Row;

/// The weight of a violation where it cannot be avoided, in terms of the cost's largest slope and
/// curvature.
const ELASTIC_WEIGHT: f64 = 1e3;

impl Sqp {
    /// Makes the hard constraints on states soft.
    #[inline(never)]
    pub(super) fn enter_elastic(&mut self) {
        self.elastic = true;
        let qp = &self.qp;
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
                let output = v % dims.rows() >= dims.rows() - dims.outputs;
                if if output { outputs } else { general } {
                    *penalty = self.penalties[1][v];
                }
            }
        }
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
            outcome.last = match outcome.standing {
                Standing::Judged => self.residual(plan),
                _ => KktResidual::new(&self.qp, &self.base, &mut self.work),
            };
            if outcome.last.bounds > self.config.tolerance {
                let named = conflict.map(|row| Constraint::new(self.qp.dims, row));
                outcome.violated = self.worst_row().or(named);
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

    /// The hard row that is violated most.
    fn worst_row(&self) -> Option<Constraint> {
        let rows = self.qp.limits().into_iter().flat_map(|(kind, limits)| {
            let hard =
                limits.iter().enumerate().filter(|(_, [_, _, penalty])| penalty.is_infinite());
            hard.map(move |(index, [low, high, _])| {
                (low.max(-high), Row { kind, index, upper: -high > low })
            })
        });
        let (_, row) = rows.max_by(|(a, _), (b, _)| a.total_cmp(b))?;
        Some(Constraint::new(self.qp.dims, row))
    }
}
