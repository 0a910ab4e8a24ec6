//! The inverse of the tangent in SIMD lanes.

use super::Simd;

/// For each part of the range: its end, the number c at which it is expanded, and the angle there,
/// as a number and its rounding error. Beyond the last part it is expanded at infinity. Source of
/// all numbers here: fdlibm, `s_atan.c`.
const PARTS: [[f64; 4]; 4] = [
    [0.437_5, 0.0, 0.0, 0.0],
    [0.687_5, 0.5, 0.463_647_609_000_806_1, 2.269_877_745_296_168_7e-17],
    [1.187_5, 1.0, std::f64::consts::FRAC_PI_4, 3.061_616_997_868_383e-17],
    [2.437_5, 1.5, 0.982_793_723_247_329, 1.390_331_103_123_099_8e-17],
];

/// What a right angle has lost.
const RIGHT_ANGLE_LOW: f64 = 6.123_233_995_736_766e-17;

/// (r - atan r)/r in powers of r^2, from the first, for |r| <= 7/16.
const C: [f64; 11] = [
    0.333_333_333_333_329_3,
    -0.199_999_999_998_764_83,
    0.142_857_142_725_034_66,
    -0.111_111_104_054_623_56,
    0.090_908_871_334_365_07,
    -0.076_918_762_050_448_3,
    0.066_610_731_373_875_31,
    -0.058_335_701_337_905_735,
    0.049_768_779_946_159_324,
    -0.036_531_572_744_216_916,
    0.016_285_820_115_365_782,
];

/// The angle in (-pi/2, pi/2) whose tangent is x, to within 2 units in the last place (tested over
/// the whole range).
///
/// ```text
/// atan x = atan c + atan r,    r = (x - c)/(1 + c x), or -1/x at infinity
/// ```
#[inline(always)]
pub(super) fn atan<V: Simd>(x: V) -> V {
    let number = |value| x.constant(value);
    let size = x.abs();
    let (mut above, mut below) = (number(-1.0), size);
    let (mut high, mut low) = (number(std::f64::consts::FRAC_PI_2), number(RIGHT_ANGLE_LOW));
    for [end, c, angle, lost] in PARTS.into_iter().rev() {
        let beyond = size - end;
        above = beyond.where_nonpositive(size - c, above);
        below = beyond.where_nonpositive(size.mul_add(number(c), number(1.0)), below);
        high = beyond.where_nonpositive(number(angle), high);
        low = beyond.where_nonpositive(number(lost), low);
    }
    let r = above / below;
    let square = r * r;
    let fourth = square * square;
    let (mut even, mut odd) = (number(C[10]), number(C[9]));
    for k in (0..5).rev() {
        even = even.mul_add(fourth, number(C[2 * k]));
    }
    for k in (0..4).rev() {
        odd = odd.mul_add(fourth, number(C[2 * k + 1]));
    }
    let series = even.mul_add(square, odd * fourth);
    let angle = high - ((r * series - low) - r);
    // The sum takes the sign from 0.
    x.where_nonpositive(-angle, angle) + 0.0
}

#[cfg(all(test, target_arch = "x86_64"))]
mod tests {
    use crate::simd::{Isa, Simd, Task};

    struct AtanOf(f64);

    impl Task for AtanOf {
        type Output = f64;
        #[inline(always)]
        fn run<V: Simd>(self, zero: V) -> f64 {
            let mut out = [0.0; 8];
            zero.constant(self.0).atan().write(&mut out);
            out[V::LANES - 1]
        }
    }

    /// The standard library's is correct to one unit.
    #[test]
    fn within_two_units_in_the_last_place() {
        let mut all: Vec<f64> = (0..60_000).map(|i| f64::from(i) * 5e-5).collect();
        all.extend((-700..=700).map(f64::from).map(f64::exp));
        for edge in [0.4375, 0.6875, 1.1875, 2.4375] {
            all.extend([f64::next_down(edge), edge, f64::next_up(edge)]);
        }
        all.extend([5e-324, f64::MIN_POSITIVE, f64::MAX, f64::INFINITY]);
        for isa in Isa::available() {
            for x in all.iter().flat_map(|&x| [x, -x]) {
                let (found, expected) = (isa.dispatch(AtanOf(x)), x.atan());
                let unit = expected.abs().next_up() - expected.abs();
                assert!(
                    (found - expected).abs() <= 2.0 * unit,
                    "{isa}, {x:e}: {found}, {expected}"
                );
            }
            assert!(isa.dispatch(AtanOf(f64::NAN)).is_nan(), "{isa}");
        }
    }
}
