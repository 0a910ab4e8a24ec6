//! The exact Hessian of the Lagrangian, in place of the Gauss-Newton Hessian.

use crate::convexify::Convexifier;
use crate::horizon::Horizon;
use crate::solution::Solution;
use crate::stage_cost::{QuadBlock, StagePoint};
use crate::stage_terms::StageTerms;
use crate::units::Units;
use pinc_ode::{LinearizationBuffer, Stages};
use pinc_qp::{OcpDims, Qp, all_finite};

/// A difference quotient is taken over this part of a variable's size: the cube root of the
/// precision.
const STEP: f64 = 6e-6;

/// The second derivatives of a stage's part of the Lagrangian,
///
/// ```text
/// l_j(x_j, u_j) + lambda_{j+1}' f(x_j, u_j)
/// ```
///
/// by differences of its gradient, which is exact. At a kink, where the difference quotients of the
/// two sides disagree, the smaller one counts.
#[derive(Debug)]
pub(crate) struct Curvature {
    dims: OcpDims,
    /// The point, and for each of (x, u) a point ahead and one behind: `[points, n]`, `[points, m]`.
    x: Vec<f64>,
    u: Vec<f64>,
    /// p at each, `[points, np]`.
    p: Vec<f64>,
    /// How far the points are apart.
    steps: Vec<f64>,
    /// The gradients at the points, `[points, n]` and `[points, m]`.
    by_x: Vec<f64>,
    by_u: Vec<f64>,
    model: LinearizationBuffer,
    block: QuadBlock,
    /// `[n + m, n + m]`
    hessian: Vec<f64>,
    convexifier: Convexifier,
    /// At how many points the model has been linearized.
    pub(crate) evaluated: usize,
}

/// Where second derivatives are taken.
pub(crate) struct At<'a> {
    pub(crate) x0: &'a [f64],
    pub(crate) plan: &'a Solution,
    /// p of each stage, `[N, np]`; at the end of the horizon the last ones hold.
    pub(crate) p: &'a [f64],
    pub(crate) units: &'a Units,
}

impl At<'_> {
    /// p of a stage.
    fn parameters(&self, dims: OcpDims, stage: usize) -> &[f64] {
        let (np, stage) = (self.p.len() / dims.horizon, stage.min(dims.horizon - 1));
        &self.p[stage * np..(stage + 1) * np]
    }
}

impl Curvature {
    pub(crate) fn new(dims: OcpDims, horizon: &Horizon) -> Self {
        let (s, model) = (dims.nx + dims.nu, horizon.dims());
        let points = 2 * s + 1;
        let zeros = |width: usize| vec![0.0; points * width];
        Self {
            dims,
            x: zeros(dims.nx),
            u: zeros(dims.nu),
            p: zeros(model.np),
            steps: vec![0.0; s],
            by_x: zeros(dims.nx),
            by_u: zeros(dims.nu),
            model: LinearizationBuffer::new(model, points),
            block: QuadBlock::new(dims.nx, dims.nu),
            hessian: vec![0.0; s * s],
            convexifier: Convexifier::new(dims),
            evaluated: 0,
        }
    }

    /// Adds the second derivatives of all stages to `qp`, which has those of the quadratic cost, and
    /// makes it convex, or `judges` whether the plan is a minimum. Whether negative curvature was
    /// dropped, or found; `None` if `expired` said that the time is up.
    pub(crate) fn add(
        &mut self,
        horizon: &mut Horizon,
        terms: &mut StageTerms,
        at: &At<'_>,
        qp: &mut Qp,
        judges: bool,
        expired: &mut dyn FnMut() -> bool,
    ) -> Option<bool> {
        for stage in 0..=self.dims.horizon {
            if expired() {
                return None;
            }
            self.spread(at, stage);
            self.differentiate(horizon, terms, at, stage);
            self.combine();
            if all_finite(&self.hessian) {
                self.add_block(stage, at.units, qp);
            }
        }
        Some(match judges {
            true => self.convexifier.finds_descent(qp, &at.plan.multipliers),
            false => self.convexifier.apply(qp),
        })
    }

    /// Writes the points of a stage.
    fn spread(&mut self, at: &At<'_>, stage: usize) {
        let (dims, s) = (self.dims, self.steps.len());
        let (n, m) = (dims.nx, dims.nu);
        let x = dims.state(stage).map_or(at.x0, |state| &at.plan.z[state]);
        let u = &at.plan.z[dims.input(dims.acting(stage))];
        let p = at.parameters(dims, stage);
        self.p.chunks_exact_mut(p.len().max(1)).for_each(|point| point.copy_from_slice(p));
        self.x.chunks_exact_mut(n).for_each(|point| point.copy_from_slice(x));
        self.u.chunks_exact_mut(m).for_each(|point| point.copy_from_slice(u));
        for i in 0..s {
            let here = if i < n { x[i] } else { u[i - n] };
            let step = STEP * here.abs().max(at.units.of_stage(i));
            self.steps[i] = step;
            for (point, moved) in [(2 * i + 1, here + step), (2 * i + 2, here - step)] {
                match i.checked_sub(n) {
                    None => self.x[point * n + i] = moved,
                    Some(k) => self.u[point * m + k] = moved,
                }
            }
        }
    }

    /// Writes the gradients at the points of a stage.
    fn differentiate(
        &mut self,
        horizon: &mut Horizon,
        terms: &mut StageTerms,
        at: &At<'_>,
        stage: usize,
    ) {
        let (n, m) = (self.dims.nx, self.dims.nu);
        let Self { x, u, by_x, by_u, block, model, .. } = self;
        let time_s = terms.time_s(stage);
        let p = at.parameters(self.dims, stage);
        let points = StagePoint { stage, time_s, x, u, p };
        terms.gradients(points, block, [by_x, by_u]);
        if stage == self.dims.horizon {
            return;
        }
        self.evaluated += x.len() / n;
        horizon.at(stage).linearize(Stages { x, u, p: &self.p }, model.as_mut());
        let lambda = &at.plan.multipliers.dynamics[self.dims.next_state(stage)];
        for (to, jacobian, width) in [(by_x, &model.a, n), (by_u, &model.b, m)] {
            let points = to.chunks_exact_mut(width).zip(jacobian.chunks_exact(n * width));
            for (to, rows) in points {
                for (i, (lambda, row)) in lambda.iter().zip(rows.chunks_exact(width)).enumerate() {
                    let lambda = at.units.plain_multiplier(i, *lambda);
                    to.iter_mut().zip(row).for_each(|(to, entry)| *to += lambda * entry);
                }
            }
        }
    }

    /// Makes the Hessian of the gradients.
    fn combine(&mut self) {
        let (n, m, s) = (self.dims.nx, self.dims.nu, self.steps.len());
        for (i, step) in self.steps.iter().enumerate() {
            for k in 0..s {
                let slope = |point: usize| match k.checked_sub(n) {
                    None => self.by_x[point * n + k],
                    Some(input) => self.by_u[point * m + input],
                };
                let [ahead, behind] = [slope(2 * i + 1), slope(2 * i + 2)];
                let middle = slope(0);
                self.hessian[i * s + k] = agreed([ahead - middle, middle - behind]) / step;
            }
        }
        for i in 0..s {
            for k in 0..i {
                let mean = 0.5 * (self.hessian[i * s + k] + self.hessian[k * s + i]);
                self.hessian[i * s + k] = mean;
                self.hessian[k * s + i] = mean;
            }
        }
    }

    /// Adds the second derivatives of a stage to the program, in the units of the optimization; the
    /// measured state does not move.
    fn add_block(&self, stage: usize, units: &Units, qp: &mut Qp) {
        let OcpDims { nx: n, nu: m, .. } = self.dims;
        let s = n + m;
        let entry = |i: usize, k: usize| self.hessian[i * s + k] * units.second_derivative(i, k);
        let t = self.dims.acting(stage) * m * m;
        for i in 0..m {
            for k in 0..m {
                qp.t[t + i * m + k] += entry(n + i, n + k);
            }
        }
        let Some(before) = stage.checked_sub(1) else { return };
        for i in 0..n {
            for k in 0..n {
                qp.q[(before * n + i) * n + k] += entry(i, k);
            }
        }
        for i in 0..m {
            for k in 0..n {
                qp.s[(before * m + i) * n + k] += entry(n + i, k);
            }
        }
    }
}

/// The mean of two numbers that agree, or the smaller one.
fn agreed([a, b]: [f64; 2]) -> f64 {
    let [least, most] = if a.abs() <= b.abs() { [a, b] } else { [b, a] };
    if a.signum() == b.signum() && most.abs() <= 2.0 * least.abs() { 0.5 * (a + b) } else { least }
}
