//! Costs that are integrated along the model.

use crate::stage_cost::{QuadBlock, StageCost, StagePoint};
use pinc_ode::{Dims, Linearization, LinearizationBuffer, Model, OutputLinearization, Stages};

/// A cost that a model integrates: the integral of a rate over each stage, and a cost of the end.
///
/// The models are of the plant's states with two more, the time and the cost integrated so far:
/// (x, t, J) -> (F(x, u, p), t + T, J + integral over the step). The last output is the cost of the
/// end, evaluated at the last state with the last input. So the discretization is the model's own.
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
    model: LinearizationBuffer,
    /// The outputs with their Jacobians at each point.
    y: Vec<f64>,
    c: Vec<f64>,
    d: Vec<f64>,
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
            model: LinearizationBuffer::new(dims, points),
            y: vec![0.0; points * dims.ny],
            c: vec![0.0; points * dims.ny * dims.nx],
            d: vec![0.0; points * dims.ny * dims.nu],
            dims,
        }
    }

    /// Linearizes at some points, at most as many as a Hessian takes.
    fn linearize(&mut self, at: StagePoint<'_>) -> CostRows<'_> {
        let Self { models, dims, at: extended, p, model, y, c, d } = self;
        let Dims { nx, nu, np, ny, .. } = *dims;
        let (n, points) = (nx - 2, at.u.len() / nu);
        for (to, x) in extended.chunks_exact_mut(nx).zip(at.x.chunks_exact(n)) {
            to[..n].copy_from_slice(x);
            (to[n], to[n + 1]) = (at.time_s, 0.0);
        }
        p[..points * np].chunks_exact_mut(np.max(1)).for_each(|p| p.copy_from_slice(at.p));
        let stages = Stages { x: &extended[..points * nx], u: at.u, p: &p[..points * np] };
        let part = |of: usize| points * of;
        if let Some((stage, _)) = models.iter_mut().find(|(_, end)| at.stage < *end) {
            let out = Linearization {
                next: &mut model.next[..part(nx)],
                a: &mut model.a[..part(nx * nx)],
                b: &mut model.b[..part(nx * nu)],
                e: &mut [],
            };
            stage.linearize(stages, out);
            return CostRows {
                row: n + 1,
                rows: nx,
                values: &model.next,
                by_x: &model.a,
                by_u: &model.b,
            };
        }
        if let Some((last, _)) = models.last_mut() {
            let out = OutputLinearization {
                y: &mut y[..part(ny)],
                c: &mut c[..part(ny * nx)],
                d: &mut d[..part(ny * nu)],
                e: &mut [],
            };
            last.linearize_output(stages, out);
        }
        CostRows { row: ny - 1, rows: ny, values: y, by_x: c, by_u: d }
    }
}

/// Where the cost is among values and Jacobians of points.
struct CostRows<'a> {
    row: usize,
    rows: usize,
    values: &'a [f64],
    by_x: &'a [f64],
    by_u: &'a [f64],
}

impl CostRows<'_> {
    /// Writes the gradient at point `k`.
    fn copy(&self, k: usize, by_x: &mut [f64], by_u: &mut [f64]) {
        let (at, nx, nu) = (k * self.rows + self.row, by_x.len() + 2, by_u.len());
        by_x.copy_from_slice(&self.by_x[at * nx..(at + 1) * nx - 2]);
        by_u.copy_from_slice(&self.by_u[at * nu..(at + 1) * nu]);
    }
}

impl StageCost for IntegratedCost {
    fn quadratize(&mut self, at: StagePoint<'_>, out: &mut QuadBlock) {
        let rows = self.linearize(at);
        out.value = rows.values[rows.row];
        rows.copy(0, &mut out.by_x, &mut out.by_u);
    }

    fn leaves_out_hessian(&self) -> bool {
        true
    }

    fn gradients(&mut self, at: StagePoint<'_>, _: &mut QuadBlock, [by_x, by_u]: [&mut [f64]; 2]) {
        let Dims { nx, nu, .. } = self.dims;
        let rows = self.linearize(at);
        let points = by_x.chunks_exact_mut(nx - 2).zip(by_u.chunks_exact_mut(nu));
        points.enumerate().for_each(|(k, (by_x, by_u))| rows.copy(k, by_x, by_u));
    }
}
