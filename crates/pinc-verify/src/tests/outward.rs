//! Every rounding of an interval's ends is outward, and no guess is trusted.
//!
//! An operation rounded to nearest is on the wrong side of the exact result for half of all operands,
//! so that thousands of them show every end that is not moved outward. What no operands can show,
//! because the functions of the standard library are better than is assumed of them, is shown by
//! guesses that are worse.

use super::elementary::{exact_cosine, exact_exp, exact_sine};
use super::{Numbers, exact, power, within};
use crate::elementary::{Approximate, atan_near, exp, exp_of_multiple, ln_near, tanh};
use crate::function::Smooth;
use crate::interval::Interval;
use crate::rounding::{UNIT, up};
use num_rational::BigRational;
use std::f64::consts::PI;

/// Whether an interval holds all numbers between two.
fn holds(found: Interval, low: &BigRational, high: &BigRational) -> bool {
    exact(found.low) <= *low && *high <= exact(found.high)
}

/// An interval of any size, at times of one number.
fn interval(numbers: &mut Numbers) -> Interval {
    let low = numbers.of_any_size();
    let width = numbers.of_any_size();
    Interval { low, high: if width < 0.0 { low } else { low + width } }
}

#[test]
fn sums_products_and_roots_of_intervals_are_rounded_outward() {
    let mut numbers = Numbers::new();
    for _ in 0..2000 {
        let (a, b) = (interval(&mut numbers), interval(&mut numbers));
        let [al, ah, bl, bh] = [a.low, a.high, b.low, b.high].map(exact);
        assert!(holds(a + b, &(&al + &bl), &(&ah + &bh)), "{a:?} {b:?}");
        assert!(holds(a - b, &(&al - &bh), &(&ah - &bl)), "{a:?} {b:?}");
        let products = [&al * &bl, &al * &bh, &ah * &bl, &ah * &bh];
        let low = products.iter().min().expect("four products");
        let high = products.iter().max().expect("four products");
        assert!(holds(a * b, low, high), "{a:?} {b:?}");
        if !a.contains(0.0) {
            assert!(holds(a.recip(), &ah.recip(), &al.recip()), "{a:?}");
        }
        let around = Interval::around(a.low, b.low.abs());
        let radius = exact(b.low.abs());
        assert!(holds(around, &(&al - &radius), &(&al + &radius)), "{a:?} {b:?}");
        let (middle, radius) = a.split();
        let (middle, radius) = (exact(middle), exact(radius));
        assert!(&middle - &radius <= al && &middle + &radius >= ah, "{a:?}");
        if a.low > 0.0 {
            let root = a.sqrt();
            assert!(power(&exact(root.low), 2) <= al && power(&exact(root.high), 2) >= ah);
            for (p, [least, most]) in [(1.5, [&al, &ah]), (-1.5, [&ah, &al])] {
                let found = a.power(p);
                let of = |end: &BigRational| power(end, 3);
                let of = |end: &BigRational| if p > 0.0 { of(end) } else { of(end).recip() };
                assert!(power(&exact(found.low), 2) <= of(least), "{a:?}");
                assert!(power(&exact(found.high), 2) >= of(most), "{a:?}");
            }
        }
    }
    // Angles that are not reduced have any sine.
    let [sine, cosine] = [Interval::point(2e6).sin(), Interval::point(2e6).cos()];
    assert!(sine.contains(2e6_f64.sin()) && cosine.contains(2e6_f64.cos()));
    let nothing = Interval { low: f64::NAN, high: 1.0 };
    assert_eq!(Interval::around(f64::NAN, 1.0), Interval::ENTIRE);
    assert_eq!(Interval::around(0.0, f64::NAN), Interval::ENTIRE);
    assert_eq!(nothing * Interval::point(1.0), Interval::ENTIRE);
    assert_eq!(Interval { low: -1.0, high: 2.0 }.power(0.5), Interval::ENTIRE);
    assert_eq!(Interval { low: 0.0, high: 2.0 }.ln(), Interval::ENTIRE);
}

#[test]
fn functions_of_intervals_hold_their_ends() {
    let mut numbers = Numbers::new();
    for _ in 0..30 {
        let low = numbers.between(-2.0, 2.0);
        let on = Interval { low, high: low + 0.5 };
        let ends = [on.low, on.high].map(exact);
        let [least, most] = ends.each_ref().map(exact_exp);
        assert!(holds(on.exp(), &least, &most), "{on:?}");
        let (sine, cosine) = (exact_sine(&ends[0]), exact_cosine(&ends[0]));
        assert!(holds(Interval::point(low).sin(), &sine, &sine), "{low}");
        assert!(holds(Interval::point(low).cos(), &cosine, &cosine), "{low}");
        for end in &ends {
            assert!(holds(on.sin(), &exact_sine(end), &exact_sine(end)), "{on:?}");
            assert!(holds(on.cos(), &exact_cosine(end), &exact_cosine(end)), "{on:?}");
        }
    }
}

/// A logarithm or an angle that is off has an error that holds the true one, or none at all.
#[test]
fn guesses_that_are_off_are_known_to_be() {
    let offs = [1e-9, 0.05, 0.2, 1.2, 3.0, PI, 2.0 * PI, 40.0];
    for x in [1e-3_f64, 0.3, 1.0, 7.0, 1e4] {
        for off in offs.into_iter().flat_map(|off| [-off, off]) {
            let slack = 1.0 - 1e-6;
            let found = ln_near(x, x.ln() + off);
            assert!(found.error >= off.abs() * slack, "ln {x} {off} {found:?}");
            assert!(off.abs() > 0.05 || found.error < 0.06);
            for x in [-x, x] {
                let found = atan_near(x, x.atan() + off);
                assert!(found.error >= off.abs() * slack, "atan {x} {off} {found:?}");
                assert!(off.abs() > 0.05 || found.error < 0.06);
            }
        }
    }
    for (error, p) in [(0.02, 1.0), (0.09, 1.0), (0.06, -1.5), (3.0, 1.0), (f64::NAN, 1.0)] {
        for value in [-3.0, 0.1, 5.0] {
            let found = exp_of_multiple(Approximate { value, error }, p);
            let most = (p * value + p.abs() * error).exp() * (1.0 - 1e-9);
            let is_above = found.value + found.error >= most;
            assert!(is_above || error.is_nan(), "{value} {error} {p} {found:?}");
            let is_far = error.is_nan() || error > 1.0;
            assert_eq!(found.error.is_infinite(), is_far, "{found:?}");
        }
    }
}

#[test]
fn powers_are_as_close_as_they_say() {
    let mut numbers = Numbers::new();
    for _ in 0..60 {
        // The rounding of the exponent is all that is large: of hundreds in the first case, and of
        // almost nothing in the second, where the error of exp is left.
        let x = 10.0_f64.powf(numbers.between(150.0, 200.0));
        let found = Smooth::Power(1.5).value(x);
        let exponent = 1.5 * x.ln();
        let alone = exp_of_multiple(Approximate { value: x.ln(), error: 0.0 }, 1.5);
        let cube = power(&exact(x), 3);
        let [low, high] = [found.value - found.error, found.value + found.error].map(exact);
        assert!(power(&low, 2) <= cube && power(&high, 2) >= cube, "{x}");
        assert!(alone.error >= UNIT * exponent * alone.value, "{x}");
        let value = numbers.between(0.01, 0.06);
        let found = exp_of_multiple(Approximate { value, error: 0.0 }, 1.0);
        assert!(within(&exact_exp(&exact(value)), &exact(found.value), found.error), "{value}");
        for x in [numbers.of_any_size(), numbers.between(1.0, 1.7) * 1e308] {
            let found = Smooth::Recip.value(x);
            assert!(within(&exact(x).recip(), &exact(found.value), found.error), "{x}");
            let x = x.abs().min(1e100);
            let found = Smooth::Power(3.0).value(x);
            assert!(within(&power(&exact(x), 3), &exact(found.value), found.error), "{x}");
        }
    }
}

/// Errors that no argument shows, because exp is far better than its bound: where they are needed
/// according to their derivation.
#[test]
fn bounds_of_errors_follow_from_the_bound_of_exp() {
    for x in [0.05, 0.1, 0.19, 0.3] {
        let (e, found) = (exp(-2.0 * x), tanh(x));
        // The derivative of (1 - e) / (1 + e), and three roundings of it.
        let needed = 2.0 * e.error / (1.0 + e.value).powi(2) + 3.0 * UNIT * found.value;
        assert!(found.error >= needed, "{x} {found:?}");
    }
    // e^-700 is 9.86e-305.
    assert!(exp(-700.0).error >= 9.86e-305 && exp(-1e9).value >= 0.0);
    let tiny = exp_of_multiple(Approximate { value: -700.0, error: 0.05 }, 1.0);
    assert!(tiny.value + tiny.error >= 9.86e-305 * 1.05, "{tiny:?}");
}

#[test]
fn sums_are_rounded_upward() {
    // The sum of so many numbers of either kind, by rounding to nearest, is too small for one.
    for number in [0.1, 0.3, 0.7, 1.0 / 3.0] {
        let sum: f64 = (0..90_000).map(|_| number).sum();
        assert!(exact(up(sum)) >= exact(number) * exact(90_000.0), "{number}");
    }
    let tiny = 1e-200;
    assert!(exact(up(tiny * tiny)) >= exact(tiny) * exact(tiny));
}
