//! Functions of one number against their series in rationals.

use super::{exact, within, zero};
use crate::elementary::{atan, exp, ln, power, sin_cos, tanh};
use crate::interval::Interval;
use num_rational::BigRational;
use proptest::prelude::*;

/// Terms of series; the first left out is below 1e-24 for arguments up to 4.
const TERMS: u32 = 45;

/// The sum of the terms x^n / n! with the signs that `sign` gives, 0 to leave one out: whole
/// multiples of 2^-200, since the denominators of exact ones grow with every term.
fn series(x: &BigRational, sign: impl Fn(u32) -> i8) -> BigRational {
    let scale = exact(2.0_f64.powi(200)).to_integer();
    let x = (x * exact(2.0_f64.powi(200))).to_integer();
    let mut term = scale.clone();
    let mut sum = zero().to_integer();
    for n in 0..TERMS {
        if n > 0 {
            term = term * &x / &scale / n;
        }
        sum += &term * sign(n);
    }
    BigRational::new(sum, scale)
}

pub(super) fn exact_exp(x: &BigRational) -> BigRational {
    series(x, |_| 1)
}

pub(super) fn exact_sine(x: &BigRational) -> BigRational {
    series(x, |n| [0, 1, 0, -1][n as usize % 4])
}

pub(super) fn exact_cosine(x: &BigRational) -> BigRational {
    series(x, |n| [1, 0, -1, 0][n as usize % 4])
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn values_are_as_close_as_they_say(x in -4.0_f64..4.0) {
        let q = exact(x);
        let e = exact_exp(&q);
        let found = exp(x);
        prop_assert!(within(&e, &exact(found.value), found.error));
        prop_assert!(found.error < 4e-15 * found.value);
        let [sine, cosine] = sin_cos(x);
        prop_assert!(within(&exact_sine(&q), &exact(sine.value), sine.error));
        prop_assert!(within(&exact_cosine(&q), &exact(cosine.value), cosine.error));
        let square = &e * &e;
        let t = (&square - exact(1.0)) / (&square + exact(1.0));
        let found = tanh(x);
        prop_assert!(within(&t, &exact(found.value), found.error) && found.error < 2e-14);
        // The functions increase: ln and atan lie between ends that their inverses put around x.
        let angle = atan(x);
        for (end, sign) in [(angle.value - angle.error, -1.0), (angle.value + angle.error, 1.0)] {
            let end = exact(end);
            let above = exact_sine(&end) - &q * exact_cosine(&end);
            prop_assert!(above * exact(sign) >= zero(), "atan {x}");
        }
        prop_assert!(angle.error < 1e-13);
        let (x, q) = (x.abs() + 0.1, exact(x.abs() + 0.1));
        let logarithm = ln(x);
        prop_assert!(exact_exp(&exact(logarithm.value - logarithm.error)) <= q);
        prop_assert!(exact_exp(&exact(logarithm.value + logarithm.error)) >= q);
        prop_assert!(logarithm.error < 1e-14);
        let half = power(x, 1.5);
        let cube = &q * &q * &q;
        let ends = [half.value - half.error, half.value + half.error].map(exact);
        prop_assert!(&ends[0] * &ends[0] <= cube && &ends[1] * &ends[1] >= cube);
    }

    #[test]
    fn sums_and_products_of_intervals_hold_exact_ones(
        a in -3.0_f64..3.0, b in -3.0_f64..3.0, width in 0.0_f64..1.0, share in 0.0_f64..1.0,
    ) {
        let [one, other] = [a, b].map(|low| Interval { low, high: low + width });
        let inside = |of: Interval| of.low + share * (of.high - of.low);
        let (x, y) = (exact(inside(one).min(one.high)), exact(inside(other).min(other.high)));
        let holds = |of: Interval, value: &BigRational| {
            exact(of.low) <= *value && *value <= exact(of.high)
        };
        prop_assert!(holds(one + other, &(&x + &y)) && holds(one - other, &(&x - &y)));
        prop_assert!(holds(one * other, &(&x * &y)) && holds(-one, &-x.clone()));
        prop_assert!(holds(one.power(3.0), &(&x * &x * &x)));
        if !other.contains(0.0) {
            prop_assert!(holds(one / other, &(&x / &y)));
        }
        prop_assert!(holds(one.exp(), &exact_exp(&x)) && holds(one.sin(), &exact_sine(&x)));
        prop_assert!(holds(one.cos(), &exact_cosine(&x)));
        prop_assert!((one + other).high - (one + other).low < 2.0 * width + 1e-14);
    }
}

#[test]
fn what_is_not_defined_is_unknown() {
    let around_zero = Interval { low: -1.0, high: 1.0 };
    for unknown in [
        around_zero.recip(),
        around_zero.sqrt(),
        around_zero.ln(),
        around_zero.power(0.3),
        Interval::ENTIRE.exp(),
        Interval::point(800.0).exp(),
    ] {
        assert_eq!((unknown.high, unknown.low < 1e-300), (f64::INFINITY, true), "{unknown:?}");
    }
    assert_eq!(Interval::ENTIRE * Interval::point(0.0), Interval::ENTIRE);
    assert!(exp(f64::NAN).error.is_infinite() && sin_cos(f64::NAN)[0].error.is_infinite());
    assert!(ln(0.0).error.is_infinite() && atan(f64::INFINITY).error.is_infinite());
    // Large angles are reduced as exactly, or not at all.
    let [sine, _] = sin_cos(1e5);
    assert!((sine.value - 1e5_f64.sin()).abs() <= sine.error + 1e-16);
    assert_eq!(sin_cos(1e7)[0].error.to_bits(), 1.0_f64.to_bits());
}
