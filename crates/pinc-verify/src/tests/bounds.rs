//! Each part of what a box, a point or a tube does not know, in a case that would show its lack.

use super::flows::flow;
use super::{Numbers, exact};
use crate::basis::Basis;
use crate::interval::Interval;
use crate::kernel::LANES;
use crate::points::PointError;
use crate::polynomial::Polynomial;
use crate::problem::{BoxError, variable};
use crate::taylor::Arithmetic;
use pinc_ad::simd::Isa;

/// A polynomial that is 1/2 everywhere, with parts missing of model, flow and rounding.
fn half() -> BoxError {
    BoxError {
        polynomials: vec![Polynomial { coefficients: vec![0.5], rounding: 0.0625 }],
        of_map: vec![0.25],
        of_flow: vec![0.125],
        drives: [vec![0.0], vec![0.0]],
        obstacle: None,
    }
}

#[test]
fn a_point_misses_what_model_flow_and_rounding_miss() {
    let found = PointError::of(&half());
    let missing = 0.25 + 0.125 + 0.0625;
    assert!((found.uncertainty[0] - missing).abs() < 1e-8, "{found:?}");
    assert!((found.bound()[0] - 0.5 - missing).abs() < 1e-8, "{found:?}");
    assert!((found.least()[0] - 0.5 + missing).abs() < 1e-8, "{found:?}");
}

#[test]
fn ranges_and_choices_keep_remainders() {
    let over = Arithmetic::new(Basis::of_space(1, 2), 2, Isa::detect());
    let one = over.constant([1.0; LANES]).with_remainder([0.25; LANES]);
    let Interval { low, high } = one.ranges()[3];
    assert!(low <= 0.75 && high >= 1.25, "{low} {high}");
    assert_eq!(
        over.choose(&one, &over.unknown(), &one).remainder.map(f64::to_bits),
        [0.25f64.to_bits(); LANES]
    );
}

#[test]
fn a_box_holds_its_ends() {
    let over = Arithmetic::new(Basis::of_space(1, 2), 2, Isa::detect());
    for ends in [[0.1, 0.3], [-1.0, 2.0], [1e-3, 0.7]] {
        let model = variable(&over, &[&[ends]], 0);
        let (middle, radius) = (model.coefficients[0][0], model.coefficients[1][0]);
        assert!(middle - radius <= ends[0] && middle + radius >= ends[1], "{ends:?}");
    }
    // Exactly, in narrow boxes whose middles are rounded; and with numbers in place of polynomials.
    let numbers_alone = Arithmetic::new(Basis::of_space(0, 0), 2, Isa::detect());
    let mut numbers = Numbers::new();
    for _ in 0..200 {
        let low = numbers.of_any_size();
        let ends = [low, low + low.abs() * numbers.between(1e-12, 1e-8)];
        let model = variable(&over, &[&[ends]], 0);
        let number = variable(&numbers_alone, &[&[ends]], 0);
        for (middle, radius) in [
            (model.coefficients[0][0], model.coefficients[1][0]),
            (number.coefficients[0][0], number.remainder[0]),
        ] {
            let (middle, radius) = (exact(middle), exact(radius));
            assert!(&middle - &radius <= exact(ends[0]), "{ends:?}");
            assert!(middle + radius >= exact(ends[1]), "{ends:?}");
        }
    }
}

/// x' = x^2 from 1 and from 3/2: shortly before the second solution ends they are 147 apart, more
/// than the first tube allows for.
#[test]
fn a_solution_that_leaves_its_tube_is_not_bounded_by_it() {
    let h = 0.66;
    let path = vec![Interval { low: 1.0, high: 1.0 / (1.0 - h) + 1e-9 }];
    let held = vec![Interval::point(0.0)];
    let end = flow("x^2", h).in_a_tube(&[path, held], h, &[0.5], &[0.0]);
    assert!(end.as_ref().is_none_or(|end| end[0] >= 147.0), "{end:?}");
}

/// A product with 0, a choice and a logarithm have no slope where they are not smooth.
#[test]
fn slopes_are_unknown_where_an_equation_is_not_smooth() {
    let slope = |text: &str, x: [f64; 2], u: f64| {
        let [low, high] = x;
        let variables = [Interval { low, high }, Interval::point(u)];
        flow(text, 1.0).equation.jacobian(&variables)[0]
    };
    for (text, x) in [
        ("u*sqrt(x)", [-1.0, 1.0]),
        ("max(x, 1)", [0.0, 2.0]),
        ("min(x, 1)", [0.0, 2.0]),
        ("log(x)", [-2.0, -1.0]),
        ("abs(x)", [-1.0, 1.0]),
        ("1/x", [-1.0, 1.0]),
        ("x^0.5", [-2.0, -1.0]),
    ] {
        assert_eq!(slope(text, x, 0.0), Interval::ENTIRE, "{text}");
    }
    assert_eq!(slope("max(x, 1)", [2.0, 3.0], 0.0), Interval::point(1.0));
}
