//! The estimation problem of a window, linearized.

use super::smoother::{Linear, Smoother};
use super::window::Window;
use crate::EstimateError;
use crate::matrix::{add_scaled, dot, factor};
use pinc_ode::{Dims, LinearizationBuffer, Model, OutputLinearizationBuffer};
use pinc_qp::{
    ChosenQp, Limits, Multipliers, OcpDims, Qp, QpMethod, QpSolver, QpStatus, QpStep, all_finite,
    largest, residual_scale,
};

/// The numbers that do not change: standard deviations, bounds and units, per state and
/// measurement.
#[derive(Clone, Debug)]
pub(super) struct Constants {
    pub(super) process_sd: Vec<f64>,
    pub(super) measurement_variance: Vec<f64>,
    pub(super) low: Vec<f64>,
    pub(super) high: Vec<f64>,
    /// The size in which a state is counted, and its reciprocal.
    pub(super) unit: Vec<f64>,
    pub(super) per_unit: Vec<f64>,
    /// The unit of each state divided by that of each other, `[n, n]`.
    pub(super) ratios: Vec<f64>,
}

/// The estimation problem over a window of some length,
///
/// ```text
/// min  sum_j |v_j|^2 / 2 + sum_j |(y_j - h(x_j)) / r|^2 / 2
/// s.t. x_0 = prior + L v_0,  x_j = F(x_{j-1}, u_{j-1}) + q v_j,  low <= x_j <= high
/// ```
///
/// with L L' the covariance of the prior, linearized: a program of optimal control in which the
/// noises are the inputs, and the first of them leads from the prior to the first state.
#[derive(Debug)]
pub(super) struct Program {
    dims: Dims,
    qp: Qp,
    /// What solves it where no bound holds anything, and what where some do.
    smoother: Smoother,
    solver: ChosenQp,
    step: QpStep,
    /// The multipliers of the point at which the program is linearized.
    pub(super) multipliers: Multipliers,
    cost: f64,
    model: LinearizationBuffer,
    /// By stages.
    outputs: OutputLinearizationBuffer,
    /// Expected minus measured, `[stages, ny]`, NaN where nothing was.
    errors: Vec<f64>,
    /// The defects of the dynamics without noise, `[stages, n]`.
    defects: Vec<f64>,
    root: Vec<f64>,
    work: Vec<f64>,
}

/// How far from a solution a point is, and what it costs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Point {
    /// The largest residual of the optimality conditions.
    pub(super) kkt: f64,
    cost: f64,
    /// The sum of the violations of equations and bounds.
    violation: f64,
}

impl Program {
    pub(super) fn new(
        dims: Dims,
        steps: usize,
        constants: &Constants,
    ) -> Result<Self, EstimateError> {
        let (n, stages) = (dims.nx, steps + 1);
        // Nobody asks for Jacobians by what is known.
        let fixed = dims.with_parameters(0);
        let ocp = OcpDims::new(n, n, stages);
        let none = vec![0.0; stages * n * n];
        let mut qp = Qp::new(ocp, none.clone(), none).with_stage_cost();
        for t in qp.t.chunks_exact_mut(n * n) {
            t.iter_mut().step_by(n + 1).for_each(|diagonal| *diagonal = 1.0);
        }
        let bounded = stages * n;
        qp.bounds.low[..bounded].copy_from_slice(&constants.low.repeat(stages));
        qp.bounds.high[..bounded].copy_from_slice(&constants.high.repeat(stages));
        for b in qp.b[n * n..].chunks_exact_mut(n * n) {
            let sizes = constants.process_sd.iter().zip(&constants.unit);
            let diagonal = b.iter_mut().step_by(n + 1);
            diagonal.zip(sizes).for_each(|(b, (sd, unit))| *b = sd / unit);
        }
        Ok(Self {
            dims,
            smoother: Smoother::new(dims, stages),
            solver: ChosenQp::new(&qp, QpMethod::Auto)?,
            step: QpStep::new(ocp),
            multipliers: Multipliers::new(ocp),
            cost: 0.0,
            model: LinearizationBuffer::new(fixed, steps),
            outputs: OutputLinearizationBuffer::new(fixed, stages),
            errors: vec![0.0; stages * dims.ny],
            defects: vec![0.0; stages * n],
            root: vec![0.0; n * n],
            work: vec![0.0; ocp.unknowns()],
            qp,
        })
    }

    /// Begins at a window: takes its arrival cost. `false` if its covariance is none.
    pub(super) fn begin(&mut self, window: &Window, constants: &Constants) -> bool {
        let n = self.dims.nx;
        let (_, covariance) = window.arrival();
        if !factor(covariance, n, &mut self.root) {
            return false;
        }
        for (i, unit) in constants.unit.iter().enumerate() {
            for j in 0..n {
                self.qp.b[i * n + j] = self.root[i * n + j] / unit;
            }
        }
        true
    }

    /// The shifted multipliers of the window before.
    pub(super) fn shift(&mut self) {
        self.multipliers.shift(self.qp.dims);
    }

    /// Linearizes at the window's states and noises; gives what can be said of these.
    pub(super) fn linearize(
        &mut self,
        model: &mut dyn Model,
        window: &Window,
        constants: &Constants,
    ) -> Point {
        model.linearize(window.at_steps(), self.model.as_mut());
        model.linearize_output(window.at_measurements(), self.outputs.as_mut());
        // With constants the loops are unrolled.
        match self.dims.nx {
            2 => self.write(window, constants, 2),
            4 => self.write(window, constants, 4),
            6 => self.write(window, constants, 6),
            n => self.write(window, constants, n),
        }
    }

    /// Writes the program; gives what can be said of the window's states and noises.
    #[inline(always)]
    fn write(&mut self, window: &Window, constants: &Constants, n: usize) -> Point {
        self.write_dynamics(window, constants, n);
        self.cost = self.write_cost(window, constants, n);
        self.write_bounds(window, constants, n);
        self.judge(n)
    }

    #[inline(always)]
    fn write_dynamics(&mut self, window: &Window, constants: &Constants, n: usize) {
        let unit = &constants.per_unit;
        let (prior, _) = window.arrival();
        for j in 0..self.qp.dims.horizon {
            let (x, v) = (&window.x[j * n..(j + 1) * n], &window.v[j * n..(j + 1) * n]);
            let expected = match j.checked_sub(1) {
                None => prior,
                Some(before) => &self.model.next[before * n..(before + 1) * n],
            };
            for i in 0..n {
                let noise = if j == 0 {
                    dot(&self.root[i * n..(i + 1) * n], v)
                } else {
                    constants.process_sd[i] * v[i]
                };
                self.defects[j * n + i] = (expected[i] - x[i]) * unit[i];
                self.qp.c[j * n + i] = self.defects[j * n + i] + noise * unit[i];
            }
        }
        let scaled = self.qp.a[n * n..].chunks_exact_mut(n * n);
        for (to, from) in scaled.zip(self.model.a.chunks_exact(n * n)) {
            for ((to, from), ratio) in to.iter_mut().zip(from).zip(&constants.ratios[..n * n]) {
                *to = from * ratio;
            }
        }
    }

    /// Writes the cost's gradient, and the Jacobian of what is measured in units of the states;
    /// gives the cost.
    #[inline(always)]
    fn write_cost(&mut self, window: &Window, constants: &Constants, n: usize) -> f64 {
        let ny = self.dims.ny;
        let stages = self.qp.dims.horizon;
        let (by_x, by_v) = self.qp.gradient.split_at_mut(stages * n);
        by_x.fill(0.0);
        by_v.copy_from_slice(&window.v[..stages * n]);
        let mut cost = 0.5 * dot(by_v, by_v);
        for j in 0..stages {
            let gradient = &mut by_x[j * n..(j + 1) * n];
            for i in 0..ny {
                let h = &mut self.outputs.c[(j * ny + i) * n..(j * ny + i + 1) * n];
                h.iter_mut().zip(&constants.unit).for_each(|(h, unit)| *h *= unit);
                let y = window.y[j * ny + i];
                let error = if y.is_finite() { self.outputs.y[j * ny + i] - y } else { f64::NAN };
                self.errors[j * ny + i] = error;
                if y.is_finite() {
                    let weight = 1.0 / constants.measurement_variance[i];
                    cost += 0.5 * weight * error * error;
                    add_scaled(gradient, weight * error, h);
                }
            }
        }
        cost
    }

    /// Writes the cost's Hessian.
    fn write_hessian(&mut self, constants: &Constants) {
        let Dims { nx: n, ny, .. } = self.dims;
        self.qp.q.fill(0.0);
        for (place, error) in self.errors.iter().enumerate().filter(|(_, e)| !e.is_nan()) {
            let (j, weight) = (place / ny, 1.0 / constants.measurement_variance[place % ny]);
            debug_assert!(error.is_finite(), "the cost is finite");
            let h = &self.outputs.c[place * n..(place + 1) * n];
            let q = &mut self.qp.q[j * n * n..(j + 1) * n * n];
            for (q, entry) in q.chunks_exact_mut(n).zip(h).filter(|(_, entry)| **entry != 0.0) {
                add_scaled(q, weight * entry, h);
            }
        }
    }

    #[inline(always)]
    fn write_bounds(&mut self, window: &Window, constants: &Constants, n: usize) {
        let Limits { low, high, .. } = &mut self.qp.bounds;
        let stages = low.chunks_exact_mut(n).zip(high.chunks_exact_mut(n));
        for ((low, high), x) in stages.take(self.qp.dims.horizon).zip(window.x.chunks_exact(n)) {
            for i in 0..n {
                low[i] = (constants.low[i] - x[i]) * constants.per_unit[i];
                high[i] = (constants.high[i] - x[i]) * constants.per_unit[i];
            }
        }
    }

    /// Writes the gradient of the Lagrangian into `work`. B has but a diagonal after the first
    /// stage.
    #[inline(always)]
    fn lagrangian_gradient(&mut self, n: usize) {
        let Self { qp, multipliers: Multipliers { dynamics, bounds, .. }, work, .. } = self;
        for ((sum, g), mu) in work.iter_mut().zip(&qp.gradient).zip(&*bounds) {
            *sum = g + mu;
        }
        let (by_x, by_v) = work.split_at_mut(qp.dims.all_states());
        for (j, lambda) in dynamics.chunks_exact(n).enumerate() {
            let [a, b] = [&qp.a, &qp.b].map(|all| &all[j * n * n..(j + 1) * n * n]);
            let by_v = &mut by_v[j * n..(j + 1) * n];
            for (i, lambda) in lambda.iter().enumerate() {
                by_x[j * n + i] -= lambda;
                match j.checked_sub(1) {
                    None => add_scaled(by_v, *lambda, &b[i * n..(i + 1) * n]),
                    Some(before) => {
                        by_v[i] += lambda * b[i * n + i];
                        add_scaled(&mut by_x[before * n..j * n], *lambda, &a[i * n..(i + 1) * n]);
                    }
                }
            }
        }
    }

    /// The residuals of the optimality conditions where the program is linearized, scaled as a
    /// controller's ([`residual_scale`]).
    #[inline(always)]
    fn judge(&mut self, n: usize) -> Point {
        let cost = self.cost;
        self.lagrangian_gradient(n);
        let Self { qp, multipliers: Multipliers { dynamics, bounds, .. }, work, .. } = self;
        let stationarity = largest(work);
        let (mut outside, mut product) = (0.0_f64, 0.0_f64);
        let mut violation: f64 = qp.c.iter().map(|c| c.abs()).sum();
        let counts = |low: f64, high: f64, mu: f64| !((low <= 0.0) & (high >= 0.0) & (mu == 0.0));
        qp.bounds.find(bounds, counts, |_, [low, high, mu]| {
            let beyond = low.max(-high).max(0.0);
            outside = outside.max(beyond);
            violation += beyond;
            // No 0 times infinity, where there is no limit.
            if mu.abs() > 0.0 {
                product = product.max(mu.abs() * if mu > 0.0 { high } else { -low }.max(0.0));
            }
        });
        let scale = residual_scale([&dynamics[..], bounds]);
        let finite = all_finite(&[cost, violation, stationarity, product]);
        let kkt = (stationarity / scale).max(product / scale).max(largest(&qp.c)).max(outside);
        Point { kkt: if finite { kkt } else { f64::INFINITY }, cost, violation }
    }

    /// Solves the program where it is linearized.
    pub(super) fn solve(
        &mut self,
        window: &Window,
        constants: &Constants,
        expired: &mut dyn FnMut() -> bool,
    ) -> QpStatus {
        if !self.is_at_bound() && self.solve_unbounded(window, constants) {
            return QpStatus::Solved;
        }
        self.write_hessian(constants);
        self.step.multipliers.copy_from(&self.multipliers);
        let status = self.solver.solve(&self.qp, &mut self.step, expired);
        if status == QpStatus::Solved && !all_finite(&self.step.d) {
            return QpStatus::Failed;
        }
        status
    }

    /// Solves the program without its bounds; whether the solution keeps them, and thus is one of
    /// the program.
    fn solve_unbounded(&mut self, window: &Window, constants: &Constants) -> bool {
        let Self { qp, step, smoother, .. } = self;
        let (dx, dv) = step.d.split_at_mut(qp.dims.all_states());
        let linear = Linear {
            a: &qp.a,
            b: &qp.b,
            defects: &self.defects,
            h: &self.outputs.c,
            errors: &self.errors,
            variances: &constants.measurement_variance,
        };
        smoother.solve(linear, dx, dv, &mut step.multipliers.dynamics);
        dv.iter_mut().zip(&window.v).for_each(|(dv, v)| *dv -= v);
        step.multipliers.bounds.fill(0.0);
        let limits = qp.bounds.low.iter().zip(&qp.bounds.high);
        let inside = |(d, (low, high)): (&f64, (&f64, &f64))| low <= d && d <= high;
        all_finite(&step.d) && step.d.iter().zip(limits).all(inside)
    }

    /// Moves the window's states and noises by a part of the solution, from `x` and `v` on.
    pub(super) fn go(
        &mut self,
        part: f64,
        [x, v]: [&[f64]; 2],
        window: &mut Window,
        units: &[f64],
    ) {
        let count = self.qp.dims.all_states();
        let (dx, dv) = self.step.d.split_at(count);
        let moves = dx.iter().zip(units.iter().cycle());
        for ((x, base), (dx, unit)) in window.x.iter_mut().zip(x).zip(moves) {
            *x = base + part * dx * unit;
        }
        for ((v, base), dv) in window.v.iter_mut().zip(v).zip(dv) {
            *v = base + part * dv;
        }
    }

    /// Moves the multipliers a part of the way from `base` to the solution.
    pub(super) fn blend(&mut self, part: f64, base: &Multipliers) {
        let sides = base.parts().into_iter().zip(self.step.multipliers.parts());
        for (to, (base, new)) in self.multipliers.parts_mut().into_iter().zip(sides) {
            for (to, (base, new)) in to.iter_mut().zip(base.iter().zip(new)) {
                *to = base + part * (new - base);
            }
        }
    }

    /// The slope of the merit function, cost + `weight` times violation, along the solution.
    pub(super) fn slope(&self, at: Point, weight: f64) -> f64 {
        dot(&self.qp.gradient, &self.step.d) - weight * at.violation
    }

    /// The weight of violations above which the solution is a direction of descent.
    pub(super) fn penalty(&self) -> f64 {
        let parts = [&self.step.multipliers.dynamics, &self.step.multipliers.bounds];
        1.5 * parts.into_iter().flatten().fold(1.0, |m: f64, v| m.max(v.abs()))
    }

    /// The number of unknowns.
    pub(super) fn unknowns(&self) -> usize {
        self.qp.dims.unknowns()
    }

    /// The solution, in units of the states and standard deviations.
    pub(super) fn direction(&self) -> &[f64] {
        &self.step.d
    }

    /// Whether a state is held by a bound, as the multipliers say.
    pub(super) fn is_at_bound(&self) -> bool {
        self.multipliers.bounds.iter().any(|mu| mu.abs() > 0.0)
    }

    /// The cost where the program is linearized.
    pub(super) fn cost(&self) -> f64 {
        self.cost
    }

    /// The largest entry of the solution, in units of the states and standard deviations.
    pub(super) fn length(&self) -> f64 {
        self.step.d.iter().fold(0.0, |m: f64, v| m.max(v.abs()))
    }
}

impl Point {
    /// The merit function.
    pub(super) fn merit(self, weight: f64) -> f64 {
        self.cost + weight * self.violation
    }
}
