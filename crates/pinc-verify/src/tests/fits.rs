//! Bounds of functions' Taylor coefficients and slopes, against exact ones.

use super::elementary::exact_exp;
use super::{Numbers, exact, power};
use crate::elementary::tanh;
use crate::function::Smooth;
use crate::interval::Interval;
use crate::rounding::to_f64;
use num_rational::BigRational;

fn factorial(n: u8) -> BigRational {
    (1..=n).fold(exact(1.0), |product, n| product * exact(f64::from(n)))
}

/// p (p - 1) .. (p - n + 1) / n!
fn binomial(p: f64, n: u8) -> BigRational {
    let factors = (0..n).map(|i| exact(p) - exact(f64::from(i)));
    factors.fold(exact(1.0), |product, factor| product * factor) / factorial(n)
}

/// At a point the bounds are met but for rounding, or their squares are where the bounds are roots.
#[test]
fn bounds_of_coefficients_are_rounded_upward() {
    let mut numbers = Numbers::new();
    for _ in 0..60 {
        let x = numbers.between(0.1, 4.0);
        let (q, on) = (exact(x), Interval::point(x));
        let e = exact_exp(&q);
        for n in 1..=8_u8 {
            let bound = |of: Smooth| exact(of.coefficient_bound(n.into(), on));
            let order = exact(f64::from(n));
            assert!(bound(Smooth::Recip) >= power(&q, n + 1).recip(), "{x} {n}");
            assert!(bound(Smooth::Ln) >= (&order * power(&q, n)).recip(), "{x} {n}");
            assert!(bound(Smooth::Sin) >= factorial(n).recip());
            assert!(bound(Smooth::Exp) >= &e / factorial(n), "{x} {n}");
            let square = power(&(&q * &q + exact(1.0)), n);
            assert!(power(&bound(Smooth::Atan), 2) >= (square * &order * &order).recip());
            let root = power(&binomial(0.5, n), 2) * &q / power(&q, 2 * n);
            assert!(power(&bound(Smooth::Sqrt), 2) >= root, "{x} {n}");
            let root = power(&binomial(-1.5, n), 2) / power(&q, 2 * n + 3);
            assert!(power(&bound(Smooth::Power(-1.5)), 2) >= root, "{x} {n}");
        }
    }
    // tanh x = x - x^3/3 + 2/15 x^5 .., whose poles all count at 0.
    for (n, coefficient) in [(1, 1.0), (3, 1.0 / 3.0), (5, 2.0 / 15.0)] {
        let bound = Smooth::Tanh.coefficient_bound(n, Interval::point(0.0));
        assert!(bound >= coefficient && bound < 1.01 * coefficient, "{n} {bound}");
    }
}

#[test]
fn bounds_on_intervals_hold_at_their_points() {
    let all = [
        Smooth::Recip,
        Smooth::Sqrt,
        Smooth::Exp,
        Smooth::Ln,
        Smooth::Sin,
        Smooth::Atan,
        Smooth::Tanh,
        Smooth::Power(2.5),
        Smooth::Power(5.0),
        Smooth::Power(-0.5),
    ];
    for function in all {
        for n in 1..=7 {
            let on = Interval { low: 0.25, high: 3.0 };
            let bound = function.coefficient_bound(n, on);
            for k in 0..=10 {
                let at = Interval::point(0.25 + 0.275 * to_f64(k));
                let least = function.coefficient_bound(n, at) * (1.0 - 1e-9);
                assert!(bound >= least, "{function:?} {n} {at:?}");
                assert!(function.slope_bound(on) >= function.slope_bound(at) * (1.0 - 1e-9));
            }
        }
    }
    // What overflows, or is not bounded, is not known.
    assert!(Smooth::Exp.coefficient_bound(3, Interval { low: 0.0, high: 800.0 }).is_infinite());
    let tiny = Interval { low: 1e-40, high: 1.0 };
    assert!(Smooth::Power(-20.5).coefficient_bound(1, tiny).is_infinite());
    let from_zero = Interval { low: 0.0, high: 1.0 };
    assert!(Smooth::Sqrt.coefficient_bound(1, from_zero).is_infinite());
    let across = Interval { low: -1.0, high: 1.0 };
    for function in [Smooth::Recip, Smooth::Sqrt, Smooth::Ln, Smooth::Power(-2.0)] {
        assert!(!function.is_smooth(across), "{function:?}");
    }
    assert!(!Smooth::Power(0.5).is_smooth(from_zero) && Smooth::Power(2.0).is_smooth(across));
}

/// 1 - t^2 for the least t that the error of tanh leaves, exactly.
#[test]
fn the_slope_of_tanh_is_rounded_upward() {
    let mut numbers = Numbers::new();
    for _ in 0..300 {
        let x = 10.0_f64.powf(numbers.between(-4.0, 0.7));
        let at = tanh(x);
        let least = exact(at.value) - exact(at.error);
        let slope = Smooth::Tanh.slope_bound(Interval { low: x, high: x + 1.0 });
        let least = if least < exact(0.0) { exact(0.0) } else { least };
        assert!(exact(slope) >= exact(1.0) - power(&least, 2), "{x}");
        assert!(slope <= 1.0 - x.tanh().powi(2) + 1e-13, "{x}");
    }
}
