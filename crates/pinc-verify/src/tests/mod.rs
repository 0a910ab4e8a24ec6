//! Enclosures against exact rationals, and against what is known of flows.

mod arithmetic;
mod bounds;
mod elementary;
mod fits;
mod flows;
mod outward;
mod sums;

use num_rational::BigRational;
use num_traits::Zero;

/// The number itself, exactly.
pub(crate) fn exact(value: f64) -> BigRational {
    BigRational::from_float(value).expect("a finite number")
}

/// Whether |a - b| <= bound, exactly.
pub(crate) fn within(a: &BigRational, b: &BigRational, bound: f64) -> bool {
    let distance = if a > b { a - b } else { b - a };
    distance <= exact(bound)
}

/// x^n.
pub(crate) fn power(x: &BigRational, n: u8) -> BigRational {
    (0..n).fold(exact(1.0), |product, _| product * x)
}

pub(crate) fn zero() -> BigRational {
    BigRational::zero()
}

/// Numbers with all bits of a mantissa, of both signs.
#[derive(Clone, Debug)]
pub(crate) struct Numbers(u64);

impl Numbers {
    pub(crate) fn new() -> Self {
        Self(20_201_007)
    }

    /// Between 0 and 1 (by `SplitMix64`).
    pub(crate) fn share(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        // The exponent of 1 before the 52 highest bits.
        f64::from_bits((z ^ (z >> 31)) >> 12 | 0x3ff0_0000_0000_0000) - 1.0
    }

    /// Between `low` and `high`.
    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + self.share() * (high - low)
    }

    /// Of any order of magnitude between 1e-6 and 1e6, and of either sign.
    pub(crate) fn of_any_size(&mut self) -> f64 {
        let size = 10.0_f64.powf(self.between(-6.0, 6.0));
        if self.share() < 0.5 { -size } else { size }
    }

    pub(crate) fn many(&mut self, count: usize, low: f64, high: f64) -> Vec<f64> {
        (0..count).map(|_| self.between(low, high)).collect()
    }
}
