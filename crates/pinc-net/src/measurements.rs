//! Measurements of the plant, to which a net can be fitted beside the plant's equation.

use crate::sampling::Points;
use pinc_ode::Dims;

/// Measured states: y(t), `t` seconds after the plant was in y0, under the constant input u. Any of
/// the states may be missing.
///
/// Where the derivative of y(t) along a direction v of (y0, u, p) is known as well, the net's can
/// be fitted to it: each point has one, or none has.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measurements {
    states: usize,
    points: Points,
    values: Vec<Option<f64>>,
    directions: Vec<f64>,
    slopes: Vec<f64>,
}

/// One row of a recorded trajectory.
#[derive(Clone, Debug, PartialEq)]
pub struct Recorded {
    /// Time in s.
    pub t: f64,
    /// The input from this row to the next, one number per input.
    pub input: Vec<f64>,
    /// The measured states; `None` where there is no measurement.
    pub state: Vec<Option<f64>>,
}

impl Measurements {
    /// No measurements yet, of a plant of these dimensions.
    #[must_use]
    pub fn new(dims: Dims) -> Self {
        Self { states: dims.nx, points: Points::new(dims), ..Self::default() }
    }

    /// Adds the measured states `y`, `t` seconds after `y0` under the input `u`, of the plant with
    /// the parameters `p`.
    ///
    /// # Panics
    ///
    /// If a length is not the plant's.
    pub fn push(&mut self, t: f64, y0: &[f64], u: &[f64], p: &[f64], y: &[Option<f64>]) {
        assert_eq!(y.len(), self.states, "length of y");
        self.points.push(t, y0, u, p);
        self.values.extend_from_slice(y);
    }

    /// Adds the derivative `slope` of y(t) along `direction`, at the first point that has none.
    ///
    /// # Shapes
    ///
    /// `direction`: `nx + nu + np`, of y0, u and p; `slope`: `nx`.
    ///
    /// # Panics
    ///
    /// If a length is not the plant's, or each point has its derivative already.
    pub fn push_slope(&mut self, direction: &[f64], slope: &[f64]) {
        assert!(self.slopes.len() < self.values.len(), "one derivative per point");
        assert_eq!(slope.len(), self.states, "length of the derivative");
        let k = self.slopes.len() / self.states;
        let at = [self.points.state(k), self.points.input(k), self.points.parameters(k)];
        assert_eq!(direction.len(), at.concat().len(), "length of the direction");
        self.directions.extend_from_slice(direction);
        self.slopes.extend_from_slice(slope);
    }

    /// Adds a recorded trajectory, its rows in the order of time: every row with all states
    /// measured is the y0 of the rows up to `sample_time_s` after it, as long as the input stays
    /// the same. Rows that follow no such row are ignored. The plant's parameters were `p`.
    ///
    /// # Panics
    ///
    /// As [`Measurements::push`].
    pub fn push_trajectory(&mut self, sample_time_s: f64, p: &[f64], rows: &[Recorded]) {
        for (i, start) in rows.iter().enumerate() {
            let Some(y0) = start.state.iter().copied().collect::<Option<Vec<f64>>>() else {
                continue;
            };
            for (row, held) in rows[i + 1..].iter().zip(&rows[i..]) {
                let t = row.t - start.t;
                // Times are rounded, and sums of such: the end of a step still belongs to it.
                let end = sample_time_s * (1.0 + 1e-9) + 2.0 * f64::EPSILON * row.t.abs();
                if t > end || held.input != start.input {
                    break;
                }
                if row.state.iter().any(Option::is_some) {
                    self.push(t.min(sample_time_s), &y0, &start.input, p, &row.state);
                }
            }
        }
    }

    /// Number of points (t, y0, u, p).
    #[must_use]
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// Whether there are no points.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.points.is_empty()
    }

    /// The points (t, y0, u, p).
    #[must_use]
    pub fn points(&self) -> &Points {
        &self.points
    }

    /// The measured states at point `i`.
    #[must_use]
    pub fn state(&self, i: usize) -> &[Option<f64>] {
        &self.values[i * self.states..(i + 1) * self.states]
    }

    /// The direction at point `i` and the derivative along it; `None` unless every point has one.
    #[must_use]
    pub fn slope(&self, i: usize) -> Option<(&[f64], &[f64])> {
        if !self.has_slopes() {
            return None;
        }
        let width = self.directions.len() / self.len();
        let direction = &self.directions[i * width..(i + 1) * width];
        Some((direction, &self.slopes[i * self.states..(i + 1) * self.states]))
    }

    /// Whether every point has a derivative, of at least one point.
    #[must_use]
    pub fn has_slopes(&self) -> bool {
        !self.slopes.is_empty() && self.slopes.len() == self.values.len()
    }

    /// Number of measured values, over all points and states.
    #[must_use]
    pub fn values(&self) -> usize {
        self.values.iter().flatten().count()
    }
}
