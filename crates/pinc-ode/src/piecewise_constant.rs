//! Piecewise-constant signals.

use crate::OdeError;

/// A piecewise-constant signal of time: inputs under zero-order hold, references in steps.
///
/// Value `i` holds on `[start_i, start_(i+1))`, the last one for ever.
#[derive(Clone, Debug, PartialEq)]
pub struct PiecewiseConstant {
    starts_s: Vec<f64>,
    values: Vec<Vec<f64>>,
}

impl PiecewiseConstant {
    /// The signal that takes `values[i]` from `starts_s[i]` on.
    ///
    /// # Errors
    ///
    /// [`OdeError::PiecewiseConstant`] if there is no value, the lengths differ, the times do not
    /// start at 0 and increase, or the values are of different lengths or not finite.
    pub fn new(starts_s: Vec<f64>, values: Vec<Vec<f64>>) -> Result<Self, OdeError> {
        let reason = if starts_s.first() != Some(&0.0) {
            Some("the first start time is not 0")
        } else if starts_s.len() != values.len() {
            Some("there are not as many values as start times")
        } else if !starts_s.is_sorted_by(|a, b| a < b) || starts_s.iter().any(|t| !t.is_finite()) {
            Some("the start times do not increase")
        } else if values.iter().any(|v| v.len() != values[0].len()) {
            Some("the values are of different lengths")
        } else if values.iter().flatten().any(|v| !v.is_finite()) {
            Some("a value is not finite")
        } else {
            None
        };
        match reason {
            Some(reason) => Err(OdeError::PiecewiseConstant { reason }),
            None => Ok(Self { starts_s, values }),
        }
    }

    /// How many numbers a value has.
    #[must_use]
    pub fn width(&self) -> usize {
        self.values[0].len()
    }

    /// When the last value begins, in s.
    #[must_use]
    pub fn last_start_s(&self) -> f64 {
        self.starts_s.last().copied().unwrap_or(0.0)
    }

    /// The value at `t` seconds. A time that differs from a later start time only by rounding
    /// counts as that start, so that `at(k as f64 * step)` is what one expects. "Only by rounding"
    /// means by a relative 1e-11, and by no more than a thousandth of the interval before the
    /// start.
    #[must_use]
    pub fn at(&self, t: f64) -> &[f64] {
        let next = self.starts_s.partition_point(|&start| start <= t);
        let current = next.saturating_sub(1);
        let (before, start) = (self.starts_s[current], self.starts_s.get(next));
        let is_start = |start: f64| start - t <= (1e-11 * start).min(1e-3 * (start - before));
        let reached = start.is_some_and(|&start| next > 0 && is_start(start));
        &self.values[if reached { next } else { current }]
    }
}
