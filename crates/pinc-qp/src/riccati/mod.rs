//! The path for long horizons, on the structure of the stages.

mod active_rows;
mod barrier;
mod chains;
mod interior_point;
mod newton;
mod recursion;
mod rows;
mod side;
#[cfg(test)]
mod tests;

use self::active_rows::{ActiveRows, Patience};
pub use self::barrier::Barrier;
use self::interior_point::{Ending, InteriorPoint};
use self::newton::Newton;
use super::{CondensedQp, Qp, QpSolver, QpStatus, QpStep, QpWork};

/// How much the active rows of a guess may take: a good one needs a few steps, and what needs more
/// than this is cheaper for the interior-point method, which takes about as many, ..
const FIRST: Patience = Patience { steps: 24, relapse: 2 };

/// .. or for condensing, which takes less time than that.
const FIRST_OF_FEW: Patience = Patience { steps: 12, relapse: 1 };

/// Solves a [`Qp`] stage by stage, at a cost linear in the horizon.
///
/// With a guess of the active rows, as from the step before, a few factorizations find the
/// solution. Without, or where that does not settle soon, an interior-point method comes near it,
/// and its active rows are the guess that gives the exact solution. What that cannot solve is left
/// to the first guess again, without haste. All memory is allocated at construction.
#[derive(Debug)]
pub(super) struct RiccatiQp {
    newton: Newton,
    active: ActiveRows,
    interior: InteriorPoint,
    /// What solves programs without a good guess, in place of the interior point.
    from_scratch: Option<CondensedQp>,
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
            from_scratch: None,
        }
    }

    /// Adds another method for programs without a good guess of the active rows; programs on which
    /// it fails are left to the interior point.
    pub(super) fn with_from_scratch(self, from_scratch: Option<CondensedQp>) -> Self {
        Self { from_scratch, ..self }
    }

    /// Solves from d = 0 and the multipliers of `step`, as long as there is patience.
    fn solve_from_guess(
        &mut self,
        qp: &Qp,
        step: &QpStep,
        patience: Patience,
        expired: &mut dyn FnMut() -> bool,
    ) -> bool {
        self.newton.start(step);
        self.guess.copy_from_slice(&self.newton.mu);
        self.resolve(qp, patience, expired)
    }

    /// Solves from the guess and the point that there are.
    fn resolve(&mut self, qp: &Qp, patience: Patience, expired: &mut dyn FnMut() -> bool) -> bool {
        self.active.guess(qp, &self.guess);
        self.active.solve(qp, &mut self.newton, patience, expired)
    }
}

impl QpSolver for RiccatiQp {
    fn solve(&mut self, qp: &Qp, step: &mut QpStep, expired: &mut dyn FnMut() -> bool) -> QpStatus {
        let mut late = false;
        let expired = &mut || {
            late = late || expired();
            late
        };
        let patience = if self.from_scratch.is_some() { FIRST_OF_FEW } else { FIRST };
        if self.solve_from_guess(qp, step, patience, expired) {
            self.newton.finish(step);
            return QpStatus::Solved;
        }
        if expired() {
            self.active.note(qp, &mut self.newton.mu);
            self.newton.finish(step);
            return QpStatus::Expired;
        }
        if let Some(condensed) = &mut self.from_scratch {
            match condensed.solve(qp, step, expired) {
                QpStatus::Failed => {}
                QpStatus::Solved if !self.newton.is_solved_by(qp, step) => {
                    if self.solve_from_guess(qp, step, FIRST, expired) {
                        self.newton.finish(step);
                        return QpStatus::Solved;
                    }
                }
                status => return status,
            }
        }
        let solved = match self.interior.solve(qp, &mut self.newton, expired) {
            Ending::Converged => {
                self.interior.active(&mut self.guess);
                self.resolve(qp, Patience::ENDLESS, expired)
            }
            Ending::Infeasible(row) => {
                let upper = self.newton.mu[row] > 0.0;
                return QpStatus::Infeasible(self.newton.rows.row(row, upper));
            }
            Ending::Failed => false,
        };
        if solved || !expired() && self.solve_from_guess(qp, step, Patience::ENDLESS, expired) {
            self.newton.finish(step);
            QpStatus::Solved
        } else if expired() {
            self.interior.active(&mut self.newton.mu);
            self.newton.finish(step);
            QpStatus::Expired
        } else {
            QpStatus::Failed
        }
    }

    fn take_work(&mut self) -> QpWork {
        let mut work = std::mem::take(&mut self.active.work);
        work += std::mem::take(&mut self.interior.work);
        if let Some(condensed) = &mut self.from_scratch {
            work += condensed.take_work();
        }
        work
    }
}
