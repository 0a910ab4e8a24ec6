//! The proximal point method (Rockafellar, SIAM J. Control Optim. 14 (1976)) for singular Hessians.
//!
//! H is replaced by H + delta I with a small delta, and the minimum is sought again around each minimum
//! until x stays, which is a minimum of the program as it is.

use super::DenseQp;
use super::active_set::{ActiveSet, DenseStatus};
use crate::algebra::largest;

/// The proximal terms that a singular H is tried with, as parts of its largest entry: far enough above
/// what rounding leaves of a pivot that is 0.
const PROXIMAL: [f64; 3] = [1e-10, 1e-8, 1e-6];

/// The slope that the proximal term may leave, relative to 1 + the largest of g.
const SLOPE: f64 = 1e-11;

/// The part of the duality gap that is the slope times x, which may be large.
const GAP: f64 = 1e-10;

/// For a smaller gap the slope is lowered as long as a proximal point lowers it to less than this part.
const LOWERED: f64 = 0.1;

/// How many proximal points there are at most.
const CENTERS: usize = 30;

impl ActiveSet {
    /// Solves `qp` although the factor of its H failed, or too many digits were lost with it.
    pub(super) fn solve_singular(
        &mut self,
        qp: &DenseQp,
        expired: &mut dyn FnMut() -> bool,
    ) -> DenseStatus {
        self.changes = 0;
        match self.factor_singular(qp, expired) {
            Some(true) if self.start(qp, expired) => {}
            Some(false) => return DenseStatus::Failed,
            Some(true) | None => return DenseStatus::ExpiredAtStart,
        }
        let (mut slope, small) = (f64::INFINITY, SLOPE * (1.0 + largest(&qp.gradient)));
        for _ in 0..CENTERS {
            let status = self.meet_rows(qp, expired);
            if status != DenseStatus::Solved {
                return status;
            }
            let before = std::mem::replace(&mut slope, self.move_center(qp));
            let gap = slope * self.x.iter().map(|x| x.abs()).sum::<f64>();
            // Large multipliers leave more of a slope by rounding.
            let small = small.max(f64::EPSILON * largest(self.multipliers()));
            if slope <= small && (gap <= GAP || slope >= LOWERED * before) {
                return DenseStatus::Solved;
            }
            // After many changes of the working set its factors are made afresh.
            if self.changes > 2 * qp.unknowns {
                self.changes = 0;
                if !self.start(qp, expired) {
                    return DenseStatus::ExpiredAtStart;
                }
            } else {
                self.resolve(qp);
                self.drop_excessive(qp);
            }
        }
        DenseStatus::Failed
    }

    /// Factors H + delta I with the least delta with which it is positive definite; `false` if it is
    /// with none, `None` if the time was up before.
    fn factor_singular(&mut self, qp: &DenseQp, expired: &mut dyn FnMut() -> bool) -> Option<bool> {
        let diagonal = qp.hessian.iter().step_by(qp.unknowns + 1);
        let most = diagonal.fold(0.0_f64, |most, entry| entry.max(most));
        let size = if most > 0.0 { most } else { 1.0 };
        let mut factored = PROXIMAL.into_iter().map(|part| self.factor(qp, part * size, expired));
        factored.find(|factored| *factored != Some(false)).unwrap_or(Some(false))
    }

    /// Takes x for the next proximal point; the slope that the proximal term had there.
    fn move_center(&mut self, qp: &DenseQp) -> f64 {
        let moved = self.x.iter().zip(&self.center).map(|(x, center)| (x - center).abs());
        let slope = self.proximal * moved.fold(0.0, f64::max);
        self.center.copy_from_slice(&self.x);
        self.at_center.copy_from_slice(&self.values);
        qp.slope(&self.center, &mut self.linear);
        slope
    }
}
