//! The model along a plan.

use pinc_ode::{Linearization, Model, Stages};
use pinc_qp::OcpDims;

/// The model, linearised at all stages of a plan.
///
/// A controller begins each step with the plan of the step before, moved on by one: all stages but the first and
/// the last are where the model was linearised when that plan was judged. They are not evaluated again.
#[derive(Debug)]
pub(crate) struct LinearizationCache {
    dims: OcpDims,
    stages: StageBlocks,
    /// Where it is to be linearised next.
    input: Points,
    /// The first and the last stage.
    ends: StageBlocks,
    /// Whether there are numbers in `stages`.
    known: bool,
}

/// States and the inputs that act in them, `[stages, n]` and `[stages, m]`.
#[derive(Debug)]
struct Points {
    x: Vec<f64>,
    u: Vec<f64>,
}

/// Points with f(x, u) and its Jacobians, as in [`Model::linearize`].
#[derive(Debug)]
struct StageBlocks {
    points: Points,
    next: Vec<f64>,
    a: Vec<f64>,
    b: Vec<f64>,
}

impl LinearizationCache {
    pub(crate) fn new(dims: OcpDims) -> Self {
        Self {
            dims,
            stages: StageBlocks::new(dims, dims.horizon),
            input: Points::new(dims, dims.horizon),
            ends: StageBlocks::new(dims, 2),
            known: false,
        }
    }

    /// f(x, u), `[N, n]`, A, `[N, n, n]`, and B, `[N, n, m]`, of the last plan.
    pub(crate) fn parts(&self) -> [&[f64]; 3] {
        let StageBlocks { next, a, b, .. } = &self.stages;
        [next, a, b]
    }

    /// Forgets what is known.
    pub(crate) fn forget(&mut self) {
        self.known = false;
    }

    /// Linearises along the plan `z` from `x0`.
    pub(crate) fn follow(&mut self, model: &mut dyn Model, x0: &[f64], z: &[f64]) {
        let dims = self.dims;
        let Points { x, u } = &mut self.input;
        x[..dims.nx].copy_from_slice(x0);
        x[dims.nx..].copy_from_slice(&z[..dims.all_states() - dims.nx]);
        for (j, u) in u.chunks_exact_mut(dims.nu).enumerate() {
            u.copy_from_slice(&z[dims.input(dims.acting(j))]);
        }
        // What a model had no value for is input again.
        let moved_on = self.known && self.is_moved_on() && self.stages.is_finite();
        std::mem::swap(&mut self.input, &mut self.stages.points);
        if moved_on {
            self.renew_ends(model);
        } else {
            self.stages.linearize(model);
        }
        self.known = true;
    }

    /// Whether the stages between the first and the last are those that came one later before.
    fn is_moved_on(&self) -> bool {
        let OcpDims { nx: n, nu: m, horizon, .. } = self.dims;
        let same = |input: &[f64], known: &[f64], width: usize| {
            let input = input[width..(horizon - 1) * width].iter().map(|v| v.to_bits());
            input.eq(known[2 * width..].iter().map(|v| v.to_bits()))
        };
        let Points { x, u } = &self.stages.points;
        horizon > 2 && same(&self.input.x, x, n) && same(&self.input.u, u, m)
    }

    /// Moves the stages on, and linearises at the first and the last.
    fn renew_ends(&mut self, model: &mut dyn Model) {
        let Self { dims: OcpDims { nx: n, nu: m, horizon: count, .. }, stages, ends, .. } = self;
        let (n, m, last) = (*n, *m, *count - 1);
        for (from, to, width) in
            [(&stages.points.x, &mut ends.points.x, n), (&stages.points.u, &mut ends.points.u, m)]
        {
            to[..width].copy_from_slice(&from[..width]);
            to[width..].copy_from_slice(&from[last * width..]);
        }
        ends.linearize(model);
        for (to, from, width) in [
            (&mut stages.next, &ends.next, n),
            (&mut stages.a, &ends.a, n * n),
            (&mut stages.b, &ends.b, n * m),
        ] {
            to.copy_within(2 * width.., width);
            to[..width].copy_from_slice(&from[..width]);
            to[last * width..].copy_from_slice(&from[width..]);
        }
    }
}

impl Points {
    fn new(dims: OcpDims, stages: usize) -> Self {
        Self { x: vec![0.0; stages * dims.nx], u: vec![0.0; stages * dims.nu] }
    }
}

impl StageBlocks {
    fn new(dims: OcpDims, stages: usize) -> Self {
        let OcpDims { nx: n, nu: m, .. } = dims;
        Self {
            points: Points::new(dims, stages),
            next: vec![0.0; stages * n],
            a: vec![0.0; stages * n * n],
            b: vec![0.0; stages * n * m],
        }
    }

    fn linearize(&mut self, model: &mut dyn Model) {
        let Self { points: Points { x, u }, next, a, b } = self;
        model.linearize(Stages { x, u, p: &[] }, Linearization { next, a, b, e: &mut [] });
    }

    fn is_finite(&self) -> bool {
        let parts = [&self.next, &self.a, &self.b];
        parts.into_iter().flatten().all(|v| v.is_finite())
    }
}
