//! A point with its multipliers, its residuals, and Newton steps from it.

use super::recursion::Riccati;
use super::rows::Rows;
use crate::algebra::{add_product, add_scaled, add_transposed, block, block_mut, dot, largest};
use crate::{OcpDims, Qp, QpStep};
use pinc_ad::simd::{Isa, Simd, Task};

/// A residual above this, relative to 1 + the largest multiplier, is more than rounding.
const ROUGH: f64 = 1e-10;

/// d, lambda and mu of a [`Qp`], the residuals of the optimality conditions there, and steps from
/// there:
///
/// ```text
/// H d + g + C'mu + E'lambda = 0        with E d + c = 0 for the dynamics
/// (H + C'D C) Dd + E'Dlambda = -(residual + C'terms),    E Dd = -residual
/// ```
///
/// Weights D and `terms` are the caller's, by which it says how the rows behave. That steps are
/// computed from the residuals, and not points anew, makes up for what D's large numbers cost in
/// digits.
#[derive(Debug)]
pub(super) struct Newton {
    pub(super) rows: Rows,
    isa: Isa,
    riccati: Riccati,
    pub(super) d: Vec<f64>,
    pub(super) lambda: Vec<f64>,
    /// mu, of all rows.
    pub(super) mu: Vec<f64>,
    /// C d
    pub(super) values: Vec<f64>,
    /// The residual of the first line.
    pub(super) slope: Vec<f64>,
    /// The residual of the dynamics.
    pub(super) defect: Vec<f64>,
    /// D
    pub(super) weights: Vec<f64>,
    pub(super) terms: Vec<f64>,
    right: Vec<f64>,
    /// Dd and Dlambda.
    step: [Vec<f64>; 2],
    /// C Dd
    pub(super) moved: Vec<f64>,
}

impl Newton {
    pub(super) fn new(dims: OcpDims) -> Self {
        let rows = Rows::new(dims);
        let list = || vec![0.0; rows.len()];
        let unknowns = || vec![0.0; dims.unknowns()];
        let dynamics = || vec![0.0; dims.all_states()];
        Self {
            rows,
            isa: Isa::detect(),
            riccati: Riccati::new(dims),
            d: unknowns(),
            lambda: dynamics(),
            mu: list(),
            values: list(),
            slope: unknowns(),
            defect: dynamics(),
            weights: list(),
            terms: list(),
            right: unknowns(),
            step: [unknowns(), dynamics()],
            moved: list(),
        }
    }

    /// Starts from d = 0 and the multipliers of `step`.
    pub(super) fn start(&mut self, step: &QpStep) {
        self.d.fill(0.0);
        self.lambda.copy_from_slice(&step.multipliers.dynamics);
        self.rows.read(&step.multipliers, &mut self.mu);
    }

    /// Whether `step` meets the conditions of optimality that are equations; where condensing multiplies
    /// unstable dynamics over many stages, rounding grows with them.
    pub(super) fn is_solved_by(&mut self, qp: &Qp, step: &QpStep) -> bool {
        self.start(step);
        self.d.copy_from_slice(&step.d);
        self.residuals(qp);
        let size = 1.0 + largest(&self.lambda).max(largest(&self.mu));
        largest(&self.slope).max(largest(&self.defect)) <= ROUGH * size
    }

    pub(super) fn finish(&self, step: &mut QpStep) {
        step.d.copy_from_slice(&self.d);
        step.multipliers.dynamics.copy_from_slice(&self.lambda);
        self.rows.write(&self.mu, &mut step.multipliers);
    }

    /// Computes values, slope and defect.
    pub(super) fn residuals(&mut self, qp: &Qp) {
        self.isa.dispatch(Residuals { newton: self, qp });
    }

    #[inline(always)]
    fn residuals_sized(&mut self, qp: &Qp, n: usize, m: usize) {
        self.rows.values(qp, &self.d, &mut self.values);
        self.slope.copy_from_slice(&qp.gradient);
        self.rows.add_transposed(qp, &self.mu, &mut self.slope);
        self.defect.copy_from_slice(&qp.c);
        let dims = qp.dims;
        let (states, inputs) = self.d.split_at(dims.all_states());
        let (by_x, by_u) = self.slope.split_at_mut(dims.all_states());
        for j in 0..dims.horizon {
            let (a, b) = (block(&qp.a, j, n * n), block(&qp.b, j, n * m));
            let (x, lambda) = (block(states, j, n), block(&self.lambda, j, n));
            let (origin, acting) = (dims.origin(j), dims.input_of(j));
            let defect = block_mut(&mut self.defect, j, n);
            add_scaled(defect, -1.0, x);
            add_product(b, block(inputs, acting, m), defect);
            let slope = block_mut(by_x, j, n);
            add_product(block(&qp.q, j, n * n), x, slope);
            add_scaled(slope, -1.0, lambda);
            add_transposed(b, lambda, block_mut(by_u, acting, m));
            if let Some(before) = origin.checked_sub(1) {
                add_product(a, block(states, before, n), defect);
                add_transposed(a, lambda, block_mut(by_x, before, n));
            }
        }
        self.add_stage_cost(qp);
        let (_, increments, _) = self.rows.split(&self.values);
        let inputs = &mut self.slope[dims.all_states()..];
        for (i, increment) in increments.chunks_exact(m).enumerate() {
            for (k, r) in block(&qp.r, i, m * m).chunks_exact(m).enumerate() {
                let force: f64 = r.iter().zip(increment).map(|(r, moved)| r * moved).sum();
                inputs[i * m + k] += force;
                if let Some(before) = dims.input_before(i) {
                    inputs[before * m + k] -= force;
                }
            }
        }
    }

    /// Adds what S, E and T contribute to the slope.
    fn add_stage_cost(&mut self, qp: &Qp) {
        let dims = qp.dims;
        if !qp.has_stage_cost() {
            return;
        }
        for j in 1..=dims.horizon {
            let state = dims.next_state(j - 1);
            for (input, s) in qp.cross(j) {
                let input = dims.input(input);
                add_product(s, &self.d[state.clone()], &mut self.slope[input.clone()]);
                add_transposed(s, &self.d[input], &mut self.slope[state.clone()]);
            }
        }
        for i in 0..dims.n_controls {
            if let Some(t) = qp.t(i) {
                add_product(t, &self.d[dims.input(i)], &mut self.slope[dims.input(i)]);
            }
        }
    }

    /// Factors with the weights as they are; `false` if that is impossible, or if `expired` says
    /// before the end that the time is up.
    pub(super) fn factor(&mut self, qp: &Qp, expired: &mut dyn FnMut() -> bool) -> bool {
        self.riccati.factor(qp, &self.weights, expired)
    }

    /// Computes the step from the residuals and the terms.
    pub(super) fn solve(&mut self, qp: &Qp) {
        self.right.copy_from_slice(&self.slope);
        self.rows.add_transposed(qp, &self.terms, &mut self.right);
        let [d, lambda] = &mut self.step;
        self.riccati.solve(qp, &self.right, &self.defect, d, lambda);
        self.rows.values(qp, d, &mut self.moved);
    }

    /// Chooses lambda such that C'terms + E'lambda = 0 for the states; gives the sum of what is
    /// left for the inputs, and lambda'c.
    pub(super) fn cancel(&mut self, qp: &Qp) -> (f64, f64) {
        let dims = qp.dims;
        self.right.fill(0.0);
        self.rows.add_transposed(qp, &self.terms, &mut self.right);
        let (states, inputs) = self.right.split_at_mut(dims.all_states());
        let mut offset = 0.0;
        for j in (0..dims.horizon).rev() {
            let (before, lambda) = states[..(j + 1) * dims.nx].split_at_mut(j * dims.nx);
            add_transposed(qp.b(j), lambda, block_mut(inputs, dims.input_of(j), dims.nu));
            if let Some(state) = dims.state(dims.origin(j)) {
                add_transposed(qp.a(j), lambda, &mut before[state]);
            }
            offset += dot(lambda, &qp.c[dims.next_state(j)]);
        }
        (inputs.iter().map(|input| input.abs()).sum(), offset)
    }

    /// Goes `length` times the step in d and lambda.
    pub(super) fn advance(&mut self, length: f64) {
        add_scaled(&mut self.d, length, &self.step[0]);
        self.advance_lambda(length);
    }

    /// lambda after the step times the residual of the dynamics.
    pub(super) fn price_of_defect(&self) -> f64 {
        dot(&self.lambda, &self.defect) + dot(&self.step[1], &self.defect)
    }

    /// Goes `length` times the step in lambda.
    pub(super) fn advance_lambda(&mut self, length: f64) {
        add_scaled(&mut self.lambda, length, &self.step[1]);
    }

    /// Dd
    pub(super) fn step(&self) -> &[f64] {
        &self.step[0]
    }
}

/// See [`Newton::residuals`].
struct Residuals<'a> {
    newton: &'a mut Newton,
    qp: &'a Qp,
}

impl Task for Residuals<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Simd>(self, _: V) {
        let Self { newton, qp } = self;
        sized!(qp.dims, |n, m| newton.residuals_sized(qp, n, m));
    }
}

/// How stiffly active rows are held, between the least and the greatest curvature of the cost in
/// the middle.
const STIFFNESS: f64 = 1e6;

/// A weight D that holds rows of `qp`: far above the curvatures of its cost, so that the method of
/// multipliers needs few steps, and not so far above the least of them that this would be lost to
/// rounding.
pub(super) fn stiffness(qp: &Qp) -> f64 {
    let OcpDims { nx: n, nu: m, .. } = qp.dims;
    let (mut least, mut most) = (f64::INFINITY, 0.0_f64);
    for (blocks, size) in [(&qp.q, n), (&qp.r, m), (&qp.t, m)] {
        for block in blocks.chunks_exact(size * size) {
            for &curvature in block.iter().step_by(size + 1).filter(|&&curvature| curvature > 0.0) {
                (least, most) = (curvature.min(least), curvature.max(most));
            }
        }
    }
    if most <= 0.0 {
        return STIFFNESS;
    }
    STIFFNESS * (least.max(1e-8 * most) * most).sqrt()
}
