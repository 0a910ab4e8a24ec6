//! Vectors by the number of points.

use crate::points::Points;
use crate::{Dims, Linearization, Model, OutputLinearization, Stages};

/// A model on wide vectors, and the same on vectors of half as many lanes for points that fill no
/// more.
#[derive(Debug)]
pub(super) struct ByCount {
    pub(super) wide: Box<dyn Model>,
    pub(super) narrow: Box<dyn Model>,
    pub(super) lanes: usize,
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
        let rest = count % self.lanes;
        let whole = if rest <= self.lanes / 2 { count - rest } else { count };
        let (whole, rest) = Points { at, out }.split(dims, whole);
        if !whole.at.x.is_empty() {
            self.wide.linearize(whole.at, whole.out);
        }
        if !rest.at.x.is_empty() {
            self.narrow.linearize(rest.at, rest.out);
        }
    }

    fn output(&mut self, x: &[f64], u: &[f64], p: &[f64], y: &mut [f64]) {
        self.narrow.output(x, u, p, y);
    }

    fn linearize_output(&mut self, at: Stages<'_>, out: OutputLinearization<'_>) {
        self.wide.linearize_output(at, out);
    }
}
