//! Steady states: where f(x, u) = 0, with some of the states held at given values.

use crate::least_squares::{LeastSquares, minimize, squares};
use crate::state_space::{jacobian, rhs};
use crate::{OperatingPoint, Region};
use faer::Mat;
use faer::linalg::solvers::Solve;
use pinc_ode::DynRhs;

/// Starts of the search.
const STARTS: usize = 16;

/// How much rest counts against the distance from the values to be held: where both cannot be, a
/// steady state near them is wanted.
const REST: f64 = 100.0;

/// Distance from rest, in widths of the region, that counts as rest: how far the variables would
/// have to move for the rate of a state to vanish. A velocity would not do: a stiff state has a
/// large velocity a rounding error away from rest.
const AT_REST: f64 = 1e-8;

/// Distance from a value to be held that still counts as held, in widths of the region, or of what the
/// inputs move the state by if that is less: values are given with some three digits, and bounds of a state
/// may be anywhere beyond.
const HELD: f64 = 1e-3;

/// A state that moves so many widths of the region has another unit.
const WIDE: f64 = 100.0;

/// So many widths from the region there is nothing but a state that integrates, by rounding.
const FAR: f64 = 1e10;

/// The result of a search with values to be held.
#[derive(Clone, Debug, PartialEq)]
pub enum HeldPoint {
    /// A steady state within the bounds.
    Within(OperatingPoint),
    /// Only one outside of them.
    Outside(OperatingPoint),
    /// None; the nearest steady state found, if any was.
    Nowhere(Option<OperatingPoint>),
}

impl HeldPoint {
    /// The steady state, within the bounds or outside of them.
    #[must_use]
    pub fn steady(&self) -> Option<&OperatingPoint> {
        match self {
            Self::Within(point) | Self::Outside(point) => Some(point),
            Self::Nowhere(_) => None,
        }
    }
}

/// A search for steady states of a plant in and around a region.
///
/// It prefers steady states in the region, and among these the one nearest to `near`.
///
/// ```
/// use pinc_analysis::{HeldPoint, Region, SteadyStateSearch};
/// use pinc_ode::Dims;
/// use pinc_plants::VanDerPol;
///
/// let region = Region::new(Dims::new(2, 1), vec![-2.0, -2.0, -1.0], vec![2.0, 2.0, 1.0]);
/// let plant = VanDerPol::default();
/// let search = SteadyStateSearch::new(&plant, &region, 1);
/// // x1 = 1/2 is held by u = 1/2.
/// let HeldPoint::Within(point) = search.hold(&[(0, 0.5)], None) else { panic!() };
/// assert!((point.u[0] - 0.5).abs() < 1e-9);
/// ```
#[derive(Clone, Debug)]
pub struct SteadyStateSearch<'a> {
    plant: &'a dyn DynRhs,
    region: &'a Region,
    /// The units of the variables.
    widths: Vec<f64>,
    /// The sizes of the states, by which it is judged whether values are held.
    sizes: Vec<f64>,
    seed: u64,
    near: OperatingPoint,
}

impl<'a> SteadyStateSearch<'a> {
    /// A search near the middle of `region`.
    #[must_use]
    pub fn new(plant: &'a dyn DynRhs, region: &'a Region, seed: u64) -> Self {
        let (mut widths, mut sizes) = (region.widths(), region.widths());
        let moves = moves_at_rest(plant, region).unwrap_or_default();
        for ((width, size), moved) in widths.iter_mut().zip(&mut sizes).zip(moves) {
            if moved > WIDE * *width {
                *width = moved;
            }
            if moved > 0.0 {
                *size = size.min(moved);
            }
        }
        Self { plant, region, widths, sizes, seed, near: region.centre() }
    }

    /// Searches near another point, for instance the state that a plant starts from.
    #[must_use]
    pub fn near(self, near: OperatingPoint) -> Self {
        Self { near, ..self }
    }

    /// The steady state that holds the states at these places at these values, with the others and
    /// the inputs within `bounds` (lower and upper ends, states first) if there are any.
    #[must_use]
    pub fn hold(&self, held: &[(usize, f64)], bounds: Option<(&[f64], &[f64])>) -> HeldPoint {
        let bounded = self.bounds(bounds);
        let mut starts = self.starts();
        for start in &mut starts {
            for &(i, value) in held {
                start.x[i] = value;
            }
        }
        let (within, nearest) = self.best(held, &bounded, &starts);
        if let Some(point) = within {
            return HeldPoint::Within(point);
        }
        if bounds.is_none() {
            return HeldPoint::Nowhere(nearest);
        }
        match self.best(held, &self.bounds(None), &starts) {
            (Some(point), _) => HeldPoint::Outside(point),
            (None, nearest) => HeldPoint::Nowhere(nearest),
        }
    }

    /// Any steady state in the region, with whatever input in it: of a plant that integrates, say,
    /// which the input in the middle does not bring to rest.
    #[must_use]
    pub fn rest(&self) -> Option<OperatingPoint> {
        let ends = (self.region.low.clone(), self.region.high.clone());
        self.best(&[], &ends, &self.starts()).0
    }

    /// The steady state under the input `u`.
    #[must_use]
    pub fn settle(&self, u: &[f64]) -> Option<OperatingPoint> {
        let (mut low, mut high) = self.bounds(None);
        let n = self.region.dims.nx;
        low[n..].copy_from_slice(u);
        high[n..].copy_from_slice(u);
        let mut starts = self.starts();
        starts.iter_mut().for_each(|start| start.u.copy_from_slice(u));
        self.best(&[], &(low, high), &starts).0
    }

    fn bounds(&self, ends: Option<(&[f64], &[f64])>) -> (Vec<f64>, Vec<f64>) {
        let size = self.region.low.len();
        match ends {
            Some((low, high)) => (low.to_vec(), high.to_vec()),
            None => (vec![f64::NEG_INFINITY; size], vec![f64::INFINITY; size]),
        }
    }

    fn starts(&self) -> Vec<OperatingPoint> {
        let random = self.region.points(self.seed);
        [self.near.clone(), self.region.centre()].into_iter().chain(random).take(STARTS).collect()
    }

    /// The best steady state that holds the values, and the one that comes nearest to them.
    fn best(
        &self,
        held: &[(usize, f64)],
        ends: &(Vec<f64>, Vec<f64>),
        starts: &[OperatingPoint],
    ) -> (Option<OperatingPoint>, Option<OperatingPoint>) {
        let mut met: Option<(f64, OperatingPoint)> = None;
        let mut nearest: Option<(f64, OperatingPoint)> = None;
        for start in starts {
            let Some(point) = self.descend(held, ends, start) else { continue };
            let miss = held.iter().map(|&(i, value)| (point.x[i] - value).abs() / self.sizes[i]);
            let miss = miss.fold(0.0, f64::max);
            let (list, cost) = if miss <= HELD {
                (&mut met, self.region.distance(&point, &self.near))
            } else {
                (&mut nearest, miss)
            };
            let inside = self.region.contains(&point);
            // Any inside the region is better than all outside.
            let cost = if inside { cost } else { cost + 1e6 };
            if list.as_ref().is_none_or(|(least, _)| cost < *least) {
                *list = Some((cost, point));
            }
            if met.is_some() && inside {
                break;
            }
        }
        (met.map(|(_, point)| point), nearest.map(|(_, point)| point))
    }

    /// A steady state from `start`, near the values to be held, if the search ends in one.
    fn descend(
        &self,
        held: &[(usize, f64)],
        ends: &(Vec<f64>, Vec<f64>),
        start: &OperatingPoint,
    ) -> Option<OperatingPoint> {
        let widths = &self.widths;
        let scaled = |v: &[f64]| v.iter().zip(widths).map(|(v, w)| v / w).collect::<Vec<_>>();
        let start = start.joined();
        let mut problem = Rest {
            plant: self.plant,
            region: self.region,
            widths,
            held,
            low: scaled(&ends.0),
            high: scaled(&ends.1),
            row_scale: row_scale(self.plant, (self.region, widths), &start, REST, REST),
        };
        let mut v = minimize(&problem, &scaled(&start));
        // What is held was a wish; from here on rest alone counts.
        problem.held = &[];
        problem.row_scale =
            row_scale(self.plant, (self.region, widths), &problem.unscaled(&v), 1.0, 1.0);
        v = minimize(&problem, &v);
        let point = problem.unscaled(&v);
        // A rate that depends on nothing is at rest only where it is 0.
        let constant = 1.0 / f64::EPSILON;
        problem.row_scale = row_scale(self.plant, (self.region, widths), &point, 1.0, constant);
        let r = problem.residuals(&v);
        let rest = squares(&r).is_finite() && r.iter().all(|r| r.abs() <= AT_REST);
        rest.then(|| self.region.split(point))
    }
}

/// How far states move at rest while the inputs go over the region, to first order in its middle: the width
/// of a state without bounds, or with wide ones, says nothing. `None` where that is not to be had.
fn moves_at_rest(plant: &dyn DynRhs, region: &Region) -> Option<Vec<f64>> {
    let n = region.dims.nx;
    let widths = region.widths();
    let j = jacobian(plant, &region.centre());
    let by_inputs = Mat::from_fn(n, j.ncols() - n, |i, k| j[(i, n + k)] * widths[n + k]);
    let moved = j.subcols(0, n).to_owned().partial_piv_lu().solve(by_inputs);
    let moves = moved.row_iter().map(|row| row.iter().map(|by| by.abs()).sum::<f64>());
    let moves = moves.zip(&widths);
    moves.map(|(moved, width)| (moved <= FAR * *width).then_some(moved)).collect()
}

/// Factors that turn the rate of each state into a distance: over how many widths the variables
/// would have to move to change it by as much; `constant` for a rate that depends on nothing there.
fn row_scale(
    plant: &dyn DynRhs,
    (region, widths): (&Region, &[f64]),
    at: &[f64],
    weight: f64,
    constant: f64,
) -> Vec<f64> {
    let j = jacobian(plant, &region.split(Vec::from(at)));
    let row = |i: usize| {
        let terms = (0..j.ncols()).map(|k| (j[(i, k)] * widths[k]).powi(2));
        let length = terms.sum::<f64>().sqrt();
        if length > 0.0 && length.is_finite() { weight / length } else { constant }
    };
    (0..j.nrows()).map(row).collect()
}

/// Rest and held values as residuals, in variables that are measured in widths.
struct Rest<'a> {
    plant: &'a dyn DynRhs,
    region: &'a Region,
    widths: &'a [f64],
    held: &'a [(usize, f64)],
    low: Vec<f64>,
    high: Vec<f64>,
    row_scale: Vec<f64>,
}

impl Rest<'_> {
    fn unscaled(&self, v: &[f64]) -> Vec<f64> {
        v.iter().zip(self.widths).map(|(v, width)| v * width).collect()
    }
}

impl LeastSquares for Rest<'_> {
    fn residuals(&self, v: &[f64]) -> Vec<f64> {
        let at = self.unscaled(v);
        let (x, u) = at.split_at(self.region.dims.nx);
        let rates = rhs(self.plant, x, u).into_iter();
        let rest = rates.zip(&self.row_scale).map(|(f, scale)| f * scale);
        let held = self.held.iter().map(|&(i, value)| v[i] - value / self.widths[i]);
        rest.chain(held).collect()
    }

    fn jacobian(&self, v: &[f64]) -> Mat<f64> {
        let n = self.region.dims.nx;
        let f = jacobian(self.plant, &self.region.split(self.unscaled(v)));
        Mat::from_fn(n + self.held.len(), v.len(), |row, column| {
            if row < n {
                self.row_scale[row] * f[(row, column)] * self.widths[column]
            } else {
                f64::from(u8::from(self.held[row - n].0 == column))
            }
        })
    }

    fn ends(&self, k: usize) -> (f64, f64) {
        (self.low[k], self.high[k])
    }
}
