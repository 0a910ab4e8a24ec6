//! Derivative and gradient of functions that are written once, over any number.
//!
//! `cargo run -p pinc-ad --example 01_derivative`
#![expect(clippy::print_stdout, reason = "an example shows what it computes")]

use pinc_ad::{Scalar, check_gradient, derivative, gradient};

/// The outflow of a tank of level h, in multiples of sqrt(2 g): sqrt(h) above 0, nothing below.
fn outflow<S: Scalar>(h: S) -> S {
    h.where_nonpositive(h.constant(0.0), h.sqrt())
}

/// Rosenbrock's function (1 - x)^2 + 100 (y - x^2)^2.
fn rosenbrock<S: Scalar>(v: &[S]) -> S {
    let (x, y) = (v[0], v[1]);
    (-x + 1.0).powi(2) + (y - x * x).powi(2) * 100.0
}

pub(crate) fn main() {
    // On an f64 the function gives its value, on a dual number its derivative as well, here 1/(2
    // sqrt(h)).
    let slope = derivative(outflow, 4.0);
    println!("outflow at h = 4: {}, its slope: {slope}", outflow(4.0));
    assert!((slope - 0.25).abs() < 1e-15);
    // A branch has the derivative of the side taken.
    println!("slope at h = -1: {}", derivative(outflow, -1.0));
    assert!(derivative(outflow, -1.0).abs() < 1e-15);

    // On a tape: the gradient in one sweep, whatever the number of variables.
    let (value, slopes) = gradient(|v| rosenbrock(v), &[-1.0, 2.0]);
    println!("Rosenbrock's function at (-1, 2): {value}, its gradient: {slopes:?}");

    // Central differences know nothing of the rules of differentiation, and agree.
    check_gradient(rosenbrock, &[-1.0, 2.0], &slopes, 1e-6).expect("the same gradient");
}
