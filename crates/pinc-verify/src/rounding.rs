//! Upper bounds of what rounding to nearest loses.
//!
//! No rounding mode is changed. Sums and products of numbers that are not negative are computed as
//! they are and then enlarged by [`UP`], which covers up to 10^5 roundings in a row: each changes a
//! result by a factor of 1 + u at most, with u = 2^-53, and (1 + u)^(10^5) < 1 + 2e-11.

/// The unit roundoff u of `f64`.
pub(crate) const UNIT: f64 = f64::EPSILON / 2.0;

/// See the module.
const UP: f64 = 1.0 + 1e-10;

/// An upper bound of what `value`, computed from up to 10^5 operations on numbers that are not
/// negative, would be without rounding. The sum covers results that underflow.
#[inline(always)]
pub(crate) fn up(value: f64) -> f64 {
    value * UP + f64::MIN_POSITIVE
}

/// The number as an `f64`.
pub(crate) fn to_f64(count: usize) -> f64 {
    count as f64
}
