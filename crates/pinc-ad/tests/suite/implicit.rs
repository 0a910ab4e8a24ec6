//! An equation solved inside another: iterated on plain numbers, differentiated by one last step.

use pinc_ad::{Dual, Lanes, Scalar, derivative, gradient};

/// z with z^3 + z = x, by Newton's method.
fn root<S: Scalar>(x: S) -> S {
    let plain = x.plain();
    let mut z = plain.constant(1.0);
    let mut slope = z;
    for _ in 0..12 {
        let at = Dual::<S::Plain>::variable(z, 0);
        let residual = at * at * at + at - Dual::lift(plain);
        slope = residual.eps[0];
        z = z - residual.re / slope;
    }
    let z = x.constants(z);
    z - (z * z * z + z - x) / x.constants(slope)
}

/// dz/dx = 1 / (3 z^2 + 1), by every kind of number with derivatives.
#[test]
fn derivatives_follow_from_the_implicit_function_theorem() {
    for x in [-3.0, 0.0, 0.5, 2.0, 10.0] {
        let z = root(x);
        let expected = 1.0 / (3.0 * z * z + 1.0);
        // Some roundings of numbers of order 10 and below.
        assert!((z * z * z + z - x).abs() < 1e-14, "{x}");
        assert!((derivative(root, x) - expected).abs() < 1e-14, "dual at {x}");
        assert!((gradient(|v| root(v[0]), &[x]).1[0] - expected).abs() < 1e-14, "tape at {x}");
    }
}

#[test]
fn every_lane_has_its_own_root_and_derivative() {
    let x = [-3.0, 0.0, 2.0, 10.0];
    let z = root(Dual::<Lanes<4>>::variable(Lanes(x), 0));
    for (lane, x) in x.into_iter().enumerate() {
        assert!((z.re.0[lane] - root(x)).abs() < 1e-15);
        assert!((z.eps[0].0[lane] - derivative(root, x)).abs() < 1e-15);
    }
}

#[test]
fn a_plain_number_made_a_constant_has_no_derivatives() {
    let frozen = |x: Dual<f64>| x * x.constants(x.plain());
    // d/dx (x c) at c = x is x, not 2x.
    assert!((derivative(frozen, 3.0) - 3.0).abs() < 1e-15);
}
