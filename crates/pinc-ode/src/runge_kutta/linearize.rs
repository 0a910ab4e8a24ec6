//! A method with its Jacobians, all columns in the lanes of vectors.

use super::SMALL;
use super::method::{Method, Small};
use crate::{Dims, Plant};
use pinc_ad::simd::{Simd, Task};
use pinc_ad::{Directions, Dual, Lanes};
use std::marker::PhantomData;

/// Lanes of the widest vector.
const WIDEST: usize = 8;

/// Directions that go through the method together where the lanes are taken by points: as many as there are
/// columns of a small plant, or half of them.
const DIRECTIONS: usize = 3;

/// Points to linearise at, and where the results go: as in
/// [`Predictor::linearize_stages`](crate::Predictor::linearize_stages).
#[derive(Debug)]
pub(super) struct Points<'a> {
    pub(super) x: &'a [f64],
    pub(super) u: &'a [f64],
    pub(super) next: &'a mut [f64],
    pub(super) a: &'a mut [f64],
    pub(super) b: &'a mut [f64],
}

impl<'a> Points<'a> {
    /// The first `count` points, and the others.
    pub(super) fn split(self, dims: Dims, count: usize) -> (Points<'a>, Points<'a>) {
        let Dims { states: n, inputs: m } = dims;
        let (x, x_rest) = self.x.split_at(count * n);
        let (u, u_rest) = self.u.split_at(count * m);
        let (next, next_rest) = self.next.split_at_mut(count * n);
        let (a, a_rest) = self.a.split_at_mut(count * n * n);
        let (b, b_rest) = self.b.split_at_mut(count * n * m);
        let rest = Points { x: x_rest, u: u_rest, next: next_rest, a: a_rest, b: b_rest };
        (Points { x, u, next, a, b }, rest)
    }
}

/// One point of a small plant through the method `M`: directions in the lanes of vectors.
pub(super) struct Linearize<'a, P, M> {
    pub(super) plant: &'a P,
    pub(super) h: f64,
    pub(super) substeps: usize,
    pub(super) points: Points<'a>,
    pub(super) method: PhantomData<M>,
}

/// A value, with derivatives in the directions of a vector.
type Tangent<V> = Dual<Lanes<1>, 1, Directions<V, 1>>;

impl<P: Plant, M: Method> Task for Linearize<'_, P, M> {
    type Output = ();

    #[inline(always)]
    fn run<V: Simd>(self, zero: V) {
        // A constant for a plant whose dimensions are: then all below is unrolled, into registers.
        let dims = self.plant.dims();
        let Dims { states: n, inputs: m } = dims;
        assert!(n <= SMALL && m <= SMALL, "a small plant");
        let Self { plant, h, substeps, points: Points { x, u, next, a, b }, .. } = self;
        let nothing: Tangent<V> = Dual { re: Lanes::splat(0.0), eps: [Directions([zero])] };
        for first in (0..n + m).step_by(V::LANES) {
            let mut room = Small::new(nothing);
            let mut work = room.workspace(dims);
            for (j, (to, &x)) in work.x.iter_mut().zip(x).enumerate() {
                *to = seed(zero, x, first, j);
            }
            for (j, (to, &u)) in work.u.iter_mut().zip(u).enumerate() {
                *to = seed(zero, u, first, n + j);
            }
            work.run::<P, M>(plant, h, substeps);
            for (i, Dual { re, eps: [eps] }) in work.x.iter().enumerate() {
                next[i] = re.0[0];
                let mut derivatives = [0.0; WIDEST];
                eps.0[0].write(&mut derivatives);
                for (column, derivative) in (first..n + m).zip(derivatives).take(V::LANES) {
                    if column < n {
                        a[i * n + column] = derivative;
                    } else {
                        b[i * m + column - n] = derivative;
                    }
                }
            }
        }
    }
}

/// Any number of points of a small plant through the method `M`: points in the lanes of vectors, some directions at a
/// time.
pub(super) struct LinearizeStages<'a, P, M> {
    pub(super) plant: &'a P,
    pub(super) h: f64,
    pub(super) substeps: usize,
    pub(super) points: Points<'a>,
    pub(super) method: PhantomData<M>,
}

impl<P: Plant, M: Method> Task for LinearizeStages<'_, P, M> {
    type Output = ();

    #[inline(always)]
    fn run<V: Simd>(self, zero: V) {
        // A constant for a plant whose dimensions are: then all below is unrolled.
        let dims = self.plant.dims();
        let Dims { states: n, inputs: m } = dims;
        assert!(n <= SMALL && m <= SMALL, "a small plant");
        let Self { plant, h, substeps, points: Points { x, u, next, a, b }, .. } = self;
        let count = x.len() / n;
        let nothing = Dual { re: zero, eps: [zero; DIRECTIONS] };
        for begin in (0..count).step_by(V::LANES) {
            let filled = V::LANES.min(count - begin);
            // Lanes without a point repeat the last.
            let point = |lane: usize| begin + lane.min(filled - 1);
            for first in (0..n + m).step_by(DIRECTIONS) {
                let mut room = Small::new(nothing);
                let mut work = room.workspace(dims);
                for (j, to) in work.x.iter_mut().enumerate() {
                    to.re = zero.generate(|lane| x[point(lane) * n + j]);
                    set_direction(to, j, first);
                }
                for (j, to) in work.u.iter_mut().enumerate() {
                    to.re = zero.generate(|lane| u[point(lane) * m + j]);
                    set_direction(to, n + j, first);
                }
                work.run::<P, M>(plant, h, substeps);
                for (i, Dual { re, eps }) in work.x.iter().enumerate() {
                    let mut lanes = [0.0; WIDEST];
                    re.write(&mut lanes);
                    for (lane, value) in lanes.iter().enumerate().take(filled) {
                        next[point(lane) * n + i] = *value;
                    }
                    for (column, eps) in (first..n + m).zip(eps) {
                        eps.write(&mut lanes);
                        for (lane, derivative) in lanes.iter().enumerate().take(filled) {
                            let row = point(lane) * n + i;
                            if column < n {
                                a[row * n + column] = *derivative;
                            } else {
                                b[row * m + column - n] = *derivative;
                            }
                        }
                    }
                }
            }
        }
    }
}

/// Makes a number the variable of column `column`, where the first direction is that of column `first`.
#[inline(always)]
fn set_direction<V: Simd>(number: &mut Dual<V, DIRECTIONS>, column: usize, first: usize) {
    if let Some(direction) = column.checked_sub(first)
        && direction < DIRECTIONS
    {
        number.eps[direction] = number.re.constant(1.0);
    }
}

/// The variable of column `column` with this value, when the first lane stands for column `first`.
#[inline(always)]
fn seed<V: Simd>(zero: V, value: f64, first: usize, column: usize) -> Tangent<V> {
    let mut unit = [0.0; WIDEST];
    if (first..first + V::LANES).contains(&column) {
        unit[column - first] = 1.0;
    }
    Dual { re: Lanes::splat(value), eps: [Directions([zero.load(&unit)])] }
}
