//! The distance of a plan from optimality.

#[cfg(test)]
mod tests;

use crate::solution::Solution;
use pinc_qp::{Limits, Qp, largest, residual_scale};

/// The residuals of the conditions of Karush, Kuhn and Tucker, of the nonlinear problem itself (see
/// [`Solution`] for its Lagrangian L): largest absolute values, in the problem's units where its quantities are
/// of ordinary size (1/16 to 1024). Other quantities, as their bounds or
/// [`NmpcProblem::state_sizes`](crate::NmpcProblem::state_sizes) tell their size, are counted in a power of 2
/// of which that size is 8 to 16; so is the cost, where its weights are not ordinary numbers.
///
/// Scaling: stationarity and complementarity grow with the cost, whose unit is arbitrary. As in
/// IPOPT both are divided by s = max(1, mean |multiplier| / 100) (see [`residual_scale`]), which is
/// 1 for weights of ordinary size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KktResidual {
    /// `dL/dz`, divided by s; also by how much a multiplier is above the weight of its violation.
    pub stationarity: f64,
    /// `f(x_j, u_j) - x_{j+1}`.
    pub dynamics: f64,
    /// By how much a state, an input, an increment, h or g is outside its limits, soft ones apart.
    pub bounds: f64,
    /// Multiplier times distance to its limit, divided by s. Of a soft constraint that is violated:
    /// violation times what the multiplier lacks of the violation's weight. Distances and violations
    /// count from 1e-11 on, which is what rounding leaves.
    pub complementarity: f64,
}

impl KktResidual {
    /// The residuals at the point `at`, where `qp` is the problem linearized there. `work` is as long as z.
    pub(crate) fn new(qp: &Qp, at: &Solution, work: &mut [f64]) -> Self {
        let multipliers = &at.multipliers;
        qp.lagrangian_gradient(multipliers, work);
        let mut worst = Worst { stationarity: largest(work), violation: 0.0, product: 0.0 };
        worst.see(&qp.bounds, &multipliers.bounds);
        worst.see(&qp.increments, &multipliers.increments);
        worst.see(&qp.rows, &multipliers.rows);
        let scale = residual_scale(multipliers.parts());
        Self {
            stationarity: worst.stationarity / scale,
            dynamics: largest(&qp.c),
            bounds: worst.violation,
            complementarity: worst.product / scale,
        }
    }

    /// The same; all are infinite where the cost has no value, which its derivatives may have.
    pub(crate) fn with_cost(cost: f64, qp: &Qp, at: &Solution, work: &mut [f64]) -> Self {
        if cost.is_finite() { Self::new(qp, at, work) } else { Self::unknown() }
    }

    /// The residuals of a point where nothing is known: all infinite.
    pub(crate) fn unknown() -> Self {
        let all = f64::INFINITY;
        Self { stationarity: all, dynamics: all, bounds: all, complementarity: all }
    }

    /// The largest of the residuals; infinity if one is not a number.
    #[must_use]
    pub fn max(&self) -> f64 {
        let Self { stationarity, dynamics, bounds, complementarity } = *self;
        largest(&[stationarity, dynamics, bounds, complementarity])
    }
}

/// What rounding leaves of distances and violations: times multipliers and weights of 1e5, it would be
/// above any tolerance that is of use.
const ROUNDING: f64 = 1e-11;

/// The residuals of rows with limits.
struct Worst {
    stationarity: f64,
    violation: f64,
    product: f64,
}

impl Worst {
    /// Takes the rows of one kind into account; their values are 0, seen from the limits. Rows within
    /// their limits and without a multiplier, nearly all, do not count.
    fn see(&mut self, limits: &Limits, multipliers: &[f64]) {
        let counts = |low: f64, high: f64, mu: f64| !((low <= 0.0) & (high >= 0.0) & (mu == 0.0));
        limits.find(multipliers, counts, |row, [low, high, mu]| {
            self.take([low, high, limits.penalty[row]], mu);
        });
    }

    fn take(&mut self, [low, high, penalty]: [f64; 3], mu: f64) {
        let outside = more(0.0, more(low, -high));
        let room = more(0.0, if mu > 0.0 { high } else { -low });
        // No 0 times infinity, where there is no limit.
        let product = if mu.abs() > 0.0 { mu.abs() * beyond_rounding(room) } else { 0.0 };
        self.product = worse(self.product, product);
        if penalty.is_finite() {
            let product = beyond_rounding(outside) * more(0.0, penalty - mu.abs());
            self.product = worse(self.product, product);
            self.stationarity = worse(self.stationarity, mu.abs() - penalty);
        } else {
            self.violation = worse(self.violation, outside);
        }
    }
}

/// A distance to a limit, 0 if rounding may have left it.
#[inline(always)]
fn beyond_rounding(distance: f64) -> f64 {
    if distance > ROUNDING { distance } else { 0.0 }
}

/// The larger of the two; infinity if `value` is NaN.
fn worse(largest: f64, value: f64) -> f64 {
    if value.is_nan() { f64::INFINITY } else { more(largest, value) }
}

/// The larger of the two, the first if one is NaN: one instruction, which `f64::max` is not.
#[inline(always)]
fn more(a: f64, b: f64) -> f64 {
    if b > a { b } else { a }
}
