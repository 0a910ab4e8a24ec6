//! Functions of one number with a bound of their error, from additions, multiplications and
//! divisions alone: nothing is assumed of the functions of the standard library.
//!
//! `exp`, `sin` and `cos` are polynomials after a reduction of the argument. `ln` and `atan` take a
//! guess from the standard library and correct it by the distance that `exp`, `sin` and `cos` find.

use crate::rounding::UNIT;
use std::f64::consts::{FRAC_2_PI, LN_2};

/// A value and a bound of its distance from the true one, infinite where nothing is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Approximate {
    pub(crate) value: f64,
    pub(crate) error: f64,
}

impl Approximate {
    const UNKNOWN: Self = Self { value: 0.0, error: f64::INFINITY };

    /// A value rounded once.
    pub(crate) fn rounded(value: f64) -> Self {
        Self { value, error: 2.0 * UNIT * value.abs() + f64::MIN_POSITIVE }
    }
}

/// Relative error of [`exp`]: the polynomial's remainder is below 2^-56 of the value, Horner's rule
/// rounds by less than 3 u of it (its terms fall by factors of |r| < 0.35), and the reduction
/// changes r by less than 2 u.
const EXP_ERROR: f64 = 16.0 * UNIT;

/// ln 2 in two parts; the first has 32 bits, so that its products with whole numbers below 2^20 are
/// exact.
const LN_2_HIGH: f64 = 6.931_471_803_691_238e-1;
const LN_2_LOW: f64 = 1.908_214_929_270_587_7e-10;

/// e^x.
pub(crate) fn exp(x: f64) -> Approximate {
    if x.is_nan() || x.abs() >= 700.0 {
        return match x {
            x if x <= -700.0 => Approximate { value: 0.0, error: 1e-304 },
            _ => Approximate::UNKNOWN,
        };
    }
    let k = (x / LN_2).round();
    let r = (x - k * LN_2_HIGH) - k * LN_2_LOW;
    // Taylor's polynomial of degree 14: the remainder is at most 0.35^15 / 15! = 1.1e-19.
    let mut sum = 1.0;
    for n in (1..=14_u32).rev() {
        sum = sum * r / f64::from(n) + 1.0;
    }
    let value = sum * power_of_two(k);
    Approximate { value, error: EXP_ERROR * value }
}

/// 2^k for whole k between -1020 and 1020.
#[expect(clippy::cast_possible_truncation, reason = "whole and small")]
fn power_of_two(k: f64) -> f64 {
    f64::from_bits(u64::from((1023 + k as i32).unsigned_abs()) << 52)
}

/// The natural logarithm; unknown unless x is positive and neither tiny nor huge.
pub(crate) fn ln(x: f64) -> Approximate {
    ln_near(x, x.ln())
}

/// The natural logarithm from a guess; unknown where that is far off.
pub(crate) fn ln_near(x: f64, guess: f64) -> Approximate {
    // ln x = guess + ln(x e^-guess), and |ln(1 + d)| <= |d| / (1 - |d|). Twice the error of exp
    // leaves room for the roundings of d and of the quotient.
    let d = (x * exp(-guess).value - 1.0).abs() + 2.0 * EXP_ERROR;
    match d < 0.1 {
        true => Approximate { value: guess, error: d / (1.0 - d) },
        false => Approximate::UNKNOWN,
    }
}

/// x^p for positive x.
pub(crate) fn power(x: f64, p: f64) -> Approximate {
    exp_of_multiple(ln(x), p)
}

/// x^p from the logarithm of x.
pub(crate) fn exp_of_multiple(logarithm: Approximate, p: f64) -> Approximate {
    let exponent = p * logarithm.value;
    let error = p.abs() * logarithm.error + UNIT * exponent.abs() * 2.0;
    let found = exp(exponent);
    if error.is_nan() || error >= 0.1 {
        return Approximate::UNKNOWN;
    }
    // e^(a + d) is off by a factor of 1 + 2 |d| at most.
    Approximate { value: found.value, error: found.error * 2.0 + found.value * 2.0 * error }
}

/// tanh x = sign(x) (1 - e) / (1 + e) with e = e^(-2 |x|).
pub(crate) fn tanh(x: f64) -> Approximate {
    let e = exp(-2.0 * x.abs());
    let value = ((1.0 - e.value) / (1.0 + e.value)).copysign(x);
    // The derivative by e is at most 2.
    Approximate { value, error: 2.0 * e.error + 8.0 * UNIT }
}

/// pi / 2 in three parts; the first two have 33 bits, so that their products with whole numbers
/// below 2^20 are exact.
const HALF_PI: [f64; 3] =
    [1.570_796_326_734_125_6, 6.077_100_506_303_966e-11, 2.022_266_248_795_950_6e-21];

/// Arguments of sines that can be reduced: k below 2^20.
const LARGEST_ANGLE: f64 = 1e6;

/// Absolute error of sines and cosines: the polynomials' remainders are below 2^-56, Horner's rule
/// rounds by less than 4 u, and the reduction by less than 2 u.
const SINE_ERROR: f64 = 16.0 * UNIT;

/// The sine and the cosine.
pub(crate) fn sin_cos(x: f64) -> [Approximate; 2] {
    if x.is_nan() || x.abs() > LARGEST_ANGLE {
        // Whatever the angle, both are between -1 and 1.
        return [Approximate { value: 0.0, error: if x.is_finite() { 1.0 } else { f64::INFINITY } };
            2];
    }
    let k = (x * FRAC_2_PI).round();
    let r = ((x - k * HALF_PI[0]) - k * HALF_PI[1]) - k * HALF_PI[2];
    let square = r * r;
    // To degrees 19 and 18: the remainders are at most 0.79^21 / 21! and 0.79^20 / 20!.
    let (mut sine, mut cosine) = (1.0, 1.0);
    for n in (1..=9_u32).rev() {
        let (odd, even) = (f64::from(2 * n * (2 * n + 1)), f64::from(2 * n * (2 * n - 1)));
        sine = 1.0 - square * sine / odd;
        cosine = 1.0 - square * cosine / even;
    }
    sine *= r;
    let (sine, cosine) = match k.rem_euclid(4.0) {
        quarter if quarter < 0.5 => (sine, cosine),
        quarter if quarter < 1.5 => (cosine, -sine),
        quarter if quarter < 2.5 => (-sine, -cosine),
        _ => (-cosine, sine),
    };
    [sine, cosine].map(|value| Approximate { value, error: SINE_ERROR })
}

/// The angle whose tangent is x.
pub(crate) fn atan(x: f64) -> Approximate {
    atan_near(x, x.atan())
}

/// The angle whose tangent is x from a guess; unknown where that is far off.
pub(crate) fn atan_near(x: f64, guess: f64) -> Approximate {
    // With a guess v, atan x = v + atan((x cos v - sin v) / (cos v + x sin v)) where the divisor is
    // positive and v in the same period, and |atan d| <= |d|. Four times the error of sines leaves
    // room for the roundings of dividend, divisor and quotient.
    let [sine, cosine] = sin_cos(guess);
    let (above, below) = (x * cosine.value - sine.value, cosine.value + x * sine.value);
    let rounding = 4.0 * SINE_ERROR * (1.0 + x.abs());
    match below > 0.5 && guess.abs() < 2.0 && x.is_finite() {
        true => Approximate { value: guess, error: (above.abs() + rounding) / below },
        false => Approximate::UNKNOWN,
    }
}
