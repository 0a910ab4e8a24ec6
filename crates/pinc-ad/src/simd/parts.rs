//! Numbers by their parts: exponents of 2 and what is left.

use crate::simd::Simd;

/// Vectors whose numbers can be taken apart and scaled by powers of 2.
pub(super) trait FloatParts: Simd {
    /// m in [1, 2) and k with `self = 2^k m`, for positive normal numbers.
    fn parts(self) -> (Self, Self);

    /// `self` 2^k, rounded once, for whole k of a size up to 2044.
    fn times_power(self, k: Self) -> Self;
}
