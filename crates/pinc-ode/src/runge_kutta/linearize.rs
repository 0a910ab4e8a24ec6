//! A method with its Jacobians, all columns in the lanes of vectors.

use super::SMALL;
use super::method::{Method, StackWorkspace};
use crate::points::Points;
use crate::sparse::WIDEST;
use crate::{Dims, Plant};
use pinc_ad::simd::{Simd, Task};
use pinc_ad::{Directions, Dual, Lanes};
use std::marker::PhantomData;

/// `C` points of a small plant through the method `M`, side by side.
pub(super) struct Linearize<'a, P, M, const C: usize> {
    pub(super) plant: &'a P,
    pub(super) h: f64,
    pub(super) substeps: usize,
    pub(super) points: Points<'a>,
    pub(super) method: PhantomData<M>,
}

/// The values of `C` points, with derivatives in the directions of a vector.
type Tangent<V, const C: usize> = Dual<Lanes<C>, 1, Directions<V, C>>;

impl<P: Plant, M: Method, const C: usize> Task for Linearize<'_, P, M, C> {
    type Output = ();

    #[inline(always)]
    fn run<V: Simd>(self, zero: V) {
        // A constant for a plant whose dimensions are: then all below is unrolled, into registers.
        let dims = self.plant.dims();
        let Dims { nx: n, nu: m, np, .. } = dims;
        assert!(n <= SMALL && m <= SMALL && np <= SMALL, "a small plant");
        let Self { plant, h, substeps, mut points, .. } = self;
        let (at, columns) = (points.at, points.columns(dims));
        let constant: Tangent<V, C> = Dual { re: Lanes::splat(0.0), eps: [Directions([zero; C])] };
        for first in (0..columns).step_by(V::LANES) {
            let mut workspace = StackWorkspace::new(constant);
            let mut work = workspace.workspace(dims);
            for j in 0..n {
                work.x[j] = seed(zero, |point| at.x[point * n + j], first, j);
            }
            for j in 0..m {
                work.u[j] = seed(zero, |point| at.u[point * m + j], first, n + j);
            }
            for j in 0..np {
                work.p[j] = seed(zero, |point| at.p[point * np + j], first, n + m + j);
            }
            work.run::<P, M>(plant, h, substeps);
            for (i, Dual { re, eps: [eps] }) in work.x.iter().enumerate() {
                for point in 0..C {
                    let row = point * n + i;
                    points.out.next[row] = re.0[point];
                    let mut derivatives = [0.0; WIDEST];
                    eps.0[point].write(&mut derivatives);
                    for (column, derivative) in (first..columns).zip(derivatives).take(V::LANES) {
                        points.set(dims, row, column, derivative);
                    }
                }
            }
        }
    }
}

/// The variable of column `column`, when the first lane stands for column `first`.
#[inline(always)]
fn seed<V: Simd, const C: usize>(
    zero: V,
    value: impl Fn(usize) -> f64,
    first: usize,
    column: usize,
) -> Tangent<V, C> {
    let mut unit = [0.0; WIDEST];
    if (first..first + V::LANES).contains(&column) {
        unit[column - first] = 1.0;
    }
    let mut re = Lanes::splat(0.0);
    for (point, re) in re.0.iter_mut().enumerate() {
        *re = value(point);
    }
    Dual { re, eps: [Directions([zero.load(&unit); C])] }
}
