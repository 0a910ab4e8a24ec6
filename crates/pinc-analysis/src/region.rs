//! Points and boxes of states and inputs.

use pinc_ode::Dims;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

/// A state and an input.
#[derive(Clone, Debug, PartialEq)]
pub struct OperatingPoint {
    /// The state, shape `nx`.
    pub x: Vec<f64>,
    /// The input, shape `nu`.
    pub u: Vec<f64>,
}

impl OperatingPoint {
    /// State and input in one list, states first.
    #[must_use]
    pub fn joined(&self) -> Vec<f64> {
        [&self.x[..], &self.u].concat()
    }

    /// The point with these values, of which the first `nx` are the state.
    pub(crate) fn split(mut values: Vec<f64>, nx: usize) -> Self {
        let u = values.split_off(nx);
        Self { x: values, u }
    }
}

/// A box of states and inputs, in which a plant is used. Its widths are the units in which
/// distances are measured, so that no result depends on the units of the variables.
///
/// ```
/// use pinc_analysis::Region;
/// use pinc_ode::Dims;
///
/// let region = Region::new(Dims::new(1, 1), vec![0.0, -1.0], vec![4.0, 1.0]);
/// assert_eq!(region.centre().x, [2.0]);
/// assert_eq!(region.enlarged(0.25).low, [-1.0, -1.5]);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Region {
    /// The plant's sizes.
    pub dims: Dims,
    /// Lower ends, states first, shape `nx + nu`.
    pub low: Vec<f64>,
    /// Upper ends, states first, shape `nx + nu`.
    pub high: Vec<f64>,
}

impl Region {
    /// The box from `low` to `high`, states first.
    ///
    /// # Panics
    ///
    /// If an end is missing.
    #[must_use]
    pub fn new(dims: Dims, low: Vec<f64>, high: Vec<f64>) -> Self {
        let size = dims.nx + dims.nu;
        assert!(low.len() == size && high.len() == size, "one end per state and input");
        Self { dims, low, high }
    }

    /// The width of variable `i`, states first; 1 for one that does not vary.
    #[must_use]
    pub fn width(&self, i: usize) -> f64 {
        let width = self.high[i] - self.low[i];
        if width > 0.0 { width } else { 1.0 }
    }

    /// All widths.
    #[must_use]
    pub fn widths(&self) -> Vec<f64> {
        (0..self.low.len()).map(|i| self.width(i)).collect()
    }

    /// The middle.
    #[must_use]
    pub fn centre(&self) -> OperatingPoint {
        let ends = self.low.iter().zip(&self.high);
        self.split(ends.map(|(low, high)| f64::midpoint(*low, *high)).collect())
    }

    /// The box with `share` of each width added at both of its ends.
    #[must_use]
    pub fn enlarged(&self, share: f64) -> Self {
        let by = |i: usize| share * (self.high[i] - self.low[i]);
        let low = self.low.iter().enumerate().map(|(i, v)| v - by(i)).collect();
        let high = self.high.iter().enumerate().map(|(i, v)| v + by(i)).collect();
        Self { dims: self.dims, low, high }
    }

    /// Points that are equally distributed in the box; the same for the same seed.
    pub fn points(&self, seed: u64) -> impl Iterator<Item = OperatingPoint> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        std::iter::repeat_with(move || {
            let ends = self.low.iter().zip(&self.high);
            self.split(ends.map(|(low, high)| low + (high - low) * rng.random::<f64>()).collect())
        })
    }

    /// Points where functions are most likely to break: with one variable at an end or at 0, the
    /// others in the middle, and the two outermost corners.
    #[must_use]
    pub fn special_points(&self) -> Vec<OperatingPoint> {
        let middle = self.centre().joined();
        let mut points = vec![self.split(self.low.clone()), self.split(self.high.clone())];
        for i in 0..middle.len() {
            let inside = |v: &f64| (self.low[i]..=self.high[i]).contains(v);
            for value in [self.low[i], self.high[i], 0.0].into_iter().filter(inside) {
                let mut point = middle.clone();
                point[i] = value;
                points.push(self.split(point));
            }
        }
        points
    }

    /// The largest distance of two points in a variable, in widths.
    #[must_use]
    pub fn distance(&self, one: &OperatingPoint, other: &OperatingPoint) -> f64 {
        let pairs = one.joined().into_iter().zip(other.joined()).enumerate();
        pairs.map(|(i, (a, b))| (a - b).abs() / self.width(i)).fold(0.0, f64::max)
    }

    /// Whether two points are one, to a millionth of the box.
    #[must_use]
    pub fn same(&self, one: &OperatingPoint, other: &OperatingPoint) -> bool {
        self.distance(one, other) <= 1e-6
    }

    /// Whether a point is in the box, or at most a millionth of a width outside.
    #[must_use]
    pub fn contains(&self, point: &OperatingPoint) -> bool {
        point.joined().into_iter().enumerate().all(|(i, v)| {
            let slack = 1e-6 * self.width(i);
            v >= self.low[i] - slack && v <= self.high[i] + slack
        })
    }

    /// The point with these values, states first.
    #[must_use]
    pub fn split(&self, values: Vec<f64>) -> OperatingPoint {
        OperatingPoint::split(values, self.dims.nx)
    }
}
