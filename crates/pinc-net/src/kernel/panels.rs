//! Points in the layout of the kernel.

use crate::sampling::Points;
use pinc_ad::simd::Simd;
use pinc_ode::Dims;

/// A coordinate of the points of one panel: two vectors.
pub(super) type Pair<V> = [V; 2];

/// Points grouped into panels of two vectors; a panel holds the rows t, y0, u, p. The last panel is
/// filled up with copies of the last point, which its mask takes out of all sums.
#[derive(Debug)]
pub(super) struct Panels<V> {
    rows: usize,
    dims: Dims,
    data: Vec<Pair<V>>,
    targets: Vec<Target<V>>,
    errors: usize,
    ones: Pair<V>,
    last_mask: Pair<V>,
}

/// The target of a state at the points of one panel.
#[derive(Clone, Copy, Debug)]
pub(super) struct Target<V> {
    pub(super) value: Pair<V>,
    /// 1 in the lanes where it is known, 0 in the others.
    pub(super) known: Pair<V>,
}

/// One panel: each of `t`, `y0`, `u`, `p` in the plant's units.
#[derive(Clone, Copy, Debug)]
pub(super) struct Panel<'a, V> {
    pub(super) t: &'a Pair<V>,
    pub(super) y0: &'a [Pair<V>],
    pub(super) u: &'a [Pair<V>],
    pub(super) p: &'a [Pair<V>],
    /// The rows t, y0, u, p in one slice: the inputs of the net before normalization.
    pub(super) rows: &'a [Pair<V>],
    /// 1 in the lanes that count, 0 in the others.
    pub(super) mask: &'a Pair<V>,
    /// One per state; empty where states have no targets.
    pub(super) targets: &'a [Target<V>],
}

impl<V: Simd> Panels<V> {
    pub(super) fn new(points: &Points, dims: Dims, zero: V) -> Self {
        let width = 2 * V::LANES;
        let Dims { nx, nu, np, .. } = dims;
        let rows = 1 + nx + nu + np;
        let mut data = Vec::with_capacity(points.len().div_ceil(width) * rows);
        for first in (0..points.len()).step_by(width) {
            for row in 0..rows {
                data.push([0, 1].map(|half| {
                    zero.generate(|lane| {
                        let i = (first + half * V::LANES + lane).min(points.len() - 1);
                        match row {
                            0 => points.time(i),
                            row if row <= nx => points.state(i)[row - 1],
                            row if row <= nx + nu => points.input(i)[row - 1 - nx],
                            row => points.parameters(i)[row - 1 - nx - nu],
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
        let errors = points.len() * nx;
        Self { rows, dims, data, targets: Vec::new(), errors, ones, last_mask }
    }

    /// The same for `points` whose states are compared with `target` (of a point and a state),
    /// where it is known.
    pub(super) fn aimed(
        points: &Points,
        target: impl Fn(usize, usize) -> Option<f64>,
        dims: Dims,
        zero: V,
    ) -> Self {
        let mut panels = Self::new(points, dims, zero);
        let at = |first: usize, half: usize, lane: usize, state: usize| {
            let i = first + half * V::LANES + lane;
            if i < points.len() { target(i, state) } else { None }
        };
        for first in (0..points.len()).step_by(2 * V::LANES) {
            panels.targets.extend((0..dims.nx).map(|i| Target {
                value: [0, 1].map(|half| zero.generate(|l| at(first, half, l, i).unwrap_or(0.0))),
                known: [0, 1].map(|half| {
                    zero.generate(|l| if at(first, half, l, i).is_some() { 1.0 } else { 0.0 })
                }),
            }));
        }
        let known = |k: usize| (0..dims.nx).filter(|&i| target(k, i).is_some()).count();
        panels.errors = (0..points.len()).map(known).sum();
        panels
    }

    /// Number of errors in the mean over these points.
    pub(super) fn errors(&self) -> usize {
        self.errors
    }

    /// Number of panels.
    pub(super) fn len(&self) -> usize {
        self.data.len() / self.rows
    }

    #[inline(always)]
    pub(super) fn panel(&self, i: usize) -> Panel<'_, V> {
        let rows = &self.data[i * self.rows..(i + 1) * self.rows];
        let Dims { nx, nu, .. } = self.dims;
        let (y0, rest) = rows[1..].split_at(nx);
        let (u, p) = rest.split_at(nu);
        let mask = if i + 1 == self.len() { &self.last_mask } else { &self.ones };
        let targets = match self.targets.is_empty() {
            true => &[],
            false => &self.targets[i * nx..(i + 1) * nx],
        };
        Panel { t: &rows[0], y0, u, p, rows, mask, targets }
    }
}
