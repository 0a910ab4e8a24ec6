//! Points in the layout of the kernel.

use crate::sampling::Points;
use pinc_ad::simd::Simd;
use pinc_ode::Dims;

/// A coordinate of the points of one panel: two vectors.
pub(super) type Pair<V> = [V; 2];

/// Points grouped into panels of two vectors; a panel holds the rows t, y0, u. The last panel is filled
/// up with copies of the last point, which its mask takes out of all sums.
#[derive(Debug)]
pub(super) struct Panels<V> {
    rows: usize,
    states: usize,
    data: Vec<Pair<V>>,
    points: usize,
    ones: Pair<V>,
    last_mask: Pair<V>,
}

/// One panel: each of `t`, `y0`, `u` in the plant's units.
#[derive(Clone, Copy, Debug)]
pub(super) struct Panel<'a, V> {
    pub(super) t: &'a Pair<V>,
    pub(super) y0: &'a [Pair<V>],
    pub(super) u: &'a [Pair<V>],
    /// The rows t, y0, u in one slice: the inputs of the net before normalization.
    pub(super) rows: &'a [Pair<V>],
    /// 1 in the lanes that count, 0 in the others.
    pub(super) mask: &'a Pair<V>,
}

impl<V: Simd> Panels<V> {
    pub(super) fn new(points: &Points, dims: Dims, zero: V) -> Self {
        let width = 2 * V::LANES;
        let rows = 1 + dims.states + dims.inputs;
        let mut data = Vec::with_capacity(points.len().div_ceil(width) * rows);
        for first in (0..points.len()).step_by(width) {
            for row in 0..rows {
                data.push([0, 1].map(|half| {
                    zero.generate(|lane| {
                        let i = (first + half * V::LANES + lane).min(points.len() - 1);
                        if row == 0 {
                            points.time(i)
                        } else if row <= dims.states {
                            points.state(i)[row - 1]
                        } else {
                            points.input(i)[row - 1 - dims.states]
                        }
                    })
                }));
            }
        }
        let in_last = points.len() - points.len().saturating_sub(1) / width * width;
        let last_mask = [0, 1].map(|half| {
            zero.generate(|lane| if half * V::LANES + lane < in_last { 1.0 } else { 0.0 })
        });
        let ones = [zero.constant(1.0); 2];
        Self { rows, states: dims.states, data, points: points.len(), ones, last_mask }
    }

    /// How many points there are.
    pub(super) fn points(&self) -> usize {
        self.points
    }

    /// How many panels there are.
    pub(super) fn len(&self) -> usize {
        self.data.len() / self.rows
    }

    #[inline(always)]
    pub(super) fn panel(&self, i: usize) -> Panel<'_, V> {
        let rows = &self.data[i * self.rows..(i + 1) * self.rows];
        let (y0, u) = rows[1..].split_at(self.states);
        let mask = if i + 1 == self.len() { &self.last_mask } else { &self.ones };
        Panel { t: &rows[0], y0, u, rows, mask }
    }
}
