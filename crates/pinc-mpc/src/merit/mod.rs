//! The merit function by which steps are shortened.

#[cfg(test)]
mod tests;

use pinc_qp::{Kind, Limits, Multipliers, OcpDims, Qp, QpStep, RowBlock};

/// The exact L1 merit function
///
/// ```text
/// phi = J + sum_i sigma_i |c_i| + sum_i w_i violation_i
/// ```
///
/// in which `w_i` is a soft row's penalty and a hard row's sigma. The weights sigma follow the
/// multipliers by Powell's rule, sigma <- max(|lambda|, (sigma + |lambda|)/2): never below them, so
/// that the QP's step is a direction of descent, and not stuck at what they once were. Reference:
/// Nocedal and Wright, *Numerical Optimization*, sections 15.4 and 18.3; Powell, "A fast algorithm
/// for nonlinearly constrained optimization calculations" (1978).
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

    /// phi at the point where the cost is `cost` and which `qp` is linearized at.
    pub(crate) fn value(&self, qp: &Qp, cost: f64) -> f64 {
        let weights = &self.weights;
        let defects: f64 = qp.c.iter().zip(&weights.dynamics).map(|(c, s)| s * c.abs()).sum();
        let violations = violations(&qp.bounds, &weights.bounds)
            + violations(&qp.increments, &weights.increments)
            + violations(&qp.rows, &weights.rows);
        cost + defects + violations
    }

    /// At most this is phi's slope along `step`, the solution of `qp`: g'd less all that the step mends.
    pub(crate) fn directional_derivative(&self, qp: &Qp, step: &QpStep) -> f64 {
        let along: f64 = qp.gradient.iter().zip(&step.d).map(|(g, d)| g * d).sum();
        along - (self.value(qp, 0.0) - residual_violation(qp, step))
    }
}

/// How far 0 is outside, times the weights.
pub(crate) fn violations<'w>(limits: &Limits, weights: impl IntoIterator<Item = &'w f64>) -> f64 {
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
    let excess = |(_, _, [low, high, penalty]): (Kind, usize, [f64; 3])| {
        if penalty.is_finite() { penalty * low.max(-high).max(0.0) } else { 0.0 }
    };
    limits_after(qp, &step.d).map(excess).sum()
}

/// What a step `d` leaves of the limits of all rows whose violation may be the step's, with their
/// kinds and indices: bounds on unknowns, and h, g and outputs. Those on increments are kept.
pub(crate) fn limits_after<'a>(
    qp: &'a Qp,
    d: &'a [f64],
) -> impl Iterator<Item = (Kind, usize, [f64; 3])> + 'a {
    let dims = qp.dims;
    let left = |value: f64, [low, high, penalty]: [f64; 3]| [low - value, high - value, penalty];
    let bounds = qp.bounds.iter().zip(d).enumerate();
    let values = dims.all_row_blocks().flat_map(move |RowBlock { rows, state, input }| {
        let (dx, du) = (dims.state(state).map(|state| &d[state]), &d[dims.input(input)]);
        let [by_x, by_u] = qp.row_jacobians(rows);
        let jacobians = by_x.chunks_exact(dims.nx).zip(by_u.chunks_exact(dims.nu));
        jacobians.map(move |(by_x, by_u)| dx.map_or(0.0, |dx| dot(by_x, dx)) + dot(by_u, du))
    });
    let rows = qp.rows.iter().zip(values).enumerate();
    let bounds = bounds.map(move |(index, (limits, &d))| (Kind::Bound, index, left(d, limits)));
    bounds.chain(rows.map(move |(index, (limits, v))| (Kind::Row, index, left(v, limits))))
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
