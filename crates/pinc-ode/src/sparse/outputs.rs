//! The outputs of a sparse plant with their Jacobians.

use super::SparseFunction;
use super::lanes::{load, scatter};
use crate::{Dims, OutputLinearization, Stages};
use pinc_ad::simd::{Simd, Work};

/// h(x, u, p) with room to compute in.
#[derive(Clone, Debug)]
pub(super) struct Outputs<F, V> {
    dims: Dims,
    zero: V,
    /// `None` if the outputs are the states.
    function: Option<F>,
    memory: Vec<V>,
}

impl<F: SparseFunction, V: Simd> Outputs<F, V> {
    pub(super) fn new(dims: Dims, function: Option<F>, zero: V) -> Self {
        let memory = function.as_ref().map_or(Vec::new(), |function| function.memory(zero));
        Self { dims, zero, function, memory }
    }

    /// See [`Model::output`](crate::Model::output).
    pub(super) fn values(&mut self, at: Stages<'_>, y: &mut [f64]) {
        assert!(at.count(self.dims) == 1 && y.len() == self.dims.ny, "one point");
        self.zero.vectorize(Values { outputs: self, at, y });
    }

    /// See [`Model::feedthrough`](crate::Model::feedthrough).
    pub(super) fn feedthrough(&self) -> Vec<bool> {
        let Dims { nx, nu, ny, .. } = self.dims;
        let Some(function) = &self.function else { return vec![false; ny] };
        let pattern = function.pattern();
        let reaches = |place: &usize| (nx..nx + nu).contains(place);
        (0..ny).map(|i| pattern.places()[pattern.row(i)].iter().any(reaches)).collect()
    }

    /// See [`Model::linearize_output`](crate::Model::linearize_output).
    pub(super) fn linearize(&mut self, at: Stages<'_>, out: OutputLinearization<'_>) {
        let dims = self.dims;
        out.check(at.count(dims), dims);
        if self.function.is_none() {
            return out.set_states(at.x, dims.nx);
        }
        for part in [&mut *out.c, &mut *out.d, &mut *out.e] {
            part.fill(0.0);
        }
        self.zero.vectorize(Linearize { outputs: self, at, out });
    }
}

/// The outputs at one point.
struct Values<'a, F, V> {
    outputs: &'a mut Outputs<F, V>,
    at: Stages<'a>,
    y: &'a mut [f64],
}

impl<F: SparseFunction, V: Simd> Work for Values<'_, F, V> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { outputs: Outputs { dims, zero, function, memory }, at, y } = self;
        let Some(function) = function else { return y.copy_from_slice(at.x) };
        load(memory, *dims, at, 0, *zero);
        for (to, &place) in y.iter_mut().zip(function.values(memory)) {
            scatter(memory[usize::from(place)], 1, |_, value| *to = value);
        }
    }
}

/// The outputs at some points with their Jacobians.
struct Linearize<'a, F, V> {
    outputs: &'a mut Outputs<F, V>,
    at: Stages<'a>,
    out: OutputLinearization<'a>,
}

impl<F: SparseFunction, V: Simd> Work for Linearize<'_, F, V> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { outputs: Outputs { dims, zero, function, memory }, at, mut out } = self;
        let dims = *dims;
        let Some(function) = function else { return };
        for begin in (0..at.x.len() / dims.nx).step_by(V::LANES) {
            let filled = load(memory, dims, at, begin, *zero);
            let (values, entries) = function.linearize(memory).split_at(dims.ny);
            for (i, &value) in values.iter().enumerate() {
                let row = |lane: usize| (begin + lane) * dims.ny + i;
                scatter(memory[usize::from(value)], filled, |lane, value| out.y[row(lane)] = value);
                for entry in function.pattern().row(i) {
                    let column = function.pattern().places()[entry];
                    let derivative = memory[usize::from(entries[entry])];
                    scatter(derivative, filled, |lane, derivative| {
                        out.set(dims, row(lane), column, derivative);
                    });
                }
            }
        }
    }
}
