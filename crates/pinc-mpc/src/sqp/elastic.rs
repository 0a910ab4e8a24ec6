//! The elastic mode: hard constraints on states made soft where they contradict each other.

use super::{Outcome, Sqp, Standing};
use crate::SqpStatus;
use crate::constraint::Constraint;
use crate::kkt::KktResidual;
use crate::solution::Solution;
use pinc_qp::{Kind, Row};
use std::ops::Range;

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
                let worst = self.worst_row(|_, _| 0.0).map(|(_, row)| row);
                outcome.violated = worst.or(conflict).map(|row| Constraint::new(self.qp.dims, row));
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
        self.restore(self.exact.map(|exact| !exact));
        let (excess, row) = self.worst_row(|kind, index| self.moved(kind, index))?;
        (excess > self.config.tolerance).then_some(row)
    }

    /// By how much the step moves what a row limits.
    fn moved(&self, kind: Kind, index: usize) -> f64 {
        let (qp, d) = (&self.qp, &self.step.d);
        let dims = qp.dims;
        match kind {
            Kind::Bound => d[index],
            Kind::Increment => {
                let inputs = &d[dims.all_states()..];
                inputs[index] - index.checked_sub(dims.nu).map_or(0.0, |before| inputs[before])
            }
            Kind::Row => {
                let (j, row) = (dims.n1 + index / dims.rows(), index % dims.rows());
                let product = |rows: &[f64], part: Range<usize>| -> f64 {
                    let row = &rows[row * part.len()..][..part.len()];
                    row.iter().zip(&d[part]).map(|(a, b)| a * b).sum()
                };
                product(qp.rows_x(j), dims.next_state(j - 1))
                    + product(qp.rows_u(j), dims.input(dims.acting(j)))
            }
        }
    }

    /// The hard row that is violated most where rows have these values, and by how much.
    fn worst_row(&self, value: impl Fn(Kind, usize) -> f64) -> Option<(f64, Row)> {
        let rows = self.qp.limits().into_iter().flat_map(|(kind, limits)| {
            let hard =
                limits.iter().enumerate().filter(|(_, [_, _, penalty])| penalty.is_infinite());
            let value = &value;
            hard.map(move |(index, [low, high, _])| {
                let value = value(kind, index);
                let (below, above) = (low - value, value - high);
                (below.max(above), Row { kind, index, upper: above > below })
            })
        });
        rows.max_by(|(a, _), (b, _)| a.total_cmp(b))
    }
}
