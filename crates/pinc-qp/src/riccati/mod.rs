//! The path for long horizons, on the structure of the stages.

mod active_rows;
mod interior_point;
mod newton;
mod recursion;
mod rows;

use self::active_rows::ActiveRows;
use self::interior_point::{Ending, InteriorPoint};
use self::newton::Newton;
use super::{Qp, QpSolver, QpStatus, QpStep};

/// How many steps the active rows of a guess may take: a good one needs a few, and what needs more
/// than this is cheaper for the interior-point method, which takes about as many.
const FIRST_STEPS: usize = 24;

/// Solves a [`Qp`] stage by stage, at a cost linear in the horizon.
///
/// With a guess of the active rows, as from the step before, a few factorisations find the
/// solution. Without, or where that does not settle soon, an interior-point method comes near it,
/// and its active rows are the guess that gives the exact solution. What that cannot solve is left
/// to the first guess again, without haste. All memory is allocated at construction.
#[derive(Debug)]
pub(super) struct RiccatiQp {
    newton: Newton,
    active: ActiveRows,
    interior: InteriorPoint,
    /// The multipliers that say which rows are active.
    guess: Vec<f64>,
}

impl RiccatiQp {
    /// A solver for QPs of the sizes of `qp` with its Hessian.
    pub(super) fn new(qp: &Qp) -> Self {
        let newton = Newton::new(qp.dims);
        Self {
            guess: vec![0.0; newton.rows.len()],
            newton,
            active: ActiveRows::new(qp),
            interior: InteriorPoint::new(qp),
        }
    }

    /// Solves from d = 0 and the multipliers of `step`, in at most so many steps.
    fn solve_from_guess(
        &mut self,
        qp: &Qp,
        step: &QpStep,
        steps: usize,
        expired: &mut dyn FnMut() -> bool,
    ) -> bool {
        self.newton.start(step);
        self.guess.copy_from_slice(&self.newton.mu);
        self.resolve(qp, steps, expired)
    }

    /// Solves from the guess and the point that there are, in at most so many steps.
    fn resolve(&mut self, qp: &Qp, steps: usize, expired: &mut dyn FnMut() -> bool) -> bool {
        let guess = &self.guess;
        self.active.guess(qp, |row| guess[row]);
        self.active.solve(qp, &mut self.newton, steps, expired)
    }
}

impl QpSolver for RiccatiQp {
    fn solve(&mut self, qp: &Qp, step: &mut QpStep, expired: &mut dyn FnMut() -> bool) -> QpStatus {
        let mut late = false;
        let expired = &mut || {
            late = late || expired();
            late
        };
        if self.solve_from_guess(qp, step, FIRST_STEPS, expired) {
            self.newton.finish(step);
            return QpStatus::Solved;
        }
        if expired() {
            self.active.note(qp, &mut self.newton.mu);
            self.newton.rows.write(&self.newton.mu, &mut step.multipliers);
            return QpStatus::Expired;
        }
        let solved = match self.interior.solve(qp, &mut self.newton, expired) {
            Ending::Converged => {
                self.interior.active(&mut self.guess);
                self.resolve(qp, usize::MAX, expired)
            }
            Ending::Infeasible(row) => {
                let upper = self.newton.mu[row] > 0.0;
                return QpStatus::Infeasible(self.newton.rows.row(row, upper));
            }
            Ending::Failed => false,
        };
        if solved || !expired() && self.solve_from_guess(qp, step, usize::MAX, expired) {
            self.newton.finish(step);
            QpStatus::Solved
        } else if expired() {
            QpStatus::Expired
        } else {
            QpStatus::Failed
        }
    }
}
