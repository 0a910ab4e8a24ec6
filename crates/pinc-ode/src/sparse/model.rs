//! The model of a method on a sparse plant.

use super::lanes::{load, scatter, store};
use super::outputs::Outputs;
use super::{SparseFunction, SparsePlant};
use crate::points::Points;
use crate::{Dims, Gradients, Linearization, Model, OutputLinearization, Stages};
use pinc_ad::simd::{Simd, Work};
use std::fmt::Debug;

/// A method on one kind of vectors, whose lanes are points. Mark its functions `#[inline(always)]`.
pub(super) trait Stepper<V: Simd>: Debug + Send {
    /// Room to compute in, which begins with the variables (x, u, p).
    fn memory(&self) -> &[V];

    /// The same, to write to.
    fn memory_mut(&mut self) -> &mut [V];

    /// Takes the state through a step.
    fn step(&mut self);

    /// The same with the derivatives by the first `columns` variables.
    fn linearize(&mut self, columns: usize);

    /// The derivative of a state by a variable, after [`Stepper::linearize`].
    fn derivative(&self, state: usize, variable: usize) -> V;

    /// The gradient of w'F by the variables, of which the first `columns` are wanted; `None` if the
    /// method cannot go backwards.
    fn pull_back(&mut self, weights: impl Fn(usize) -> V, columns: usize) -> Option<&[V]>;
}

/// A method as a [`Model`].
#[derive(Debug)]
pub(super) struct SparseModel<S, H, V> {
    dims: Dims,
    sample_time_s: f64,
    zero: V,
    stepper: S,
    outputs: Outputs<H, V>,
}

impl<S: Stepper<V>, H: SparseFunction, V: Simd> SparseModel<S, H, V> {
    /// The model of `stepper`, which steps a plant of these dimensions and outputs.
    pub(super) fn new(
        (dims, outputs): (Dims, Option<H>),
        sample_time_s: f64,
        stepper: S,
        zero: V,
    ) -> Self {
        Self { dims, sample_time_s, zero, stepper, outputs: Outputs::new(dims, outputs, zero) }
    }
}

/// Length of a substep, in s.
///
/// # Panics
///
/// If `sample_time_s` is not positive and finite or `substeps` is 0, or if the functions are not of
/// the size of the plant.
pub(super) fn checked_substep<F: SparseFunction, H: SparseFunction>(
    plant: &SparsePlant<F, H>,
    sample_time_s: f64,
    substeps: usize,
) -> f64 {
    assert!(sample_time_s > 0.0 && sample_time_s.is_finite(), "the step must be positive");
    assert!(substeps > 0, "at least one substep");
    plant.check();
    sample_time_s / substeps as f64
}

/// A step of one point.
struct Step<'a, S, V> {
    stepper: &'a mut S,
    dims: Dims,
    at: Stages<'a>,
    next: &'a mut [f64],
    zero: V,
}

impl<S: Stepper<V>, V: Simd> Work for Step<'_, S, V> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { stepper, dims, at, next, zero } = self;
        load(stepper.memory_mut(), dims, at, 0, zero);
        stepper.step();
        for (to, &x) in next.iter_mut().zip(stepper.memory()) {
            scatter(x, 1, |_, value| *to = value);
        }
    }
}

/// Steps of some points with their Jacobians.
struct Linearize<'a, S, V> {
    stepper: &'a mut S,
    dims: Dims,
    points: Points<'a>,
    zero: V,
}

impl<S: Stepper<V>, V: Simd> Work for Linearize<'_, S, V> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { stepper, dims, mut points, zero } = self;
        let columns = points.columns(dims);
        for begin in (0..points.at.x.len() / dims.nx).step_by(V::LANES) {
            let filled = load(stepper.memory_mut(), dims, points.at, begin, zero);
            stepper.linearize(columns);
            let (x, place) = (&stepper.memory()[..dims.nx], (begin, filled, columns));
            store(&mut points, dims, x, place, |i, column| stepper.derivative(i, column));
        }
    }
}

/// Gradients of weighted sums of the results of some points' steps.
struct PullBack<'a, S, V> {
    stepper: &'a mut S,
    dims: Dims,
    at: Stages<'a>,
    weights: &'a [f64],
    out: Gradients<'a>,
    zero: V,
}

impl<S: Stepper<V>, V: Simd> Work for PullBack<'_, S, V> {
    type Output = bool;

    #[inline(always)]
    fn run(self) -> bool {
        let Self { stepper, dims, at, weights, out, zero } = self;
        let Dims { nx, nu, np, .. } = dims;
        let columns = nx + nu + if out.p.is_empty() { 0 } else { np };
        for begin in (0..at.x.len() / nx).step_by(V::LANES) {
            let filled = load(stepper.memory_mut(), dims, at, begin, zero);
            let point = |lane: usize| begin + lane.min(filled - 1);
            let weights = |i: usize| zero.generate(|lane| weights[point(lane) * nx + i]);
            let Some(gradient) = stepper.pull_back(weights, columns) else { return false };
            let (by_x, rest) = gradient.split_at(nx);
            let (by_u, by_p) = rest.split_at(nu);
            let by_p = &by_p[..columns - nx - nu];
            for (to, from) in [(&mut *out.x, by_x), (&mut *out.u, by_u), (&mut *out.p, by_p)] {
                for (k, &slope) in from.iter().enumerate() {
                    scatter(slope, filled, |lane, value| to[point(lane) * from.len() + k] = value);
                }
            }
        }
        true
    }
}

impl<S: Stepper<V>, H: SparseFunction, V: Simd> Model for SparseModel<S, H, V> {
    fn dims(&self) -> Dims {
        self.dims
    }

    fn sample_time_s(&self) -> f64 {
        self.sample_time_s
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        let Self { dims, zero, stepper, .. } = self;
        let (dims, zero, at) = (*dims, *zero, Stages { x, u, p });
        assert!(at.count(dims) == 1 && next.len() == x.len(), "one point");
        zero.vectorize(Step { stepper, dims, at, next, zero });
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        let Self { dims, zero, stepper, .. } = self;
        let (dims, zero) = (*dims, *zero);
        out.check(at.count(dims), dims);
        zero.vectorize(Linearize { stepper, dims, points: Points { at, out }, zero });
    }

    fn pull_back(&mut self, at: Stages<'_>, weights: &[f64], out: Gradients<'_>) -> bool {
        let Self { dims, zero, stepper, .. } = self;
        let (dims, zero) = (*dims, *zero);
        out.check(at.count(dims), dims);
        zero.vectorize(PullBack { stepper, dims, at, weights, out, zero })
    }

    fn output(&mut self, x: &[f64], u: &[f64], p: &[f64], y: &mut [f64]) {
        self.outputs.values(Stages { x, u, p }, y);
    }

    fn feedthrough(&self) -> Vec<bool> {
        self.outputs.feedthrough()
    }

    fn linearize_output(&mut self, at: Stages<'_>, out: OutputLinearization<'_>) {
        self.outputs.linearize(at, out);
    }
}
