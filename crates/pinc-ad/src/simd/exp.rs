//! The exponential function in SIMD lanes.

use super::parts::FloatParts;

/// 1.5 * 2^52: adding it rounds a number to an integer.
const SHIFT: f64 = 6_755_399_441_055_744.0;

/// Beyond it e^x is infinite, below minus it 0.
const LIMIT: f64 = 1400.0;

/// ln 2 in two parts: whole multiples of the first up to 2^21 are exact.
const LN2_HIGH: f64 = 0.693_147_180_369_123_8;
const LN2_LOW: f64 = 1.908_214_929_270_587_7e-10;

/// 1/2!, 1/3!, .., 1/13!; the next term is below 2^-57 for |r| <= ln(2)/2.
const C: [f64; 12] = [
    1.0 / 2.0,
    1.0 / 6.0,
    1.0 / 24.0,
    1.0 / 120.0,
    1.0 / 720.0,
    1.0 / 5_040.0,
    1.0 / 40_320.0,
    1.0 / 362_880.0,
    1.0 / 3_628_800.0,
    1.0 / 39_916_800.0,
    1.0 / 479_001_600.0,
    1.0 / 6_227_020_800.0,
];

/// e^x, to within 2 units in the last place where the result is a normal number (tested over the
/// whole range); 0 and infinity beyond the range, NaN for NaN.
///
/// ```text
/// x = k ln 2 + r, |r| <= ln(2)/2,    e^x = 2^k (1 + r + r^2/2! + .. + r^13/13!)
/// ```
#[inline(always)]
pub(super) fn exp<V: FloatParts>(x: V) -> V {
    let number = |value| x.constant(value);
    let x = x.clamp(LIMIT);
    let k = x.mul_add(number(std::f64::consts::LOG2_E), number(SHIFT)) - SHIFT;
    let r = k.neg_mul_add(number(LN2_LOW), k.neg_mul_add(number(LN2_HIGH), x));
    let mut c = [x; C.len()];
    for (c, value) in c.iter_mut().zip(C) {
        *c = number(value);
    }
    let [c2, c3, c4, c5, c6, c7, c8, c9, c10, c11, c12, c13] = c;
    // Estrin's scheme: short chains of dependent operations.
    let (r2, one) = (r * r, number(1.0));
    let (r4, r8) = (r2 * r2, (r2 * r2) * (r2 * r2));
    let low = c3.mul_add(r, c2).mul_add(r2, r + one);
    let middle = c7.mul_add(r, c6).mul_add(r2, c5.mul_add(r, c4));
    let high = c11.mul_add(r, c10).mul_add(r2, c9.mul_add(r, c8));
    let series = c13.mul_add(r, c12).mul_add(r4, high).mul_add(r8, middle.mul_add(r4, low));
    series.times_power(k)
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use crate::simd::{Isa, Simd, Task};

    struct ExpOf(f64);

    impl Task for ExpOf {
        type Output = f64;
        #[inline(always)]
        fn run<V: Simd>(self, zero: V) -> f64 {
            let mut out = [0.0; 8];
            zero.constant(self.0).exp().write(&mut out);
            out[V::LANES - 1]
        }
    }

    /// The standard library's is correct to one unit.
    #[test]
    fn within_two_units_in_the_last_place() {
        for isa in Isa::available() {
            for i in -708_000..=709_700 {
                let x = f64::from(i) * 1e-3 + 1e-5;
                let (found, expected) = (isa.dispatch(ExpOf(x)), x.exp());
                let unit = expected * f64::EPSILON;
                assert!((found - expected).abs() <= 2.0 * unit, "{isa}, {x}: {found}, {expected}");
            }
        }
    }

    #[test]
    fn the_ends_of_the_range() {
        for isa in Isa::available() {
            let at = |x| isa.dispatch(ExpOf(x));
            for x in [0.0, -0.0, 1e-300, -1e-20] {
                assert!((at(x) - 1.0).abs() < 1e-15, "{isa}, {x}");
            }
            for x in [709.79, 710.0, 1e5, f64::INFINITY] {
                assert!(at(x).is_infinite() && at(x) > 0.0, "{isa}, {x}");
            }
            for x in [-746.0, -1e5, f64::NEG_INFINITY] {
                assert!(at(x).to_bits() == 0, "{isa}, {x}");
            }
            assert!(at(f64::NAN).is_nan(), "{isa}");
            // Subnormal numbers have fewer digits.
            assert!((at(-740.0) / (-740.0_f64).exp() - 1.0).abs() < 1e-3, "{isa}");
        }
    }
}
