//! Points within the bounds of unknown parameters.

use crate::problem::{Prior, Unknown};

/// The ratio of positive bounds from which on points are spread evenly in the logarithm.
const WIDE: f64 = 10.0;
/// The dimensions of the generator of Sobol sequences.
const DIMENSIONS: usize = 256;

/// Point `i` of a Sobol sequence that `seed` scrambles, within the bounds of some parameters.
/// Parameters whose bounds are positive and at least tenfold apart are spread evenly in the
/// logarithm. A bound that is infinite counts as ten times the start, on its side.
pub(crate) fn point<'u>(
    unknown: impl Iterator<Item = &'u Unknown>,
    i: usize,
    seed: u64,
) -> Vec<f64> {
    let coordinate = |(dimension, unknown): (usize, &Unknown)| {
        let (low, high) = unknown.range();
        let part = sobol(i, dimension, seed);
        let value = match low > 0.0 && high >= WIDE * low {
            true => low * (high / low).powf(part),
            false => low + part * (high - low),
        };
        value.max(low).min(high)
    };
    unknown.enumerate().map(coordinate).collect()
}

impl Unknown {
    /// Whether it is known between what its starts are spread: it has finite bounds or a prior.
    #[must_use]
    pub fn is_bounded(&self) -> bool {
        self.prior.is_some() || self.low.is_finite() && self.high.is_finite()
    }

    /// The bounds, with finite ones in the place of those that are not; with a prior, a range of
    /// its standard deviation.
    fn range(&self) -> (f64, f64) {
        if let Some(Prior { mean, sd }) = self.prior {
            let half = 3.0_f64.sqrt() * sd;
            return ((mean - half).max(self.low), (mean + half).min(self.high));
        }
        let size = if self.initial == 0.0 { 1.0 } else { 10.0 * self.initial.abs() };
        (self.low.max(-size), self.high.min(size))
    }
}

/// Coordinate `dimension` of point `i`, from 0 to 1.
fn sobol(i: usize, dimension: usize, seed: u64) -> f64 {
    let number = |of: usize| u32::try_from(of).unwrap_or(u32::MAX);
    // Dimensions and points beyond the generator's have another scramble.
    let round = number(dimension / DIMENSIONS).wrapping_add(number(i >> 16).wrapping_mul(31));
    #[expect(clippy::cast_possible_truncation, reason = "the two halves of the seed")]
    let scramble = (seed ^ (seed >> 32)) as u32;
    let (i, dimension) = (number(i % (1 << 16)), number(dimension % DIMENSIONS));
    f64::from(sobol_burley::sample(i, dimension, scramble.wrapping_add(round)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unknown(initial: f64, low: f64, high: f64) -> Unknown {
        Unknown { name: "k".to_owned(), place: 0, initial, low, high, prior: None }
    }

    fn spread(low: f64, high: f64) -> Vec<f64> {
        let unknown = unknown(high, low, high);
        (0..64).map(|i| point(std::iter::once(&unknown), i, 3)[0]).collect()
    }

    /// A quarter of the points is in each quarter of the range, as a Sobol sequence has it: of the
    /// logarithm's where the bounds are positive and tenfold apart.
    #[test]
    fn wide_positive_ranges_are_spread_in_the_logarithm() {
        for (low, high) in [(1e-3_f64, 10.0_f64), (2.0, 20.0)] {
            for (quarter, expected) in [(1.0, 16), (2.0, 32), (3.0, 48), (4.0, 64)] {
                let end = low * (high / low).powf(0.25 * quarter);
                let below = spread(low, high).into_iter().filter(|value| *value < end).count();
                assert_eq!(below, expected, "{low} to {high}");
            }
        }
        for (low, high) in [(-1.0, 3.0), (0.0, 10.0), (2.0, 19.0)] {
            for (quarter, expected) in [(1.0, 16), (2.0, 32), (3.0, 48), (4.0, 64)] {
                let end = low + 0.25 * quarter * (high - low);
                let below = spread(low, high).into_iter().filter(|value| *value < end).count();
                assert_eq!(below, expected, "{low} to {high}");
            }
        }
    }

    /// A bound that is infinite is ten times the start, or 1.
    #[test]
    fn infinite_bounds_are_ten_times_the_start() {
        let range = |initial: f64, low: f64, high: f64| unknown(initial, low, high).range();
        let infinity = f64::INFINITY;
        for (found, expected) in [
            (range(-3.0, -infinity, infinity), (-30.0, 30.0)),
            (range(0.0, -infinity, infinity), (-1.0, 1.0)),
            (range(2.0, 1.0, infinity), (1.0, 20.0)),
            (range(2.0, -infinity, 5.0), (-20.0, 5.0)),
        ] {
            assert!(
                (found.0 - expected.0).abs() + (found.1 - expected.1).abs() < 1e-12,
                "{found:?}"
            );
        }
    }
}
