//! Points in the lanes of vectors.

use crate::points::Points;
use crate::{Dims, Stages};
use pinc_ad::simd::Simd;

/// Lanes of the widest vector.
pub(crate) const WIDEST: usize = 8;

/// Writes the variables of points from the one numbered `begin` on to the first places of `memory`;
/// lanes without a point repeat the last. Gives the number of points.
#[inline(always)]
pub(super) fn load<V: Simd>(
    memory: &mut [V],
    dims: Dims,
    points: Stages<'_>,
    begin: usize,
    zero: V,
) -> usize {
    let Dims { nx, nu, np, .. } = dims;
    let filled = V::LANES.min(points.x.len() / nx - begin);
    let (x, rest) = memory.split_at_mut(nx);
    let (u, rest) = rest.split_at_mut(nu);
    for (to, from) in [(x, points.x), (u, points.u), (&mut rest[..np], points.p)] {
        let width = to.len();
        for (j, to) in to.iter_mut().enumerate() {
            *to = zero.generate(|lane| from[(begin + lane.min(filled - 1)) * width + j]);
        }
    }
    filled
}

/// Gives each of the first `filled` lanes to `to`.
#[inline(always)]
pub(crate) fn scatter<V: Simd>(vector: V, filled: usize, mut to: impl FnMut(usize, f64)) {
    let mut lanes = [0.0; WIDEST];
    vector.write(&mut lanes);
    lanes.iter().enumerate().take(filled).for_each(|(lane, &value)| to(lane, value));
}

/// Copies numbers from their places.
#[inline(always)]
pub(super) fn gather<V: Simd>(to: &mut [V], places: &[u16], memory: &[V]) {
    for (to, &place) in to.iter_mut().zip(places) {
        *to = memory[usize::from(place)];
    }
}

/// Writes the states x with their derivatives by the first `columns` variables, `derivative` of the
/// state and the variable, to `filled` points from the one numbered `begin` on.
#[inline(always)]
pub(super) fn store<V: Simd>(
    points: &mut Points<'_>,
    dims: Dims,
    x: &[V],
    (begin, filled, columns): (usize, usize, usize),
    derivative: impl Fn(usize, usize) -> V,
) {
    for (i, &x) in x.iter().enumerate() {
        let row = |lane: usize| (begin + lane) * dims.nx + i;
        scatter(x, filled, |lane, value| points.out.next[row(lane)] = value);
        for column in 0..columns {
            scatter(derivative(i, column), filled, |lane, derivative| {
                points.set(dims, row(lane), column, derivative);
            });
        }
    }
}
