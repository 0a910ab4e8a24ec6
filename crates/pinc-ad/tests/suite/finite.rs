//! Central differences, and that the check built on them can fail.

use pinc_ad::{central_difference, check_gradient};

/// f = x^3 y - z, gradient (3 x^2 y, x^3, -1).
fn f(v: &[f64]) -> f64 {
    v[0].powi(3) * v[1] - v[2]
}

const AT: [f64; 3] = [2.0, -1.5, 40.0];
const GRADIENT: [f64; 3] = [-18.0, 8.0, -1.0];
/// About ten times what central differences are good for on numbers of this size (50).
const TOLERANCE: f64 = 1e-8;

#[test]
fn differences_of_a_cubic() {
    for (i, expected) in GRADIENT.into_iter().enumerate() {
        let difference = central_difference(f, &AT, i);
        assert!((difference - expected).abs() < TOLERANCE, "{i}: {difference}");
    }
}

#[test]
fn step_grows_with_the_argument() {
    // At 1e9 a step of 6e-6 would be lost in rounding: d/dx x^2 = 2e9 needs a relative one.
    let slope = central_difference(|v| v[0] * v[0], &[1e9], 0);
    assert!((slope / 2e9 - 1.0).abs() < 1e-9, "{slope}");
}

#[test]
fn right_gradient_passes() {
    assert_eq!(check_gradient(f, &AT, &GRADIENT, TOLERANCE), Ok(()));
}

#[test]
fn wrong_gradient_is_rejected_with_its_place() {
    for index in 0..3 {
        for wrong in [1e-6, -1e-6, f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            let mut gradient = GRADIENT;
            gradient[index] += wrong * GRADIENT[index].abs();
            let mismatch = check_gradient(f, &AT, &gradient, TOLERANCE).unwrap_err();
            assert_eq!(mismatch.index, index);
            assert_eq!(mismatch.given.to_bits(), gradient[index].to_bits());
            assert!((mismatch.difference - GRADIENT[index]).abs() < TOLERANCE);
        }
    }
}

#[test]
fn swapped_derivatives_are_rejected() {
    let swapped = [GRADIENT[1], GRADIENT[0], GRADIENT[2]];
    assert_eq!(check_gradient(f, &AT, &swapped, TOLERANCE).unwrap_err().index, 0);
}

#[test]
fn function_without_a_finite_difference_is_rejected() {
    for bad in [f64::NAN, f64::INFINITY] {
        let poisoned = |v: &[f64]| if v[0] > 1.0 { bad } else { 0.0 };
        for given in [0.0, 1.0, f64::INFINITY] {
            let result = check_gradient(poisoned, &[1.0], &[given], TOLERANCE);
            assert_eq!(result.unwrap_err().index, 0, "{bad} {given}");
        }
    }
}

#[test]
fn a_mismatch_is_named() {
    let mismatch = check_gradient(|v| v[0], &[0.0], &[2.0], TOLERANCE).unwrap_err();
    let text = mismatch.to_string();
    assert!(text.starts_with("derivative 0 is 2e0, its central difference"), "{text}");
}

#[test]
#[should_panic(expected = "one derivative per input")]
fn gradient_of_another_length_is_a_programming_error() {
    let _ = check_gradient(f, &AT, &GRADIENT[..2], TOLERANCE);
}
