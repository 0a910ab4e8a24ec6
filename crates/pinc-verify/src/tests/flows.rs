//! Flows whose solutions are known.

use super::{Numbers, exact, within, zero};
use crate::basis::Basis;
use crate::equation::Equation;
use crate::flow::{Flow, FlowArithmetic, at_the_end, defect};
use crate::kernel::LANES;
use crate::rounding::to_f64;
use crate::taylor::{Arithmetic, Taylor};
use pinc_ad::simd::Isa;
use pinc_expr::Equations;
use proptest::prelude::*;

/// x' = `text`, over `sample_time_s`.
pub(super) fn flow(text: &str, sample_time_s: f64) -> Flow {
    let text = format!(
        r#"{{"states": [{{"name": "x"}}], "inputs": [{{"name": "u"}}], "derivatives": {{"x": "{text}"}}}}"#
    );
    let equations: Equations = serde_json::from_str(&text).unwrap();
    Flow { equation: Equation::new(equations.listing(&[]).unwrap()), sample_time_s }
}

fn over(degree: usize, order: usize) -> FlowArithmetic {
    let isa = Isa::detect();
    FlowArithmetic::new(Basis::of_space(1, degree), order, isa)
}

/// The flow from x0 in `middle` +- `radius`.
fn run(text: &str, t: f64, over: &FlowArithmetic, [middle, radius]: [f64; 2], n: usize) -> Taylor {
    let mut start = over.space.constant([middle; LANES]);
    start.coefficients[1] = [radius; LANES];
    let held = over.space.constant([0.0; LANES]);
    flow(text, t).run(over, &[start], &[held], n).remove(0)
}

/// The largest error at dense samples, over the remainder.
fn share(found: &Taylor, [middle, radius]: [f64; 2], exact: impl Fn(f64) -> f64) -> f64 {
    let off = |k: usize| {
        let x = to_f64(k) / 100.0 - 1.0;
        let value = found.coefficients.iter().rev().fold(0.0, |sum, c| sum * x + c[0]);
        (value - exact(middle + radius * x)).abs()
    };
    (0..=200).map(off).fold(0.0, f64::max) / found.remainder[0]
}

/// With one power of the time all that counts is the defect and its growth; the bound of e' = 3 e +
/// d takes all of the growth from the beginning.
#[test]
fn the_defect_and_its_growth_are_in_the_bound() {
    let (over, from) = (over(1, 1), [1.0, 0.1]);
    let one = run("3*x", 1.0, &over, from, 1);
    let found = share(&one, from, |x| x * 3.0_f64.exp());
    // The bound is e^3 times the integral of 9 t for x = 1.1.
    assert!((one.remainder[0] / (3.0_f64.exp() * 4.95) - 1.0).abs() < 1e-6, "{one:?}");
    assert!((0.1..1.0).contains(&found), "{found}");
    // In the second step the error of the first one grows.
    let two = run("3*x", 1.0, &over, from, 2);
    let found = share(&two, from, |x| x * 3.0_f64.exp());
    assert!((0.3..1.0).contains(&found), "{found}");
    let growth = 1.5_f64.exp();
    let expected = 1.1 * 1.125 * (growth * growth + growth * 2.5);
    assert!((two.remainder[0] / expected - 1.0).abs() < 1e-6, "{two:?} {expected}");
}

/// An error that falls is known to fall.
#[test]
fn errors_fall_where_the_flow_contracts() {
    let over = over(1, 1);
    let from = [1.0, 0.1];
    let fell = run("-3*x", 1.0, &over, from, 8);
    let found = share(&fell, from, |x| x * (-3.0_f64).exp());
    assert!((0.3..1.0).contains(&found), "{found}");
}

/// Terms of the equation that the polynomials do not keep are in the bound.
#[test]
fn what_the_equation_drops_is_in_the_bound() {
    let from = [0.5, 0.2];
    for (degree, text, t) in [(1, "x^2", 0.5), (2, "x^2", 0.5), (3, "sqrt(x)", 0.4)] {
        let over = over(degree, 9);
        let found = run(text, t, &over, from, 4);
        let share = share(&found, from, |x| match text {
            "x^2" => x / (1.0 - t * x),
            _ => (x.sqrt() + 0.5 * t).powi(2),
        });
        assert!((0.05..1.0).contains(&share), "{text} {degree}: {share}");
    }
}

/// x' = x^2 from 2 is infinite at 1/2: no tube holds it, however many steps are made.
#[test]
fn a_solution_that_ends_is_not_enclosed() {
    let over = over(2, 6);
    for n in [1, 4, 32] {
        assert!(run("x^2", 0.6, &over, [2.0, 0.1], n).remainder[0].is_infinite());
    }
    // Just before it can be.
    assert!(run("x^2", 0.4, &over, [2.0, 0.01], 32).remainder[0] < 1.0);
    // Nor is one that leaves the region in which the equation is smooth.
    assert!(run("-sqrt(x)", 2.0, &over, [0.5, 0.1], 8).remainder[0].is_infinite());
    assert!(run("max(x, 1)", 1.0, &over, [0.9, 0.01], 8).remainder[0].is_infinite());
    assert!(run("max(x, 1)", 1.0, &over, [1.2, 0.01], 8).remainder[0] < 1e-3);
}

/// What is not known of the start is not known of the end, and the last sum is rounded: x' = 1/1000
/// from numbers beside which the slope is small.
#[test]
fn starts_and_ends_of_flows_are_in_the_bound() {
    let over = over(1, 3);
    let mut numbers = Numbers::new();
    for _ in 0..40 {
        let middle = numbers.between(1.0, 2.0) * 1e6;
        let found = run("0.001", 0.75, &over, [middle, 0.1], 1);
        let end = exact(middle) + exact(0.75) * exact(0.001);
        assert!(within(&end, &exact(found.coefficients[0][0]), found.remainder[0]));
    }
    let start = over.space.constant([1.0; LANES]).with_remainder([0.25; LANES]);
    let held = over.space.constant([0.0; LANES]);
    let end = flow("x", 1.0).run(&over, &[start], &[held], 4).remove(0);
    assert!(end.remainder[0] >= 0.25 * 1.0_f64.exp(), "{end:?}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]

    /// The sum at the end of a step and the defect, whose rounding is all that is left.
    #[test]
    fn sums_over_the_powers_of_the_time_are_rounded_outward(
        c in proptest::collection::vec(-1.0_f64..1.0, 4), h in 0.1_f64..1.0,
    ) {
        let over = over(0, 3);
        let isa = Isa::detect();
        let full = Arithmetic::new(over.space.basis.with_time(3), 3, isa);
        let mut path = full.constant([0.0; LANES]);
        for (to, from) in path.coefficients.iter_mut().zip(&c) {
            *to = [*from; LANES];
        }
        let (end, rounding) = at_the_end(&over, &path);
        let sum = c.iter().fold(zero(), |sum, c| sum + exact(*c));
        prop_assert!(within(&sum, &exact(end[0][0]), rounding[0]));
        prop_assert!(rounding[0] < 1e-14);
        // Rates that are the path's slopes as well as they can be.
        let mut rate = full.constant([0.0; LANES]);
        for k in 0..3 {
            rate.coefficients[k] = [to_f64(k + 1) * c[k + 1] / h; LANES];
        }
        let found = defect(&full, &path, &rate, h);
        let mut wanted = zero();
        for k in 0..3 {
            let difference = exact(h) * exact(rate.coefficients[k][0])
                - exact(to_f64(k + 1)) * exact(c[k + 1]);
            let size = if difference < zero() { -difference } else { difference };
            wanted += size / exact(to_f64(k + 1));
        }
        prop_assert!(wanted <= exact(found[0]) && found[0] < 1e-14);
        rate.remainder = [0.25; LANES];
        prop_assert!(defect(&full, &path, &rate, h)[0] >= h * 0.25);
    }
}
