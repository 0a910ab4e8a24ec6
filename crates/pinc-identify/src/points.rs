//! Points within the bounds of unknown parameters.

use crate::problem::Unknown;

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
    /// Whether both bounds are finite.
    pub(crate) fn is_bounded(&self) -> bool {
        self.low.is_finite() && self.high.is_finite()
    }

    /// The bounds, with finite ones in the place of those that are not.
    fn range(&self) -> (f64, f64) {
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
