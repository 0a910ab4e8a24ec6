//! A method with its Jacobians at many points, which are in the lanes of vectors.

use super::linearize::{Points, WIDEST};
use super::method::{Method, StackWorkspace};
use crate::{Dims, Plant};
use pinc_ad::Dual;
use pinc_ad::simd::{Simd, Task};
use std::marker::PhantomData;

/// The most columns that the Jacobians of a point may have here. With more, each root and quotient would be
/// a longer chain of vectors than when the columns are in the lanes.
pub(super) const COLUMNS: usize = 3;

/// Any number of points of a plant with few columns through the method `M`.
pub(super) struct LinearizeBatched<'a, P, M> {
    pub(super) plant: &'a P,
    pub(super) h: f64,
    pub(super) substeps: usize,
    pub(super) points: Points<'a>,
    pub(super) method: PhantomData<M>,
}

impl<P: Plant, M: Method> Task for LinearizeBatched<'_, P, M> {
    type Output = ();

    #[inline(always)]
    fn run<V: Simd>(self, zero: V) {
        // A constant for a plant whose dimensions are: then all below is unrolled, or left out.
        let dims = self.plant.dims();
        let Dims { nx: n, nu: m, .. } = dims;
        assert!(n + m <= COLUMNS, "a plant with few columns");
        let Self { plant, h, substeps, points: Points { x, u, next, a, b }, .. } = self;
        let count = x.len() / n;
        for begin in (0..count).step_by(V::LANES) {
            let filled = V::LANES.min(count - begin);
            // Lanes without a point repeat the last.
            let point = |lane: usize| begin + lane.min(filled - 1);
            let mut room = StackWorkspace::new(Dual { re: zero, eps: [zero; COLUMNS] });
            let mut work = room.workspace(dims);
            for (j, to) in work.x.iter_mut().enumerate() {
                *to = variable(zero.generate(|lane| x[point(lane) * n + j]), j);
            }
            for (j, to) in work.u.iter_mut().enumerate() {
                *to = variable(zero.generate(|lane| u[point(lane) * m + j]), n + j);
            }
            work.run::<P, M>(plant, h, substeps);
            for (i, Dual { re, eps }) in work.x.iter().enumerate() {
                let row = |lane: usize| point(lane) * n + i;
                scatter(*re, filled, |lane, value| next[row(lane)] = value);
                for (column, &eps) in (0..n + m).zip(eps) {
                    scatter(eps, filled, |lane, derivative| {
                        if column < n {
                            a[row(lane) * n + column] = derivative;
                        } else {
                            b[row(lane) * m + column - n] = derivative;
                        }
                    });
                }
            }
        }
    }
}

/// Values of the variable of column `column`.
#[inline(always)]
fn variable<V: Simd>(values: V, column: usize) -> Dual<V, COLUMNS> {
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
