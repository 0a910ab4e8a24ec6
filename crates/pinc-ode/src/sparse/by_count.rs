//! Vectors by the number of points.

use crate::points::Points;
use crate::{Dims, Gradients, Linearization, Model, OutputLinearization, Stages};
use pinc_ad::simd::{Isa, Task};

/// The model that `build` makes on the vectors of `isa`, with one on half as many lanes beside it
/// where these are eight.
pub(super) fn by_count<B>(build: B, isa: Isa) -> Box<dyn Model>
where
    B: Task<Output = Box<dyn Model>> + Clone,
{
    if isa != Isa::Avx512 || !Isa::available().contains(&Isa::Avx2) {
        return isa.dispatch(build);
    }
    let narrow = Isa::Avx2.dispatch(build.clone());
    Box::new(ByCount { wide: isa.dispatch(build), narrow, lanes: isa.lanes() })
}

/// A model on wide vectors, and the same on vectors of half as many lanes for points that fill no
/// more.
#[derive(Debug)]
struct ByCount {
    wide: Box<dyn Model>,
    narrow: Box<dyn Model>,
    lanes: usize,
}

impl ByCount {
    /// How many of `count` points the wide vectors take.
    fn wide_points(&self, count: usize) -> usize {
        let rest = count % self.lanes;
        if rest <= self.lanes / 2 { count - rest } else { count }
    }
}

impl Model for ByCount {
    fn dims(&self) -> Dims {
        self.wide.dims()
    }

    fn sample_time_s(&self) -> f64 {
        self.wide.sample_time_s()
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        self.narrow.step(x, u, p, next);
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        let dims = self.dims();
        let count = at.count(dims);
        out.check(count, dims);
        let (whole, rest) = Points { at, out }.split(dims, self.wide_points(count));
        if !whole.at.x.is_empty() {
            self.wide.linearize(whole.at, whole.out);
        }
        if !rest.at.x.is_empty() {
            self.narrow.linearize(rest.at, rest.out);
        }
    }

    fn pull_back(&mut self, at: Stages<'_>, weights: &[f64], out: Gradients<'_>) -> bool {
        let dims = self.dims();
        let count = at.count(dims);
        out.check(count, dims);
        let wide = self.wide_points(count);
        let (at, rest) = at.split(dims, wide);
        let (weights, other_weights) = weights.split_at(wide * dims.nx);
        let (out, other) = out.split(dims, wide);
        self.wide.pull_back(at, weights, out) && self.narrow.pull_back(rest, other_weights, other)
    }

    fn output(&mut self, x: &[f64], u: &[f64], p: &[f64], y: &mut [f64]) {
        self.narrow.output(x, u, p, y);
    }

    fn feedthrough(&self) -> Vec<bool> {
        self.wide.feedthrough()
    }

    fn linearize_output(&mut self, at: Stages<'_>, out: OutputLinearization<'_>) {
        self.wide.linearize_output(at, out);
    }
}
