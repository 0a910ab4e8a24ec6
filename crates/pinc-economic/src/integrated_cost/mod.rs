//! Costs that are integrated along the model.

#[cfg(test)]
mod tests;

use pinc_mpc::{QuadBlock, StageCost, StagePoint};
use pinc_ode::{
    Dims, Gradients, Linearization, LinearizationBuffer, Model, OutputLinearizationBuffer, Stages,
};

/// A cost that a model integrates: the integral of a rate over each stage, and a cost of the end.
///
/// The models are of the plant's states with two more, the time and the cost integrated so far:
/// (x, t, J) -> (F(x, u, p), t + T, J + integral over the step), where F is the controller's own
/// model. The last output is the cost of the end, evaluated at the last state with the last input. So
/// the discretization is the model's own.
///
/// The Hessian is left out: see [`StageCost::leaves_out_hessian`].
#[derive(Debug)]
pub struct IntegratedCost {
    /// The model of each stage of the same length, and the stage after the last of them.
    models: Vec<(Box<dyn Model>, usize)>,
    dims: Dims,
    /// (x, t, J) and p at as many points as a Hessian takes.
    at: Vec<f64>,
    p: Vec<f64>,
    /// (lambda, 0, the weight of J) and the gradients by (x, t, J) at each.
    weights: Vec<f64>,
    by_extended: Vec<f64>,
    found: LinearizationBuffer,
    /// The inputs of points that were linearized ahead, and what was found there.
    u: Vec<f64>,
    linearized: LinearizationBuffer,
    ahead: Ahead,
    /// The outputs at one point.
    outputs: OutputLinearizationBuffer,
}

/// Points of one model that were linearized together.
#[derive(Clone, Copy, Debug, Default)]
struct Ahead {
    model: usize,
    count: usize,
    /// The first of them that was not asked for yet.
    next: usize,
}

/// Writes (x, t, 0).
fn write_extended(to: &mut [f64], x: &[f64], time_s: f64) {
    let n = x.len();
    to[..n].copy_from_slice(x);
    (to[n], to[n + 1]) = (time_s, 0.0);
}

impl IntegratedCost {
    /// The cost of these models, each of so many stages in a row; there is at least one.
    #[must_use]
    pub fn new(models: Vec<(Box<dyn Model>, usize)>) -> Self {
        let dims = models.first().map_or(Dims::new(0, 0), |(model, _)| model.dims());
        let points = 2 * (dims.nx + dims.nu) + 1;
        let mut end = 0;
        let until = |(model, count): (Box<dyn Model>, usize)| {
            end += count;
            (model, end)
        };
        Self {
            models: models.into_iter().map(until).collect(),
            at: vec![0.0; points * dims.nx],
            p: vec![0.0; points * dims.np],
            weights: vec![0.0; points * dims.nx],
            by_extended: vec![0.0; points * dims.nx],
            found: LinearizationBuffer::new(dims, points),
            u: vec![0.0; points * dims.nu],
            linearized: LinearizationBuffer::new(dims, points),
            ahead: Ahead::default(),
            outputs: OutputLinearizationBuffer::new(dims, 1),
            dims,
        }
    }

    /// The place of the model of a stage; none at the end.
    fn model_of(&self, stage: usize) -> Option<usize> {
        self.models.iter().position(|(_, end)| stage < *end)
    }

    /// Whether a point is the next one of those that were linearized ahead.
    fn is_next(&self, model: usize, at: StagePoint<'_>) -> bool {
        let Dims { nx, nu, np, .. } = self.dims;
        let (n, k) = (nx - 2, self.ahead.next);
        let is_there = self.ahead.model == model && k < self.ahead.count;
        is_there
            && self.at[k * nx..][..n] == *at.x
            && self.at[k * nx + n].total_cmp(&at.time_s).is_eq()
            && self.u[k * nu..][..nu] == *at.u
            && self.p[k * np..][..np] == *at.p
    }

    /// Writes (x, t, 0) and p of some points, at most as many as a Hessian takes; returns how many.
    fn extend(&mut self, at: StagePoint<'_>) -> usize {
        let Dims { nx, nu, np, .. } = self.dims;
        let (n, points) = (nx - 2, at.u.len() / nu);
        self.ahead = Ahead::default();
        for (to, x) in self.at.chunks_exact_mut(nx).zip(at.x.chunks_exact(n)) {
            write_extended(to, x, at.time_s);
        }
        self.p.chunks_exact_mut(np.max(1)).for_each(|p| p.copy_from_slice(at.p));
        points
    }
}

impl StageCost for IntegratedCost {
    fn look_ahead(&mut self, points: &[StagePoint<'_>]) {
        let Dims { nx, nu, np, .. } = self.dims;
        self.ahead = Ahead::default();
        let Some(model) = points.first().and_then(|first| self.model_of(first.stage)) else {
            return;
        };
        let alike = points.iter().take_while(|at| self.model_of(at.stage) == Some(model));
        let count = alike.count().min(self.at.len() / nx);
        for (k, at) in points[..count].iter().enumerate() {
            write_extended(&mut self.at[k * nx..(k + 1) * nx], at.x, at.time_s);
            self.u[k * nu..(k + 1) * nu].copy_from_slice(at.u);
            self.p[k * np..(k + 1) * np].copy_from_slice(at.p);
        }
        let at = Stages {
            x: &self.at[..count * nx],
            u: &self.u[..count * nu],
            p: &self.p[..count * np],
        };
        let LinearizationBuffer { next, a, b, .. } = &mut self.linearized;
        let (next, a) = (&mut next[..count * nx], &mut a[..count * nx * nx]);
        let b = &mut b[..count * nx * nu];
        self.models[model].0.linearize(at, Linearization { next, a, b, e: &mut [] });
        self.ahead = Ahead { model, count, next: 0 };
    }

    fn quadratize(&mut self, at: StagePoint<'_>, out: &mut QuadBlock) {
        let Dims { nx, nu, np, ny, .. } = self.dims;
        let (row, values, by_x, by_u) = match self.model_of(at.stage) {
            Some(model) => {
                if !self.is_next(model, at) {
                    self.look_ahead(&[at]);
                }
                let point = self.ahead.next;
                self.ahead.next += 1;
                let LinearizationBuffer { next, a, b, .. } = &self.linearized;
                (point * nx + nx - 1, next, a, b)
            }
            None => {
                self.extend(at);
                let Self { models, at: extended, p, outputs, .. } = self;
                let point = Stages { x: &extended[..nx], u: at.u, p: &p[..np] };
                let last = models.last_mut().into_iter();
                last.for_each(|(last, _)| last.linearize_output(point, outputs.as_mut()));
                let OutputLinearizationBuffer { y, c, d, .. } = &self.outputs;
                (ny - 1, y, c, d)
            }
        };
        out.value = values[row];
        out.by_x.copy_from_slice(&by_x[row * nx..(row + 1) * nx - 2]);
        out.by_u.copy_from_slice(&by_u[row * nu..(row + 1) * nu]);
    }

    fn leaves_out_hessian(&self) -> bool {
        true
    }

    fn gradients(
        &mut self,
        at: StagePoint<'_>,
        (part, lambda): (f64, &[f64]),
        block: &mut QuadBlock,
        [by_x, by_u]: [&mut [f64]; 2],
    ) -> bool {
        let Some(model) = self.model_of(at.stage) else {
            self.gradients_one_by_one(at, part, block, [by_x, by_u]);
            return false;
        };
        let (Dims { nx, np, .. }, points) = (self.dims, self.extend(at));
        let (n, all) = (nx - 2, points * nx);
        let Self { models, at: extended, p, weights, by_extended, found, .. } = self;
        for weights in weights.chunks_exact_mut(nx) {
            weights[..n].copy_from_slice(lambda);
            weights[n + 1] = part;
        }
        let stages = Stages { x: &extended[..all], u: at.u, p: &p[..points * np] };
        let out = Gradients { x: &mut by_extended[..all], u: by_u, p: &mut [] };
        found.gradients(models[model].0.as_mut(), stages, &weights[..all], out);
        for (to, from) in by_x.chunks_exact_mut(n).zip(by_extended.chunks_exact(nx)) {
            to.copy_from_slice(&from[..n]);
        }
        true
    }
}
