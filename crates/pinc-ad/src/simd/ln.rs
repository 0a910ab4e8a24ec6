//! The natural logarithm in SIMD lanes.

use super::parts::FloatParts;

/// ln 2 in two parts: whole multiples of the first up to 2^20 are exact.
const LN2_HIGH: f64 = 0.693_147_180_369_123_8;
const LN2_LOW: f64 = 1.908_214_929_270_587_7e-10;

/// (ln((1 + s)/(1 - s)) - 2 s)/s in powers of s^2, from the first, for |s| <= 0.1716, to 2^-58.
/// Source: fdlibm, `e_log.c`.
const C: [f64; 7] = [
    0.666_666_666_666_673_5,
    0.399_999_999_994_094_2,
    0.285_714_287_436_623_9,
    0.222_221_984_321_497_84,
    0.181_835_721_616_180_5,
    0.153_138_376_992_093_73,
    0.147_981_986_051_165_86,
];

/// What lifts a number that is not normal to those that are.
const LIFT: f64 = 18_014_398_509_481_984.0;
const LIFT_EXPONENT: f64 = 54.0;

/// ln x, to within 2 units in the last place (tested over the whole range); -infinity at 0, NaN
/// below.
///
/// ```text
/// x = 2^k (1 + f), 1/sqrt 2 < 1 + f <= sqrt 2,    s = f/(2 + f)
/// ln x = k ln 2 + ln((1 + s)/(1 - s)) = k ln 2 + f - f^2/2 + s (f^2/2 + C1 s^2 + C2 s^4 + ..)
/// ```
#[inline(always)]
pub(super) fn ln<V: FloatParts>(x: V) -> V {
    let number = |value| x.constant(value);
    let subnormal = x - f64::MIN_POSITIVE;
    let lifted = subnormal.where_nonpositive(x * LIFT, x);
    let lift = subnormal.where_nonpositive(number(LIFT_EXPONENT), number(0.0));
    let (mantissa, exponent) = lifted.parts();
    let upper = mantissa - std::f64::consts::SQRT_2;
    let f = upper.where_nonpositive(mantissa, mantissa * 0.5) - 1.0;
    let k = upper.where_nonpositive(exponent, exponent + 1.0) - lift;
    let s = f / (f + 2.0);
    let square = s * s;
    let half = f * f * 0.5;
    let mut c = [x; C.len()];
    for (c, value) in c.iter_mut().zip(C) {
        *c = number(value);
    }
    let [c1, c2, c3, c4, c5, c6, c7] = c;
    let fourth = square * square;
    let low = c2.mul_add(square, c1);
    let middle = c4.mul_add(square, c3);
    let high = c7.mul_add(fourth, c6.mul_add(square, c5));
    let series = high.mul_add(fourth, middle).mul_add(fourth, low) * square;
    let small = s.mul_add(half + series, k * LN2_LOW);
    let result = k.mul_add(number(LN2_HIGH), f - (half - small));
    let result = (x - f64::MAX).where_nonpositive(result, x);
    let beyond = (-x).where_nonpositive(number(f64::NEG_INFINITY), number(f64::NAN));
    x.where_nonpositive(beyond, result)
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use crate::simd::{Isa, Simd, Task};

    struct LnOf(f64);

    impl Task for LnOf {
        type Output = f64;
        #[inline(always)]
        fn run<V: Simd>(self, zero: V) -> f64 {
            let mut out = [0.0; 8];
            zero.constant(self.0).ln().write(&mut out);
            out[V::LANES - 1]
        }
    }

    fn check(x: f64) {
        for isa in Isa::available() {
            let (found, expected) = (isa.dispatch(LnOf(x)), x.ln());
            let unit = expected.abs().next_up() - expected.abs();
            assert!((found - expected).abs() <= 2.0 * unit, "{isa}, {x:e}: {found}, {expected}");
        }
    }

    /// The standard library's is correct to one unit.
    #[test]
    fn within_two_units_in_the_last_place() {
        // The whole range, subnormal numbers included, and a close look around 1.
        for i in -74_400_i32..=70_900 {
            check((f64::from(i) * 1e-2).exp());
        }
        for i in -300_000_i32..=300_000 {
            check(1.0 + f64::from(i) * 3e-6);
        }
        for edge in [0.5, 1.0, 2.0, std::f64::consts::SQRT_2, std::f64::consts::FRAC_1_SQRT_2] {
            for x in [edge.next_down(), edge, edge.next_up()] {
                check(x);
            }
        }
        for x in [5e-324, f64::MIN_POSITIVE.next_down(), f64::MIN_POSITIVE, f64::MAX] {
            check(x);
        }
    }

    #[test]
    fn the_ends_of_the_range() {
        for isa in Isa::available() {
            let at = |x| isa.dispatch(LnOf(x));
            for x in [0.0, -0.0] {
                assert!(at(x).is_infinite() && at(x) < 0.0, "{isa}, {x}");
            }
            for x in [-5e-324, -1.0, f64::MIN, f64::NEG_INFINITY, f64::NAN] {
                assert!(at(x).is_nan(), "{isa}, {x}");
            }
            assert!(at(f64::INFINITY).is_infinite() && at(f64::INFINITY) > 0.0, "{isa}");
        }
    }
}
