//! Each part of a remainder, in a case in which the others are smaller than it.

use super::{exact, power, within, zero};
use crate::basis::Basis;
use crate::function::Smooth;
use crate::kernel::{LANES, Lanes};
use crate::polynomial::{Cuts, Polynomial};
use crate::rounding::to_f64;
use crate::taylor::{Arithmetic, Taylor};
use num_rational::BigRational;
use pinc_ad::simd::Isa;
use proptest::prelude::*;

fn over(variables: usize, degree: usize, order: usize) -> Arithmetic {
    let space = Basis::of_space(variables, degree);
    let basis = if order > 0 { space.with_time(order) } else { space };
    Arithmetic::new(basis, degree + order, Isa::detect())
}

/// The same polynomial in all boxes.
fn model(over: &Arithmetic, coefficients: &[f64], remainder: f64) -> Taylor {
    let mut model = over.constant([0.0; LANES]);
    for (to, from) in model.coefficients.iter_mut().zip(coefficients) {
        *to = [*from; LANES];
    }
    model.with_remainder([remainder; LANES])
}

/// The polynomial's value at a time and a point, exactly.
fn value(over: &Arithmetic, of: &Taylor, t: f64, at: &[f64]) -> BigRational {
    let basis = &over.basis;
    let mut sum = zero();
    let orders =
        (0..basis.orders()).flat_map(|k| basis.of_order(k).enumerate().map(move |p| (k, p)));
    for (k, (monomial, place)) in orders {
        let coefficient = of.coefficients[place];
        let mut term = exact(coefficient[3]);
        for (x, n) in at.iter().zip(basis.exponents(monomial)) {
            term *= power(&exact(*x), *n);
        }
        sum += term * power(&exact(t), u8::try_from(k).unwrap());
    }
    sum
}

/// As many coefficients as the basis keeps.
fn kept(over: &Arithmetic, mut all: Vec<f64>) -> Vec<f64> {
    all.resize(over.basis.len(), 0.5);
    all
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    /// At random points, with values anywhere in the remainders of the operands.
    #[test]
    fn operations_hold_exact_results(
        a in proptest::collection::vec(-1.0_f64..1.0, 18),
        b in proptest::collection::vec(-1.0_f64..1.0, 18),
        at in proptest::collection::vec(-1.0_f64..1.0, 2),
        t in 0.0_f64..1.0,
        shares in proptest::collection::vec(-1.0_f64..1.0, 2),
    ) {
        let over = over(2, 2, 2);
        let (ra, rb) = (1e-3, 2e-2);
        let (a, b) = (model(&over, &kept(&over, a), ra), model(&over, &kept(&over, b), rb));
        let x = value(&over, &a, t, &at) + exact(shares[0] * ra);
        let y = value(&over, &b, t, &at) + exact(shares[1] * rb);
        let holds = |found: &Taylor, exact: &BigRational| {
            within(&value(&over, found, t, &at), exact, found.remainder[3])
        };
        prop_assert!(holds(&over.mul(&a, &b), &(&x * &y)));
        prop_assert!(holds(&over.add(&a, &b), &(&x + &y)));
        prop_assert!(holds(&over.sub(&a, &b), &(&x - &y)));
        let combined = over.combine(&[&a, &b], &[0.3, -1.7], 0.1);
        let sum = &x * exact(0.3) + &y * exact(-1.7) + exact(0.1);
        prop_assert!(holds(&combined, &sum));
        let away = over.offset(&b, 20.0);
        prop_assert!(holds(&over.div(&a, &away), &(&x / (&y + exact(20.0)))));
        let range = a.ranges()[3];
        prop_assert!(exact(range.low) <= x && x <= exact(range.high));
        let narrow = over.ranges_in_time(&a)[3];
        prop_assert!(exact(narrow.low) <= x && x <= exact(narrow.high));
        prop_assert!(range.low <= narrow.low.next_up() && narrow.high.next_down() <= range.high);
    }

    /// Rounding alone: nothing is dropped, and the operands are exact.
    #[test]
    fn rounding_is_in_the_remainder(
        a in proptest::collection::vec(-1.0_f64..1.0, 3),
        b in proptest::collection::vec(-1.0_f64..1.0, 3),
    ) {
        let over = over(2, 2, 0);
        let (a, b) = (model(&over, &a, 0.0), model(&over, &b, 0.0));
        let at = [1.0, 1.0];
        let (x, y) = (value(&over, &a, 0.0, &at), value(&over, &b, 0.0, &at));
        let product = over.mul(&a, &b);
        prop_assert!(within(&value(&over, &product, 0.0, &at), &(&x * &y), product.remainder[3]));
        prop_assert!(product.remainder[3] < 1e-14);
        let sum = over.combine(&[&a, &b], &[0.3, -1.7], 0.1);
        let wanted = &x * exact(0.3) + &y * exact(-1.7) + exact(0.1);
        prop_assert!(within(&value(&over, &sum, 0.0, &at), &wanted, sum.remainder[3]));
        prop_assert!(sum.remainder[3] < 1e-14);
    }

    #[test]
    fn halves_of_polynomials_are_as_exact_as_they_say(
        coefficients in proptest::collection::vec(-1.0_f64..1.0, 10), x in -1.0_f64..1.0,
    ) {
        let basis = Basis::of_space(2, 3);
        let cuts = Cuts::new(&basis);
        let of = Polynomial { coefficients, rounding: 0.0 };
        // Multiplications by powers of 2 are exact, the sums are not.
        let half = cuts.half(&of, 1, 1.0);
        let at = |of: &Polynomial, x: f64, y: f64| {
            let term = |(place, c): (usize, &f64)| {
                let [i, j] = [0, 1].map(|i| basis.exponents(place)[i]);
                exact(*c) * power(&exact(x), i) * power(&exact(y), j)
            };
            of.coefficients.iter().enumerate().map(term).fold(zero(), |a, b| a + b)
        };
        let (found, wanted) = (at(&half, x, 0.5), at(&of, x, 0.75));
        // 12 u of a sum of up to 10.
        prop_assert!(within(&found, &wanted, half.rounding) && half.rounding < 2e-14);
        let bound = cuts.bound(&of, 0.0);
        prop_assert!(wanted <= exact(bound.most) && wanted >= -exact(bound.most));
    }
}

/// Of operands whose terms all add up, a bound is met to rounding: nothing may be left out of it.
#[test]
fn every_part_of_a_products_remainder_is_needed() {
    let over = over(2, 2, 2);
    let ones = kept(&over, vec![0.5; over.basis.len()]);
    for (ra, rb) in [(0.0, 0.0), (0.7, 0.0), (0.0, 0.9), (3.0, 4.0)] {
        let (a, b) = (model(&over, &ones, ra), model(&over, &ones, rb));
        let product = over.mul(&a, &b);
        let corner = |of: &Taylor| value(&over, of, 1.0, &[1.0, 1.0]);
        let wanted = (corner(&a) + exact(ra)) * (corner(&b) + exact(rb));
        let missing = wanted - corner(&product);
        let remainder = product.remainder[3];
        assert!(missing <= exact(remainder) && missing >= exact(remainder * (1.0 - 1e-8)));
    }
    // With fewer coefficients kept, more is in the remainder.
    let line = model(&over, &[0.0, 1.0, 1.0], 0.0);
    assert!(over.mul(&line, &line).remainder[0] < 1e-12);
    let cube = over.mul(&over.mul(&line, &line), &line);
    assert!((cube.remainder[0] - 8.0).abs() < 1e-6, "{:?}", cube.remainder);
}

/// The error of a function's polynomial at dense samples, over its remainder.
fn share_of_remainder(
    function: Smooth,
    degree: usize,
    coefficients: &[f64],
    shift: f64,
    exact: impl Fn(f64) -> f64,
) -> f64 {
    let over = over(1, degree, 0);
    let found = over.compose(function, &model(&over, coefficients, shift));
    let at = |of: &[Lanes], x: f64| of.iter().rev().fold(0.0, |sum, c| sum * x + c[3]);
    let argument = |x: f64| coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c);
    let off = |k: usize| {
        let x = to_f64(k) / 200.0 - 1.0;
        let ends = [argument(x) - shift, argument(x) + shift].map(&exact);
        ends.map(|end| (end - at(&found.coefficients, x)).abs()).into_iter().fold(0.0, f64::max)
    };
    (0..=400).map(off).fold(0.0, f64::max) / found.remainder[3]
}

#[test]
fn every_part_of_a_functions_remainder_is_needed() {
    type Case = (Smooth, fn(f64) -> f64, f64);
    let cases: [Case; 9] = [
        (Smooth::Tanh, f64::tanh, 0.3),
        (Smooth::Exp, f64::exp, 0.3),
        (Smooth::Sqrt, f64::sqrt, 2.0),
        (Smooth::Ln, f64::ln, 2.0),
        (Smooth::Sin, f64::sin, 1.0),
        (Smooth::Cos, f64::cos, 1.0),
        (Smooth::Atan, f64::atan, 0.2),
        (Smooth::Recip, |x| 1.0 / x, 2.0),
        (Smooth::Power(1.5), |x| x.powf(1.5), 2.0),
    ];
    for (function, f, middle) in cases {
        // The fit: of a line nothing is dropped.
        let fit = share_of_remainder(function, 4, &[middle, 0.5], 0.0, f);
        assert!((0.02..=1.0).contains(&fit), "{function:?}: fit {fit}");
        // The remainder of the argument, with the steepest slope.
        let slope = share_of_remainder(function, 4, &[middle, 0.01], 0.1, f);
        assert!((0.5..=1.0).contains(&slope), "{function:?}: slope {slope}");
    }
    // Terms that Horner's rule drops, which here are larger than the fit's error.
    let dropped = share_of_remainder(Smooth::Exp, 4, &[0.0, 1.0, 1.0], 0.0, f64::exp);
    assert!((0.3..=1.0).contains(&dropped), "{dropped}");
    // What is not smooth there is unknown.
    for function in [Smooth::Sqrt, Smooth::Ln, Smooth::Recip, Smooth::Power(0.3)] {
        let over = over(1, 3, 0);
        let found = over.compose(function, &model(&over, &[0.5, 0.5], 1e-3));
        assert!(found.remainder[0].is_infinite(), "{function:?}");
    }
}

#[test]
fn choices_are_made_where_the_sign_is_known() {
    let over = over(1, 1, 0);
    let [yes, no] = [3.0, 4.0].map(|value| over.constant([value; LANES]));
    let mut of = over.constant([0.0; LANES]);
    of.coefficients[0] = [-1.0, 1.0, 0.5, 0.0, -1.0, -1.0, -1.0, -1.0];
    of.coefficients[1] = [0.5, 0.5, 0.6, 0.0, 1.5, 0.5, 0.5, 0.5];
    let chosen = over.choose(&of, &yes, &no);
    let value = |lane: usize| (chosen.coefficients[0][lane], chosen.remainder[lane]);
    assert_eq!([value(0), value(1)], [(3.0, 0.0), (4.0, 0.0)]);
    assert!([2, 3, 4].map(|lane| value(lane).1).into_iter().all(f64::is_infinite));
    // What is unknown, or no number, stays so.
    let unknown = over.unknown();
    assert!(over.mul(&unknown, &over.constant([0.0; LANES])).remainder[0].is_infinite());
    assert!(over.compose(Smooth::Sin, &unknown).remainder[0].is_infinite());
    let nan = over.constant([f64::NAN; LANES]);
    assert!(over.add(&nan, &yes).remainder[0].is_infinite());
    assert!(over.mul(&nan, &yes).remainder[0].is_infinite());
}
