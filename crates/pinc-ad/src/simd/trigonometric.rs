//! Sine, cosine and tangent in SIMD lanes.

use crate::simd::Simd;

/// 1.5 * 2^52: adding it rounds a number to an integer.
const SHIFT: f64 = 6_755_399_441_055_744.0;

/// Lanes beyond it, and those that are not numbers, have the functions of the standard library:
/// whole multiples of the parts of pi/2 up to this angle are exact.
const LIMIT: f64 = 1e6;

/// pi/2 in three parts of 33 bits each, and the rest.
const RIGHT_ANGLE: [f64; 4] = [
    1.570_796_326_734_125_6,
    6.077_100_506_303_966e-11,
    2.022_266_248_711_166_5e-21,
    8.478_427_660_368_9e-32,
];

/// (sin r - r)/r^3 in powers of r^2 for |r| <= pi/4, to 2^-58. Source: fdlibm, `k_sin.c`.
const SINE: [f64; 6] = [
    -0.166_666_666_666_666_32,
    0.008_333_333_333_322_49,
    -0.000_198_412_698_298_579_5,
    2.755_731_370_707_006_8e-6,
    -2.505_076_025_340_686_3e-8,
    1.589_690_995_211_55e-10,
];

/// (cos r - 1 + r^2/2)/r^4 likewise. Source: fdlibm, `k_cos.c`.
const COSINE: [f64; 6] = [
    0.041_666_666_666_666_6,
    -0.001_388_888_888_887_411,
    2.480_158_728_947_673e-5,
    -2.755_731_435_139_066_3e-7,
    2.087_572_321_298_175e-9,
    -1.135_964_755_778_819_5e-11,
];

/// The sine, to within 2 units in the last place for angles up to 1e6; beyond, the standard
/// library's sine.
///
/// ```text
/// x = k pi/2 + r, |r| <= pi/4,    sin x = +-sin r or +-cos r, as k mod 4 says
/// ```
#[inline(always)]
pub fn sin<V: Simd>(x: V) -> V {
    let near = Reduced::of(x).sine(0.0);
    if is_small(x) { near } else { with_far_lanes(near, x, f64::sin) }
}

/// The cosine, likewise.
#[inline(always)]
pub fn cos<V: Simd>(x: V) -> V {
    let near = Reduced::of(x).sine(1.0);
    if is_small(x) { near } else { with_far_lanes(near, x, f64::cos) }
}

/// Both, in little more time than one of them.
#[inline(always)]
pub fn sin_cos<V: Simd>(x: V) -> (V, V) {
    let reduced = Reduced::of(x);
    let (sine, cosine) = (reduced.sine(0.0), reduced.sine(1.0));
    if is_small(x) {
        (sine, cosine)
    } else {
        (with_far_lanes(sine, x, f64::sin), with_far_lanes(cosine, x, f64::cos))
    }
}

/// The tangent, likewise, to within 4 units.
#[inline(always)]
pub fn tan<V: Simd>(x: V) -> V {
    let near = Reduced::of(x).tangent();
    if is_small(x) { near } else { with_far_lanes(near, x, f64::tan) }
}

/// Whether all lanes are in the range of [`Reduced`].
#[inline(always)]
fn is_small<V: Simd>(x: V) -> bool {
    let beyond = x - x.clamp(LIMIT);
    (beyond * beyond).all_nonpositive()
}

/// An angle as k right angles and a rest, of which it has sine and cosine.
struct Reduced<V> {
    k: V,
    sine: V,
    cosine: V,
}

impl<V: Simd> Reduced<V> {
    #[inline(always)]
    fn of(x: V) -> Self {
        let k = x.mul_add(x.constant(std::f64::consts::FRAC_2_PI), x.constant(SHIFT)) - SHIFT;
        let mut r = x;
        for part in RIGHT_ANGLE {
            r = k.neg_mul_add(x.constant(part), r);
        }
        let square = r * r;
        let sine = (square * r).mul_add(polynomial(square, SINE), r);
        let half_square = square * 0.5;
        let near = -half_square + 1.0;
        // What the sum 1 - r^2/2 has lost.
        let lost = (-near + 1.0) - half_square;
        let cosine = near + (square * square).mul_add(polynomial(square, COSINE), lost);
        Self { k, sine, cosine }
    }

    /// The sine of the angle plus some right angles.
    #[inline(always)]
    fn sine(&self, right_angles: f64) -> V {
        let turned = self.k + right_angles;
        // The last two bits of the number of right angles.
        let (half, odd) = halved(turned);
        let (_, negative) = halved(half);
        odd.where_nonpositive(self.sine, self.cosine) * (negative * -2.0 + 1.0)
    }

    #[inline(always)]
    fn tangent(&self) -> V {
        let Self { k, sine, cosine } = *self;
        let (_, odd) = halved(k);
        odd.where_nonpositive(sine, -cosine) / odd.where_nonpositive(cosine, sine)
    }
}

/// Half of a whole number, and the rest.
#[inline(always)]
fn halved<V: Simd>(whole: V) -> (V, V) {
    let half = (whole * 0.5 - 0.25 + SHIFT) - SHIFT;
    (half, whole - half * 2.0)
}

/// By Estrin's scheme.
#[inline(always)]
fn polynomial<V: Simd>(z: V, [c0, c1, c2, c3, c4, c5]: [f64; 6]) -> V {
    let low = z.mul_add(z.constant(c1), z.constant(c0));
    let middle = z.mul_add(z.constant(c3), z.constant(c2));
    let high = z.mul_add(z.constant(c5), z.constant(c4));
    let square = z * z;
    square.mul_add(square.mul_add(high, middle), low)
}

/// `near`, with a function of the standard library in the lanes of x that are far: no lane's bits
/// depend on the others.
#[inline(never)]
fn with_far_lanes<V: Simd>(near: V, x: V, f: impl Fn(f64) -> f64) -> V {
    let (mut values, mut angles) = ([0.0; 8], [0.0; 8]);
    near.write(&mut values);
    x.write(&mut angles);
    x.generate(|lane| if angles[lane].abs() <= LIMIT { values[lane] } else { f(angles[lane]) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::{Isa, Task};

    struct All(f64);

    impl Task for All {
        type Output = [f64; 3];
        #[inline(always)]
        fn run<V: Simd>(self, zero: V) -> [f64; 3] {
            let angle = zero.constant(self.0);
            let (sine, cosine) = sin_cos(angle);
            let [sine, cosine, alone @ ..] = [sine, cosine, sin(angle), cos(angle), tan(angle)]
                .map(|function| {
                    let mut lanes = [0.0; 8];
                    function.write(&mut lanes);
                    lanes[V::LANES - 1]
                });
            // Together they have the same bits.
            assert_eq!([sine.to_bits(), cosine.to_bits()], [alone[0], alone[1]].map(f64::to_bits));
            alone
        }
    }

    /// Angles of all sizes, and some next to multiples of a right angle.
    fn angles() -> Vec<f64> {
        let mut all: Vec<f64> = (-40_000..40_000).map(|i| f64::from(i) * 3.7e-4).collect();
        all.extend((0..4_000).map(|i| 1.011_f64.powi(i) * 1e-12).filter(|x| *x < 1e9));
        for k in 0..3_000 {
            let multiple = f64::from(k * k) * std::f64::consts::FRAC_PI_2;
            all.extend([multiple, multiple.next_up(), -multiple.next_down()]);
        }
        all
    }

    /// The standard library's are correct to one unit.
    #[test]
    fn within_two_units_in_the_last_place_and_four_for_the_tangent() {
        for isa in Isa::available() {
            for x in angles() {
                let expected = [(x.sin(), 2.0), (x.cos(), 2.0), (x.tan(), 4.0)];
                for (found, (expected, units)) in isa.dispatch(All(x)).into_iter().zip(expected) {
                    let unit = expected.abs().next_up() - expected.abs();
                    let error = (found - expected).abs();
                    assert!(error <= units * unit, "{isa}, {x:e}: {found:e}, {expected:e}");
                }
            }
        }
    }

    struct BesideFar(f64);

    impl Task for BesideFar {
        type Output = [[f64; 8]; 5];
        #[inline(always)]
        fn run<V: Simd>(self, zero: V) -> Self::Output {
            let x = zero.generate(|lane| if lane == 0 { self.0 } else { 0.3 });
            let (sine, cosine) = sin_cos(x);
            [sine, cosine, sin(x), cos(x), tan(x)].map(|function| {
                let mut lanes = [0.0; 8];
                function.write(&mut lanes);
                lanes[0] = 0.0;
                lanes
            })
        }
    }

    /// A lane that is far or not a number does not change the bits of the others.
    #[test]
    fn lanes_do_not_depend_on_one_another() {
        for isa in Isa::available() {
            let bits = |first| isa.dispatch(BesideFar(first)).map(|row| row.map(f64::to_bits));
            for far in [1e7, f64::INFINITY, f64::NAN] {
                assert_eq!(bits(0.3), bits(far), "{isa}, {far}");
            }
        }
    }

    #[test]
    fn not_finite_arguments() {
        for isa in Isa::available() {
            for x in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                assert!(isa.dispatch(All(x)).iter().all(|y| y.is_nan()), "{isa}, {x}");
            }
            let [sine, cosine, tangent] = isa.dispatch(All(0.0));
            assert!(sine.to_bits() == 0 && tangent.to_bits() == 0, "{isa}");
            assert!(cosine.to_bits() == 1.0_f64.to_bits(), "{isa}");
        }
    }
}
