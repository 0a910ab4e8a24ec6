//! The estimation problem of a window, linearized.

use super::smoother::{Linear, Smoother};
use super::window::Window;
use crate::EstimateError;
use crate::matrix::{add_scaled, dot, factor};
use pinc_ode::{Dims, LinearizationBuffer, Model, OutputLinearizationBuffer, Stages};
use pinc_qp::{
    ChosenQp, Limits, Multipliers, OcpDims, Qp, QpMethod, QpSolver, QpStatus, QpStep, all_finite,
};

/// Above this mean multiplier the residuals are scaled down, as a controller's.
const LARGE_MULTIPLIER: f64 = 100.0;

/// The numbers that do not change: standard deviations, bounds and units, per state and
/// measurement.
#[derive(Clone, Debug)]
pub(super) struct Constants {
    pub(super) process_sd: Vec<f64>,
    pub(super) measurement_variance: Vec<f64>,
    pub(super) low: Vec<f64>,
    pub(super) high: Vec<f64>,
    /// The size in which a state is counted.
    pub(super) unit: Vec<f64>,
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
        last_u: &[f64],
        constants: &Constants,
    ) -> Point {
        let Dims { nx: n, nu, np, .. } = self.dims;
        let steps = self.qp.dims.horizon - 1;
        let at = Stages {
            x: &window.x[..steps * n],
            u: &window.u[..steps * nu],
            p: &window.p[..steps * np],
        };
        model.linearize(at, self.model.as_mut());
        for j in 0..=steps {
            // Measured before the input changes: with the one that led there.
            let u = match j {
                last if last == steps => last_u,
                0 => &window.before[..],
                j => &window.u[(j - 1) * nu..j * nu],
            };
            let p = &window.p[j * np..(j + 1) * np];
            let at = Stages { x: &window.x[j * n..(j + 1) * n], u, p };
            model.linearize_output(at, self.outputs.as_mut().point(j, self.dims));
        }
        self.write_dynamics(window, constants);
        self.cost = self.write_cost(window, constants);
        self.write_bounds(window, constants);
        self.judge()
    }

    fn write_dynamics(&mut self, window: &Window, constants: &Constants) {
        let n = self.dims.nx;
        let unit = &constants.unit;
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
                self.defects[j * n + i] = (expected[i] - x[i]) / unit[i];
                self.qp.c[j * n + i] = self.defects[j * n + i] + noise / unit[i];
            }
        }
        let scaled = self.qp.a[n * n..].chunks_exact_mut(n * n);
        for (to, from) in scaled.zip(self.model.a.chunks_exact(n * n)) {
            for (i, (to, from)) in to.chunks_exact_mut(n).zip(from.chunks_exact(n)).enumerate() {
                for (j, (to, from)) in to.iter_mut().zip(from).enumerate() {
                    *to = from * (unit[j] / unit[i]);
                }
            }
        }
    }

    /// Writes the cost's gradient, and the Jacobian of what is measured in units of the states;
    /// gives the cost.
    fn write_cost(&mut self, window: &Window, constants: &Constants) -> f64 {
        let Dims { nx: n, ny, .. } = self.dims;
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

    fn write_bounds(&mut self, window: &Window, constants: &Constants) {
        let n = self.dims.nx;
        let Limits { low, high, .. } = &mut self.qp.bounds;
        let count = self.qp.dims.horizon * n;
        let limits = low.iter_mut().zip(high).take(count).zip(&window.x);
        for (i, ((low, high), x)) in limits.enumerate() {
            *low = (constants.low[i % n] - x) / constants.unit[i % n];
            *high = (constants.high[i % n] - x) / constants.unit[i % n];
        }
    }

    /// The residuals of the optimality conditions where the program is linearized. As in a
    /// controller, those that grow with the multipliers are counted by the size of these.
    fn judge(&mut self) -> Point {
        let cost = self.cost;
        let Self { qp, multipliers, work, .. } = self;
        qp.lagrangian_gradient(multipliers, work);
        let largest = |values: &[f64]| {
            values
                .iter()
                .fold(0.0, |m: f64, v| if v.is_nan() { f64::INFINITY } else { m.max(v.abs()) })
        };
        let stationarity = largest(work);
        let (mut outside, mut product) = (0.0_f64, 0.0_f64);
        let mut violation: f64 = qp.c.iter().map(|c| c.abs()).sum();
        for ([low, high, _], &mu) in qp.bounds.iter().zip(&multipliers.bounds) {
            let beyond = low.max(-high).max(0.0);
            outside = outside.max(beyond);
            violation += beyond;
            if mu.abs() > 0.0 {
                product = product.max(mu.abs() * if mu > 0.0 { high } else { -low }.max(0.0));
            }
        }
        let all = multipliers.dynamics.iter().chain(&multipliers.bounds);
        let (sum, count) = all.fold((0.0, 0.0), |(sum, count), mu| (sum + mu.abs(), count + 1.0));
        let scale = (sum / count / LARGE_MULTIPLIER).max(1.0);
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
