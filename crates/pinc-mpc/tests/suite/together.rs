//! A constraint on two states in units of its own.

use pinc_ad::Scalar;
use pinc_mpc::StageConstraints;

/// No more than 20 in the two lower tanks together: x1 + x2 <= 20, with levels counted in numbers
/// so many times larger, and the row again in others.
#[derive(Debug)]
pub(crate) struct Together {
    pub(crate) x: f64,
    pub(crate) row: f64,
}

impl StageConstraints for Together {
    fn inequalities(&self) -> usize {
        1
    }

    fn evaluate<S: Scalar>(&self, x: &[S], _u: &[S], h: &mut [S], _g: &mut [S]) {
        h[0] = ((x[0] + x[1]) / self.x - 20.0) * self.row;
    }
}
