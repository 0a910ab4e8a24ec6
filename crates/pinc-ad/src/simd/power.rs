//! Powers in SIMD lanes.

use super::Simd;

/// x^p, for p that is not whole: e^(p ln x), to within 4 + 3 |p ln x| units in the last place where
/// the result is a normal number. NaN below 0.
#[inline(always)]
pub(super) fn powf<V: Simd>(x: V, p: f64) -> V {
    (x.ln() * p).exp()
}

/// Whether [`powf`] is for this exponent. Whole ones have powers of numbers below 0.
#[inline(always)]
pub(super) fn is_partial(p: f64) -> bool {
    p.is_finite() && p.fract() != 0.0
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use crate::simd::{Isa, Simd, Task};

    struct PowerOf(f64, f64);

    impl Task for PowerOf {
        type Output = f64;
        #[inline(always)]
        fn run<V: Simd>(self, zero: V) -> f64 {
            let mut out = [0.0; 8];
            zero.constant(self.0).powf(self.1).write(&mut out);
            out[V::LANES - 1]
        }
    }

    /// The standard library's is correct to one unit.
    #[test]
    fn within_some_units_in_the_last_place() {
        for isa in Isa::available() {
            for i in -2_000..=2_000 {
                let x = (f64::from(i) * 0.3371).exp();
                for p in [0.25, 0.7, 1.0 / 3.0, 1.3, 1.75, 2.5, -0.5, -1.2, 33.5] {
                    let (found, expected) = (isa.dispatch(PowerOf(x, p)), x.powf(p));
                    if !expected.is_normal() {
                        continue;
                    }
                    let unit = expected.next_up() - expected;
                    let units = 4.0 + 3.0 * (p * x.ln()).abs();
                    let error = (found - expected).abs();
                    assert!(error <= units * unit, "{isa}, {x:e}^{p}: {found:e}, {expected:e}");
                }
            }
        }
    }

    #[test]
    fn ends_of_the_range_and_whole_exponents() {
        for isa in Isa::available() {
            let power = |x, p| isa.dispatch(PowerOf(x, p));
            for x in [0.0, -0.0] {
                assert!(power(x, 0.7) == 0.0 && power(x, -0.7) == f64::INFINITY, "{isa}");
            }
            assert!(power(f64::INFINITY, 0.7) == f64::INFINITY, "{isa}");
            assert!(power(f64::INFINITY, -0.7) == 0.0, "{isa}");
            assert!(power(-1.0, 0.7).is_nan() && power(f64::NAN, 0.7).is_nan(), "{isa}");
            assert!(power(1.0, 0.7).to_bits() == 1.0_f64.to_bits(), "{isa}");
            for (x, p) in
                [(-1.5, 33.0), (-2.0, -35.0), (-0.0, -33.0), (3.0, 0.0), (1.0, f64::INFINITY)]
            {
                assert!(power(x, p).to_bits() == f64::powf(x, p).to_bits(), "{isa}, {x}^{p}");
            }
        }
    }
}
