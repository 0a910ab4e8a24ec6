//! The merit function by which steps are shortened.

use pinc_qp::Multipliers;
use pinc_qp::OcpDims;
use pinc_qp::{Kind, Limits, Qp, QpStep, RowBlock};

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

    /// At most this is phi's slope along `step`, the solution of `qp`: g'd less all that the step
    /// mends.
    pub(crate) fn directional_derivative(&self, qp: &Qp, step: &QpStep) -> f64 {
        let along: f64 = qp.gradient.iter().zip(&step.d).map(|(g, d)| g * d).sum();
        along - (self.value(qp, 0.0) - residual_violation(qp, step))
    }
}

/// What the violations of soft rows cost at the point that `qp` is linearized at.
pub(crate) fn price_of_violations(qp: &Qp) -> f64 {
    qp.limits().into_iter().map(|(_, limits)| violations(limits, std::iter::repeat(&0.0))).sum()
}

/// How far 0 is outside, times the weights.
fn violations<'w>(limits: &Limits, weights: impl IntoIterator<Item = &'w f64>) -> f64 {
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

#[cfg(test)]
mod tests {
    use super::*;
    use pinc_qp::{ChosenQp, OcpDims, QpMethod, QpSolver, QpStatus};

    /// A program that starts outside everything: off its dynamics, a bound, an increment, a hard
    /// row, and three soft ones, of which two cannot be met at their prices.
    fn program() -> Qp {
        let dims = OcpDims {
            nx: 1,
            nu: 1,
            horizon: 2,
            n_controls: 2,
            n1: 1,
            inequalities: 2,
            equalities: 0,
            outputs: 0,
            feedthrough: 0,
            tree: pinc_qp::Tree::CHAIN,
        };
        let mut qp = Qp::new(dims, vec![2.0, 3.0], vec![1.0, 0.5]);
        (qp.a, qp.b, qp.c) = (vec![0.9, 1.2], vec![0.5, 0.8], vec![0.3, -0.4]);
        qp.gradient = vec![0.5, -1.0, 0.7, 0.2];
        (qp.bounds.low[0], qp.bounds.high[2]) = (0.1, 3.0);
        (qp.bounds.low[1], qp.bounds.penalty[1]) = (3.0, 0.2);
        qp.increments.low[1] = 0.05;
        qp.rows_x = vec![1.0, 0.5, -1.0, 0.0];
        qp.rows_u = vec![0.0, 1.0, 0.3, 1.0];
        qp.rows.high = vec![2.0, -0.2, -0.1, -4.0];
        qp.rows.penalty = vec![f64::INFINITY, 5.0, f64::INFINITY, 0.3];
        qp
    }

    /// The program at `t` of the step, whose gradient does not matter.
    fn moved(qp: &Qp, step: &QpStep, t: f64) -> Qp {
        let mut moved = qp.clone();
        moved.c.iter_mut().for_each(|c| *c *= 1.0 - t);
        let d = &step.d;
        for (limits, values) in [
            (&mut moved.bounds, d.clone()),
            (&mut moved.increments, vec![d[2], d[3] - d[2]]),
            (
                &mut moved.rows,
                (0..4).map(|r| qp.rows_x[r] * d[r / 2] + qp.rows_u[r] * d[3]).collect(),
            ),
        ] {
            for (i, value) in values.iter().enumerate() {
                limits.low[i] -= t * value;
                limits.high[i] -= t * value;
            }
        }
        moved
    }

    #[test]
    fn the_slope_matches_the_function() {
        let qp = program();
        let mut step = QpStep::new(qp.dims);
        let mut solver = ChosenQp::new(&qp, QpMethod::Condensed).unwrap();
        assert_eq!(solver.solve(&qp, &mut step, &mut || false), QpStatus::Solved);
        let mut merit = Merit::new(qp.dims);
        merit.update_penalties(&step.multipliers);
        let along: f64 = qp.gradient.iter().zip(&step.d).map(|(g, d)| g * d).sum();
        let t = 1e-3;
        let [before, after] = [0.0, t].map(|t| merit.value(&moved(&qp, &step, t), t * along));
        let slope = merit.directional_derivative(&qp, &step);
        assert!(slope < -0.1, "{slope}");
        // Every part is linear along the step until a limit is reached.
        assert!(((after - before) / t - slope).abs() < 1e-9, "{} {slope}", (after - before) / t);
    }

    /// Each violation counts with its weight: sigma, or the price of a soft row.
    #[test]
    fn all_violations_count() {
        let qp = program();
        let mut merit = Merit::new(qp.dims);
        let mut multipliers = Multipliers::new(qp.dims);
        // Powell's rule: at once up to 2, half the way down to 1, up to 4.
        for (multiplier, sigma) in [(2.0, 2.0), (1.0, 1.5), (-4.0, 4.0)] {
            multipliers.parts_mut().into_iter().flatten().for_each(|weight| *weight = multiplier);
            merit.update_penalties(&multipliers);
            // c: 0.3 + 0.4; bounds 0.1, and 3 at 0.2; increment 0.05; rows 0.2 at 5, 0.1, and 4 at
            // 0.3.
            let hard = sigma * (0.7 + 0.1 + 0.05 + 0.1);
            let expected = 7.0 + hard + 0.2 * 3.0 + 5.0 * 0.2 + 0.3 * 4.0;
            assert!((merit.value(&qp, 7.0) - expected).abs() < 1e-12, "{multiplier}");
        }
        merit.reset();
        assert!((merit.value(&qp, 7.0) - 9.8).abs() < 1e-12);
    }
}
