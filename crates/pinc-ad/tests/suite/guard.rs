//! `where_nonpositive`: the side taken, its derivative, and what is not taken never shows.

#![expect(clippy::float_cmp, reason = "the results are exact in binary")]

use pinc_ad::{Dual, Lanes, Scalar, Tape, derivative, gradient};

/// 3x where x <= 0, x^2 + 1 elsewhere.
fn two_sides<S: Scalar>(x: S) -> S {
    x.where_nonpositive(x * 3.0, x * x + 1.0)
}

#[test]
fn value_of_the_side_taken() {
    let cases = [(-2.0, -6.0), (-0.0, 0.0), (0.0, 0.0), (1e-300, 1.0), (2.0, 5.0)];
    for (x, expected) in cases {
        assert_eq!(two_sides(x), expected, "{x}");
    }
}

#[test]
fn derivative_of_the_side_taken() {
    for (x, expected) in [(-2.0, 3.0), (-0.0, 3.0), (0.0, 3.0), (1e-300, 2e-300), (2.0, 4.0)] {
        assert_eq!(derivative(two_sides, x), expected, "dual at {x}");
        assert_eq!(gradient(|v| two_sides(v[0]), &[x]).1, [expected], "tape at {x}");
    }
}

#[test]
fn second_derivative_of_the_side_taken() {
    for (x, expected) in [(-2.0, 0.0), (0.0, 0.0), (2.0, 2.0)] {
        assert_eq!(derivative(|x| derivative(two_sides, x), x), expected, "{x}");
    }
}

#[test]
fn every_lane_takes_its_own_side() {
    let x = Dual::<Lanes<4>>::variable(Lanes([-2.0, 0.0, f64::NAN, 2.0]), 0);
    let y = two_sides(x);
    assert_eq!((y.re.0[0], y.re.0[1], y.re.0[3]), (-6.0, 0.0, 5.0));
    assert_eq!((y.eps[0].0[0], y.eps[0].0[1], y.eps[0].0[3]), (3.0, 3.0, 4.0));
    assert!(y.re.0[2].is_nan() && y.eps[0].0[2].is_nan());
}

/// A NaN test takes the side of the positive numbers, where it shows.
#[test]
fn nan_stays_visible() {
    assert!(two_sides(f64::NAN).is_nan());
    assert!(derivative(two_sides, f64::NAN).is_nan());
    let (value, slope) = gradient(|v| two_sides(v[0]), &[f64::NAN]);
    assert!(value.is_nan() && slope[0].is_nan());
    let taken = f64::NAN.where_nonpositive(1.0, 2.0);
    assert_eq!(taken, 2.0);
}

/// ln is NaN below 0 and has an infinite derivative at 0; neither may leak from the side that is
/// not taken, in value or derivative, forward or reverse or nested.
#[test]
fn the_other_side_does_not_leak() {
    fn guarded<S: Scalar>(x: S) -> S {
        x.where_nonpositive(x * 2.0, x.ln())
    }
    for x in [-4.0, -0.0, 0.0] {
        assert_eq!(guarded(x), 2.0 * x, "value at {x}");
        assert_eq!(derivative(guarded, x), 2.0, "dual at {x}");
        assert_eq!(gradient(|v| guarded(v[0]), &[x]), (2.0 * x, vec![2.0]), "tape at {x}");
        assert_eq!(derivative(|x| derivative(guarded, x), x), 0.0, "dual of dual at {x}");

        let tape = Tape::new();
        let input = tape.variable(x);
        let slope = derivative(guarded, input);
        assert_eq!(slope.value(), 2.0, "dual of tape at {x}");
        assert_eq!(tape.gradient(slope, &[input]), [0.0], "tape of dual at {x}");
    }
    // ln'(4) = 1/4, ln''(4) = -1/16
    assert_eq!(derivative(guarded, 4.0), 0.25);
    assert_eq!(derivative(|x| derivative(guarded, x), 4.0), -0.0625);
}
