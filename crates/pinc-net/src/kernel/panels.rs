//! Points in the layout of the kernel.

use crate::Measurements;
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
    /// For each panel the directions, one row per y0, u and p, then the slopes, one per state.
    slopes: Vec<Pair<V>>,
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
    /// Where the derivatives along a direction have targets.
    pub(super) slopes: Option<Slopes<'a, V>>,
}

/// The direction of each point of a panel, and the derivatives of its states along it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slopes<'a, V> {
    /// The rows y0, u, p.
    pub(super) direction: &'a [Pair<V>],
    /// One per state.
    pub(super) value: &'a [Pair<V>],
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
        let (targets, slopes) = (Vec::new(), Vec::new());
        Self { rows, dims, data, targets, slopes, errors, ones, last_mask }
    }

    /// The panels of `points` whose states are compared with `target` (of a point and a state),
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

    /// Adds the derivatives that `measurements`, of the same points, have at each of these.
    pub(super) fn add_slopes(&mut self, measurements: &Measurements, zero: V) {
        for first in (0..measurements.len()).step_by(2 * V::LANES) {
            for row in 0..self.rows - 1 + self.dims.nx {
                self.slopes.push([0, 1].map(|half| {
                    zero.generate(|lane| {
                        let i = (first + half * V::LANES + lane).min(measurements.len() - 1);
                        let Some((direction, slope)) = measurements.slope(i) else { return 0.0 };
                        let known = direction.get(row);
                        *known.unwrap_or_else(|| &slope[row - direction.len()])
                    })
                }));
            }
        }
    }

    /// Whether derivatives are fitted.
    pub(super) fn has_slopes(&self) -> bool {
        !self.slopes.is_empty()
    }

    /// Number of errors of a point: one per state, and one more where derivatives are fitted.
    pub(super) fn point_errors(&self) -> usize {
        if self.has_slopes() { 2 * self.dims.nx } else { self.dims.nx }
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
        let slopes = self.has_slopes().then(|| {
            let width = self.rows - 1 + nx;
            let rows = &self.slopes[i * width..(i + 1) * width];
            let (direction, value) = rows.split_at(width - nx);
            Slopes { direction, value }
        });
        Panel { t: &rows[0], y0, u, p, rows, mask, targets, slopes }
    }
}
