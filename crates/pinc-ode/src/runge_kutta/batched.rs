//! A method with its Jacobians at many points, which are in the lanes of vectors.

use super::SMALL;
use super::linearize::WIDEST;
use super::method::{Method, StackWorkspace};
use crate::points::Points;
use crate::{Dims, Plant};
use pinc_ad::Dual;
use pinc_ad::simd::{Simd, Task};
use std::marker::PhantomData;

/// The most columns that the Jacobians of a point may have here. With more, each root and quotient
/// would be a longer chain of vectors than when the columns are in the lanes.
pub(super) const COLUMNS: usize = 3;

/// The same for a plant with a long equation, see [`Plant::LONG`], of few columns or many.
pub(super) const COLUMNS_IF_LONG: [usize; 2] = [4, 8];

/// Any number of points of a plant with `N` columns at most through the method `M`.
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
        assert!(columns <= N && np <= SMALL, "a plant with few columns");
        let count = at.x.len() / n;
        for begin in (0..count).step_by(V::LANES) {
            let filled = V::LANES.min(count - begin);
            // Lanes without a point repeat the last.
            let point = |lane: usize| begin + lane.min(filled - 1);
            let mut workspace = StackWorkspace::new(Dual { re: zero, eps: [zero; N] });
            let mut work = workspace.workspace(dims);
            for (j, to) in work.x.iter_mut().enumerate() {
                *to = variable(zero.generate(|lane| at.x[point(lane) * n + j]), j);
            }
            for (j, to) in work.u.iter_mut().enumerate() {
                *to = variable(zero.generate(|lane| at.u[point(lane) * m + j]), n + j);
            }
            for (j, to) in work.p.iter_mut().enumerate() {
                *to = variable(zero.generate(|lane| at.p[point(lane) * np + j]), n + m + j);
            }
            work.run::<P, M>(plant, h, substeps);
            for (i, Dual { re, eps }) in work.x.iter().enumerate() {
                let row = |lane: usize| point(lane) * n + i;
                scatter(*re, filled, |lane, value| points.out.next[row(lane)] = value);
                for (column, &eps) in (0..columns).zip(eps) {
                    scatter(eps, filled, |lane, derivative| {
                        points.set(dims, row(lane), column, derivative);
                    });
                }
            }
        }
    }
}

/// Values of the variable of column `column`.
#[inline(always)]
fn variable<V: Simd, const N: usize>(values: V, column: usize) -> Dual<V, N> {
    let (zero, one) = (values.constant(0.0), values.constant(1.0));
    Dual { re: values, eps: std::array::from_fn(|k| if k == column { one } else { zero }) }
}

/// Gives each of the first `filled` lanes to `to`.
#[inline(always)]
fn scatter<V: Simd>(vector: V, filled: usize, mut to: impl FnMut(usize, f64)) {
    let mut lanes = [0.0; WIDEST];
    vector.write(&mut lanes);
    lanes.iter().enumerate().take(filled).for_each(|(lane, &value)| to(lane, value));
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
