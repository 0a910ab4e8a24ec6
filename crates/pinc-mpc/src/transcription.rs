//! From the control problem to quadratic programs: direct multiple shooting.

use crate::constraints::ConstraintWork;
use crate::cost::{Cost, Targets};
use crate::linearization_cache::LinearizationCache;
use crate::solution::Solution;
use crate::{Bounds, Constraints, NmpcProblem};
use pinc_ode::{Dims, Model};
use pinc_qp::OcpDims;
use pinc_qp::Qp;

/// The control problem in the unknowns z, and its linearisation.
#[derive(Debug)]
pub(crate) struct Transcription {
    dims: OcpDims,
    cost: Cost,
    /// Bounds on z.
    bounds: Bounds,
    /// Bounds on all increments.
    increments: Bounds,
    constraints: Option<Constraints>,
    work: ConstraintWork,
    cache: LinearizationCache,
}

impl Transcription {
    pub(crate) fn new(problem: &NmpcProblem, dims: OcpDims, sample_time_s: f64) -> Self {
        let states = problem.state_bounds.repeat(dims.horizon);
        let inputs = problem.input_bounds.repeat(dims.n_controls);
        let model = Dims::new(dims.nx, dims.nu);
        Self {
            dims,
            cost: Cost::new(problem, dims, sample_time_s),
            bounds: states.chain(inputs),
            increments: problem.increment_bounds.repeat(dims.n_controls),
            constraints: problem.constraints.clone(),
            work: ConstraintWork::new(model, dims.rows()),
            cache: LinearizationCache::new(dims),
        }
    }

    /// A QP with the numbers that stay: Hessian and penalties, and with limits that are finite where they are.
    pub(crate) fn qp(&self, problem: &NmpcProblem) -> Qp {
        let dims = self.dims;
        let cost = &self.cost;
        let mut qp = Qp::new(dims, cost.state_hessians(), cost.increment_hessians());
        qp.bounds.low.copy_from_slice(&self.bounds.low);
        qp.bounds.high.copy_from_slice(&self.bounds.high);
        for (v, penalty) in qp.bounds.penalty[..dims.all_states()].iter_mut().enumerate() {
            *penalty = problem.state_softness.penalty(v % dims.nx);
        }
        qp.increments.low.copy_from_slice(&self.increments.low);
        qp.increments.high.copy_from_slice(&self.increments.high);
        for (v, penalty) in qp.rows.penalty.iter_mut().enumerate() {
            *penalty = problem.constraint_softness.penalty(v % dims.rows());
        }
        qp.rows.high.fill(0.0);
        for j in dims.constrained() {
            let equalities = dims.stage_rows(j).skip(dims.inequalities);
            equalities.for_each(|row| qp.rows.low[row] = 0.0);
        }
        qp
    }

    /// Moves the plan's inputs into their bounds and those of their increments. From outside its bounds an
    /// input may go as far as to the nearest. An input that is not finite becomes the one before it.
    pub(crate) fn project(&self, plan: &mut Solution, previous: &[f64]) {
        let first = self.dims.all_states();
        for v in 0..self.dims.all_inputs() {
            let before = self.before(v, &plan.z, previous);
            let (least, most) = (self.bounds.low[first + v], self.bounds.high[first + v]);
            let low = (before + self.increments.low[v]).min(most);
            let high = (before + self.increments.high[v]).max(least);
            let input = &mut plan.z[first + v];
            let wanted = if input.is_finite() { *input } else { before };
            // With a finite input before, low <= high.
            *input = wanted.max(low).min(high).max(least).min(most);
        }
    }

    /// The input before input `v` of all.
    fn before(&self, v: usize, z: &[f64], previous: &[f64]) -> f64 {
        match v.checked_sub(self.dims.nu) {
            None => previous[v],
            Some(before) => z[self.dims.all_states() + before],
        }
    }

    /// Linearises the model and h and g at `z`, for a plant measured to be at `x0`.
    pub(crate) fn linearize(&mut self, model: &mut dyn Model, x0: &[f64], z: &[f64], qp: &mut Qp) {
        self.cache.follow(model, x0, z);
        let [next, a, b] = self.cache.parts();
        qp.a.copy_from_slice(a);
        qp.b.copy_from_slice(b);
        for ((c, next), z) in qp.c.iter_mut().zip(next).zip(z) {
            *c = next - z;
        }
        self.linearize_constraints(z, qp);
    }

    /// Forgets where the model was linearised.
    pub(crate) fn forget(&mut self) {
        self.cache.forget();
    }

    /// Writes the cost's gradient at `z` and what is left of the bounds there into `qp`, and returns the
    /// cost J.
    pub(crate) fn measure(&self, z: &[f64], targets: Targets<'_>, qp: &mut Qp) -> f64 {
        self.limit(z, targets.previous, qp);
        self.cost.gradient(z, targets, &mut qp.gradient)
    }

    /// h and g: their values go, with the sign changed, to the limits.
    fn linearize_constraints(&mut self, z: &[f64], qp: &mut Qp) {
        let Some(constraints) = &self.constraints else { return };
        let dims = self.dims;
        let (n, m) = (dims.nx, dims.nu);
        for j in dims.constrained() {
            let (rows, x) = (dims.stage_rows(j), dims.next_state(j - 1));
            let u = dims.input(dims.acting(j));
            let by_x = &mut qp.rows_x[rows.start * n..rows.end * n];
            let by_u = &mut qp.rows_u[rows.start * m..rows.end * m];
            let values = &mut qp.rows.high[rows.clone()];
            constraints.linearize([&z[x], &z[u]], values, [by_x, by_u], &mut self.work);
            values.iter_mut().for_each(|value| *value = -*value);
            let equalities = rows.skip(dims.inequalities);
            equalities.for_each(|row| qp.rows.low[row] = qp.rows.high[row]);
        }
    }

    /// The limits of bounds and increments: what is left of them at z.
    fn limit(&self, z: &[f64], previous: &[f64], qp: &mut Qp) {
        for (v, &z) in z.iter().enumerate() {
            qp.bounds.low[v] = self.bounds.low[v] - z;
            qp.bounds.high[v] = self.bounds.high[v] - z;
        }
        let (first, m) = (self.dims.all_states(), self.dims.nu);
        for v in 0..self.dims.all_inputs() {
            let before = self.before(v, z, previous);
            let increment = z[first + v] - before;
            // The first input may always go as far as to its nearest bound.
            let reach = |bound: f64| if v < m { bound - before } else { 0.0 };
            let low = self.increments.low[v].min(reach(self.bounds.high[first + v]));
            let high = self.increments.high[v].max(reach(self.bounds.low[first + v]));
            qp.increments.low[v] = low - increment;
            qp.increments.high[v] = high - increment;
        }
    }
}
