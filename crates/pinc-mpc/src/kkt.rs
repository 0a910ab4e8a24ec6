//! How far a plan is from optimal.

use crate::qp::Qp;
use crate::solution::Solution;

/// Above this mean multiplier the residuals that are proportional to the cost are scaled down.
const LARGE_MULTIPLIER: f64 = 100.0;

/// The residuals of the conditions of Karush, Kuhn and Tucker, of the nonlinear problem itself (see
/// [`Solution`] for its Lagrangian L): largest absolute values, in the problem's units.
///
/// Scaling: stationarity and complementarity grow with the cost, whose unit is arbitrary. As in
/// IPOPT (Waechter and Biegler, Math. Program. 106 (2006), Eq. 6) both are divided by
/// s = max(1, mean |multiplier| / 100), which is 1 for weights of ordinary size.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KktResidual {
    /// `dL/dz`, divided by s.
    pub stationarity: f64,
    /// `f(x_j, u_j) - x_{j+1}`.
    pub dynamics: f64,
    /// By how much a state or an input is outside its bounds.
    pub bounds: f64,
    /// Multiplier times distance to its bound, divided by s.
    pub complementarity: f64,
}

impl KktResidual {
    /// The residuals at the point `at`, where `qp` is the problem linearised there. `work` is as
    /// long as z.
    pub(crate) fn new(qp: &Qp, at: &Solution, work: &mut [f64]) -> Self {
        lagrangian_gradient(qp, at, work);
        let scale = scale(at);
        let room = || qp.room.low.iter().zip(&qp.room.high);
        let products = at.mu.iter().zip(room()).map(|(&mu, (low, high))| {
            if mu > 0.0 {
                mu * high
            } else if mu < 0.0 {
                mu * low
            } else {
                0.0
            }
        });
        Self {
            stationarity: largest(work.iter().copied()) / scale,
            dynamics: largest(qp.c.iter().copied()),
            bounds: largest(room().map(|(low, high)| low.max(-high).max(0.0))),
            complementarity: largest(products) / scale,
        }
    }

    /// The largest of the residuals; infinity if one is not a number.
    #[must_use]
    pub fn max(&self) -> f64 {
        let Self { stationarity, dynamics, bounds, complementarity } = *self;
        largest([stationarity, dynamics, bounds, complementarity].into_iter())
    }
}

/// Writes dL/dz into `gradient`.
fn lagrangian_gradient(qp: &Qp, at: &Solution, gradient: &mut [f64]) {
    let shape = qp.shape;
    for ((sum, g), mu) in gradient.iter_mut().zip(&qp.gradient).zip(&at.mu) {
        *sum = g + mu;
    }
    for j in 0..shape.stages {
        let lambda = &at.lambda[shape.next_state(j)];
        for (sum, lambda) in gradient[shape.next_state(j)].iter_mut().zip(lambda) {
            *sum -= lambda;
        }
        if let Some(state) = shape.state(j) {
            add_transposed(qp.a(j), lambda, &mut gradient[state]);
        }
        add_transposed(qp.b(j), lambda, &mut gradient[shape.input(shape.acting(j))]);
    }
}

/// sum += matrix' vector
fn add_transposed(matrix: &[f64], vector: &[f64], sum: &mut [f64]) {
    for (row, factor) in matrix.chunks_exact(sum.len()).zip(vector) {
        for (sum, entry) in sum.iter_mut().zip(row) {
            *sum += entry * factor;
        }
    }
}

fn scale(at: &Solution) -> f64 {
    let sum: f64 = at.lambda.iter().chain(&at.mu).map(|l| l.abs()).sum();
    #[expect(clippy::cast_precision_loss, reason = "far below 2^53 multipliers")]
    let count = (at.lambda.len() + at.mu.len()) as f64;
    (sum / count / LARGE_MULTIPLIER).max(1.0)
}

/// The largest absolute value; infinity if there is a NaN, which `f64::max` would drop.
fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(
        0.0,
        |largest, value| {
            if value.is_nan() { f64::INFINITY } else { largest.max(value.abs()) }
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_nan_is_not_lost() {
        assert!(largest([1.0, f64::NAN, 2.0].into_iter()).is_infinite());
        assert!((largest([1.0, -3.0, 2.0].into_iter()) - 3.0).abs() < 1e-15);
    }
}
