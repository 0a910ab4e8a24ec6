//! A method with its Jacobians at many points, which are in the lanes of vectors.

use super::SMALL;
use super::method::{Method, StackWorkspace};
use crate::points::Points;
use crate::sparse::scatter;
use crate::{Dims, Plant};
use pinc_ad::Dual;
use pinc_ad::simd::{Simd, Task};
use std::marker::PhantomData;

/// Any number of points through the method `M`, with `N` columns of their Jacobians at a time.
pub(super) struct LinearizeBatched<'a, P, M, const N: usize> {
    pub(super) plant: &'a P,
    pub(super) h: f64,
    pub(super) substeps: usize,
    pub(super) points: Points<'a>,
    pub(super) method: PhantomData<M>,
}

impl<P: Plant, M: Method, const N: usize> Task for LinearizeBatched<'_, P, M, N> {
    type Output = ();

    #[inline(always)]
    fn run<V: Simd>(self, zero: V) {
        // A constant for a plant whose dimensions are: then all below is unrolled, or left out.
        let dims = self.plant.dims();
        let Dims { nx: n, nu: m, np, .. } = dims;
        let Self { plant, h, substeps, mut points, .. } = self;
        let (at, columns) = (points.at, points.columns(dims));
        assert!(n <= SMALL && m <= SMALL && np <= SMALL, "a small plant");
        let count = at.x.len() / n;
        for first in (0..columns).step_by(N) {
            for begin in (0..count).step_by(V::LANES) {
                let filled = V::LANES.min(count - begin);
                // Lanes without a point repeat the last.
                let point = |lane: usize| begin + lane.min(filled - 1);
                let mut workspace = StackWorkspace::new(Dual { re: zero, eps: [zero; N] });
                let mut work = workspace.workspace(dims);
                for (j, to) in work.x.iter_mut().enumerate() {
                    let values = zero.generate(|lane| at.x[point(lane) * n + j]);
                    *to = variable(values, j.wrapping_sub(first));
                }
                for (j, to) in work.u.iter_mut().enumerate() {
                    let values = zero.generate(|lane| at.u[point(lane) * m + j]);
                    *to = variable(values, (n + j).wrapping_sub(first));
                }
                for (j, to) in work.p.iter_mut().enumerate() {
                    let values = zero.generate(|lane| at.p[point(lane) * np + j]);
                    *to = variable(values, (n + m + j).wrapping_sub(first));
                }
                work.run::<P, M>(plant, h, substeps);
                for (i, &Dual { re, eps }) in work.x.iter().enumerate() {
                    let row = |lane: usize| point(lane) * n + i;
                    scatter(re, filled, |lane, value| points.out.next[row(lane)] = value);
                    // As often for all plants: a count that the compiler does not know would keep
                    // the whole workspace in memory.
                    for (k, &eps) in eps.iter().enumerate() {
                        if first + k < columns {
                            scatter(eps, filled, |lane, derivative| {
                                points.set(dims, row(lane), first + k, derivative);
                            });
                        }
                    }
                }
            }
        }
    }
}

/// Values of a variable, with the derivative 1 in direction `column`, if there is such a one.
#[inline(always)]
fn variable<V: Simd, const N: usize>(values: V, column: usize) -> Dual<V, N> {
    let (zero, one) = (values.constant(0.0), values.constant(1.0));
    Dual { re: values, eps: std::array::from_fn(|k| if k == column { one } else { zero }) }
}

/// A step of a plant with a long equation, from one point in all lanes.
pub(super) struct StepInVectors<'a, P, M> {
    pub(super) plant: &'a P,
    pub(super) h: f64,
    pub(super) substeps: usize,
    pub(super) at: (&'a [f64], &'a [f64], &'a [f64]),
    pub(super) next: &'a mut [f64],
    pub(super) method: PhantomData<M>,
}

impl<P: Plant, M: Method> Task for StepInVectors<'_, P, M> {
    type Output = ();

    #[inline(always)]
    fn run<V: Simd>(self, zero: V) {
        let Self { plant, h, substeps, at: (x, u, p), next, .. } = self;
        let mut workspace = StackWorkspace::new(zero);
        let mut work = workspace.workspace(plant.dims());
        fill(work.x, x);
        fill(work.u, u);
        fill(work.p, p);
        work.run::<P, M>(plant, h, substeps);
        for (next, x) in next.iter_mut().zip(&*work.x) {
            scatter(*x, 1, |_, value| *next = value);
        }
    }
}

#[inline(always)]
fn fill<V: Simd>(to: &mut [V], from: &[f64]) {
    for (to, &value) in to.iter_mut().zip(from) {
        *to = to.constant(value);
    }
}
