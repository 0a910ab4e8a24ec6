//! The merit function by which steps are shortened.

use pinc_qp::Multipliers;
use pinc_qp::OcpDims;
use pinc_qp::{Limits, Qp, QpStep};

/// The exact L1 merit function
///
/// ```text
/// phi = J + sum_i sigma_i |c_i| + sum_i w_i violation_i
/// ```
///
/// in which `w_i` is a soft row's penalty and a hard row's sigma. The weights sigma follow the
/// multipliers by Powell's rule, sigma <- max(|lambda|, (sigma + |lambda|)/2): never below them, so that the
/// QP's step is a direction of descent, and not stuck at what they once were. Reference: Nocedal and Wright,
/// *Numerical Optimization*, sections 15.4 and 18.3; Powell, "A fast algorithm for nonlinearly
/// constrained optimization calculations" (1978).
#[derive(Clone, Debug)]
pub(crate) struct Merit {
    weights: Multipliers,
}

impl Merit {
    pub(crate) fn new(dims: OcpDims) -> Self {
        Self { weights: Multipliers::new(dims) }
    }

    /// Forgets the weights.
    pub(crate) fn reset(&mut self) {
        self.weights.clear();
    }

    /// Makes the weights fit the multipliers of a QP.
    pub(crate) fn update_penalties(&mut self, multipliers: &Multipliers) {
        for (weights, multipliers) in self.weights.parts_mut().into_iter().zip(multipliers.parts())
        {
            for (sigma, multiplier) in weights.iter_mut().zip(multipliers) {
                let least = multiplier.abs();
                *sigma = least.max(0.5 * (*sigma + least));
            }
        }
    }

    /// phi at the point where the cost is `cost` and which `qp` is linearised at.
    pub(crate) fn value(&self, qp: &Qp, cost: f64) -> f64 {
        let weights = &self.weights;
        let defects: f64 = qp.c.iter().zip(&weights.dynamics).map(|(c, s)| s * c.abs()).sum();
        let violations = violations(&qp.bounds, &weights.bounds)
            + violations(&qp.increments, &weights.increments)
            + violations(&qp.rows, &weights.rows);
        cost + defects + violations
    }

    /// At most this is phi's slope along `step`, the solution of `qp`: g'd less all that the step
    /// mends.
    pub(crate) fn directional_derivative(&self, qp: &Qp, step: &QpStep) -> f64 {
        let along: f64 = qp.gradient.iter().zip(&step.d).map(|(g, d)| g * d).sum();
        along - (self.value(qp, 0.0) - residual_violation(qp, step))
    }
}

/// How far 0 is outside, times the weights.
fn violations(limits: &Limits, weights: &[f64]) -> f64 {
    let rows = limits.iter().zip(weights);
    rows.map(|([low, high, penalty], &sigma)| {
        let outside = low.max(-high).max(0.0);
        // No 0 times infinity, where the row is hard.
        if outside > 0.0 {
            outside * if penalty.is_finite() { penalty } else { sigma }
        } else {
            0.0
        }
    })
    .sum()
}

/// The cost of the violations that the step leaves in the soft rows.
fn residual_violation(qp: &Qp, step: &QpStep) -> f64 {
    let dims = qp.dims;
    let excess = |value: f64, [low, high, penalty]: [f64; 3]| {
        if penalty.is_finite() { penalty * (low - value).max(value - high).max(0.0) } else { 0.0 }
    };
    let mut sum: f64 = qp.bounds.iter().zip(&step.d).map(|(limits, &d)| excess(d, limits)).sum();
    if dims.rows() > 0 {
        for j in dims.constrained() {
            let (dx, du) = (&step.d[dims.next_state(j - 1)], &step.d[dims.input(dims.acting(j))]);
            let by_x = qp.rows_x(j).chunks_exact(dims.nx);
            let by_u = qp.rows_u(j).chunks_exact(dims.nu);
            for ((row, by_x), by_u) in dims.stage_rows(j).zip(by_x).zip(by_u) {
                let limits = [qp.rows.low[row], qp.rows.high[row], qp.rows.penalty[row]];
                sum += excess(dot(by_x, dx) + dot(by_u, du), limits);
            }
        }
    }
    sum
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
