//! The hyperbolic tangent in SIMD lanes.

use crate::simd::Simd;

/// 1.5 * 2^52: adding it rounds a number to a whole one, which then stands in the low bits.
const SHIFT: f64 = 6_755_399_441_055_744.0;

/// Beyond it tanh is 1 to rounding, and 2^k stays far from overflow.
const LIMIT: f64 = 40.0;

/// ln 2 = HIGH + LOW; HIGH has 33 bits, so that k * HIGH is exact for |k| < 2^20.
const LN_2_HIGH: f64 = 0.693_147_180_485_539_1;
const LN_2_LOW: f64 = 7.440_617_110_012_397e-11;

/// q in e^r - 1 = r + r^2 q(r) on |r| <= ln(2)/2, by Chebyshev interpolation in 60 digits; the error is
/// 4.1e-17 of e^r - 1.
const Q: [f64; 10] = [
    0.500_000_000_000_000_1,
    0.166_666_666_666_666_69,
    0.041_666_666_666_624_13,
    0.008_333_333_333_330_062,
    0.001_388_888_891_721_371_7,
    0.000_198_412_698_630_536_18,
    2.480_152_129_595_437_6e-5,
    2.755_726_845_999_706_4e-6,
    2.762_008_844_540_974_6e-7,
    2.510_038_549_551_032e-8,
];

/// tanh of several vectors, each to within 3 units in the last place (tested over the whole range); odd
/// to within rounding, NaN for NaN, +-1 for +-infinity.
///
/// ```text
/// tanh x = (e^y - 1)/(e^y + 1)      with y = 2x = k ln 2 + r, p = e^r - 1:
///        = (2^k p + (2^k - 1)) / (2^k p + (2^k + 1))
/// ```
///
/// It is one long chain of dependent operations. Several vectors go through it side by side, stage by
/// stage, so that the processor always has independent work at hand.
#[inline(always)]
pub fn tanh_all<V: Simd, const N: usize>(x: &mut [V; N]) {
    let zero = x[0].constant(0.0);
    let (mut r, mut power, mut q) = ([zero; N], [zero; N], [zero; N]);
    for i in 0..N {
        let y = (x[i] + x[i]).clamp(LIMIT);
        let shifted = y.mul_add(zero.constant(std::f64::consts::LOG2_E), zero.constant(SHIFT));
        let k = shifted - SHIFT;
        r[i] = k.neg_mul_add(zero.constant(LN_2_HIGH), y);
        r[i] = k.neg_mul_add(zero.constant(LN_2_LOW), r[i]);
        power[i] = shifted.exp2_of_shifted();
    }
    for i in 0..N {
        q[i] = polynomial(r[i]);
    }
    for i in 0..N {
        let p = (r[i] * r[i]).mul_add(q[i], r[i]);
        x[i] = power[i].mul_add(p, power[i] - 1.0) / power[i].mul_add(p, power[i] + 1.0);
    }
}

/// q(r) by Estrin's scheme: as many operations as Horner's, but chains half as long.
#[inline(always)]
fn polynomial<V: Simd>(r: V) -> V {
    let pair = |i: usize| r.constant(Q[i + 1]).mul_add(r, r.constant(Q[i]));
    let square = r * r;
    let fourth = square * square;
    let low = pair(2).mul_add(square, pair(0));
    let high = pair(6).mul_add(square, pair(4));
    fourth.mul_add(fourth.mul_add(pair(8), high), low)
}

/// tanh of one vector: see [`tanh_all`].
#[inline(always)]
pub(super) fn tanh<V: Simd>(x: V) -> V {
    let mut one = [x];
    tanh_all(&mut one);
    one[0]
}

#[cfg(test)]
mod tests {
    use crate::simd::{Isa, Simd, Task};

    struct Tanh<'a>(&'a [f64]);

    impl Task for Tanh<'_> {
        type Output = Vec<f64>;
        #[inline(always)]
        fn run<V: Simd>(self, zero: V) -> Vec<f64> {
            let mut out = vec![0.0; self.0.len()];
            for (x, y) in self.0.chunks_exact(V::LANES).zip(out.chunks_exact_mut(V::LANES)) {
                super::tanh(zero.generate(|i| x[i])).write(y);
            }
            out
        }
    }

    /// A multiple of every vector length, from denormal to beyond saturation, both signs.
    fn grid() -> Vec<f64> {
        let mut x: Vec<f64> = (0..40_000).map(|i| f64::from(i) * 5.5e-4 - 11.0).collect();
        x.extend((0..8_000).map(|i| 2.0_f64.powf(-f64::from(i) * 0.13)));
        x.extend([0.0, -0.0, 25.0, -25.0, 1e300, -1e300, 19.0, 22.0]);
        x
    }

    #[test]
    fn within_three_units_in_the_last_place_of_the_true_value() {
        for isa in Isa::available() {
            let x = grid();
            for (x, y) in x.iter().zip(isa.dispatch(Tanh(&x))) {
                // std's tanh is itself within 1 unit of the true value.
                let expected = x.tanh();
                let unit = expected.abs().next_up() - expected.abs();
                assert!((y - expected).abs() <= 3.0 * unit, "{isa}: tanh {x:e} = {y:e}");
            }
        }
    }

    #[test]
    fn not_finite_arguments() {
        let x = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 0.0, f64::NAN, 1e308, -1e308, 0.0];
        for isa in Isa::available() {
            let y = isa.dispatch(Tanh(&x));
            assert!(y[0].is_nan() && y[4].is_nan(), "{isa}: {y:?}");
            for (i, expected) in [(1, 1.0), (2, -1.0), (3, 0.0), (5, 1.0), (6, -1.0_f64)] {
                assert!((y[i] - expected).abs() < f64::EPSILON, "{isa}: {y:?}");
            }
        }
    }
}
