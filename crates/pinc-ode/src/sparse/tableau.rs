//! Explicit Runge-Kutta methods as tables of numbers.

use crate::dopri5;

/// The coefficients of an explicit Runge-Kutta method: row s has those by which the slopes before
/// it make stage s, and the last row those by which they make the result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tableau(&'static [&'static [f64]]);

impl Tableau {
    /// The classical method of order 4: see [`Classical`](crate::Classical).
    pub const CLASSICAL: Self = Self(&[
        &[],
        &[1.0 / 2.0],
        &[0.0, 1.0 / 2.0],
        &[0.0, 0.0, 1.0],
        &[1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0],
    ]);

    /// The solution of order 5 of the method of Dormand and Prince: see
    /// [`DormandPrince`](crate::DormandPrince).
    pub const DORMAND_PRINCE: Self = Self(&dopri5::A);

    /// Evaluations of the right-hand side in a step.
    pub(super) fn stages(self) -> usize {
        self.0.len() - 1
    }

    /// What makes stage `s` (from 1 on; the last is the result) in a step of `h` seconds: the
    /// factors of all slopes before the last one that are not 0, and of this one.
    pub(super) fn stage(self, s: usize, h: f64) -> Combination {
        let row = self.0[s];
        let scaled = |j: usize| (j, h * row[j]);
        let earlier = (0..s - 1).filter(|&j| row[j] != 0.0).map(scaled).collect();
        Combination { earlier, last: h * row[s - 1] }
    }
}

/// `x + sum_j factor_j k_j + last k`, with k the newest slope.
#[derive(Clone, Debug)]
pub(super) struct Combination {
    pub(super) earlier: Vec<(usize, f64)>,
    pub(super) last: f64,
}
