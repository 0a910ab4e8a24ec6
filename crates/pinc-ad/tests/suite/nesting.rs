//! Derivatives inside derivatives: perturbations must not be confused, and a loss that contains
//! dy/dt of a net must have the right gradient in the weights.

#![expect(clippy::float_cmp, reason = "the results are exact in binary")]

use pinc_ad::{Dual, Scalar, Tape, Var, check_gradient, derivative};

/// d/dx [x d/dy (x + y)] = 1. Confusing the two perturbations gives 2.
#[test]
fn perturbations_are_not_confused() {
    for x in [-1.5, 0.0, 3.0] {
        let outer = |x: Dual<f64>| x * derivative(|y| Dual::lift(x) + y, x.constant(1.0));
        assert_eq!(derivative(outer, x), 1.0);
    }
}

/// d/dx [x d/dy (x y)] at y = 2 is d/dx x^2 = 2x. Confused: 3x or more.
#[test]
fn product_of_both_variables() {
    for x in [-1.5, 0.25, 3.0] {
        let outer = |x: Dual<f64>| x * derivative(|y| Dual::lift(x) * y, x.constant(2.0));
        assert_eq!(derivative(outer, x), 2.0 * x);
    }
}

/// The same variable on both levels: d/dx [d/dy (x^2 y^3) at y = x] = d/dx 3 x^4 = 12 x^3.
#[test]
fn inner_point_depends_on_the_outer_variable() {
    for x in [-1.5, 0.25, 2.0] {
        let outer = |x: Dual<f64>| {
            let lifted = Dual::lift(x);
            derivative(|y| lifted * lifted * y * y * y, x)
        };
        assert_eq!(derivative(outer, x), 12.0 * x * x * x);
    }
}

/// (x^4)''' = 24 x by three levels.
#[test]
fn three_levels() {
    let third = |x: f64| derivative(|x| derivative(|x| derivative(|x| x * x * x * x, x), x), x);
    for x in [-1.0, 0.5, 2.0] {
        assert_eq!(third(x), 24.0 * x);
    }
}

/// On a tape: d/dw of d/dt (w^2 t^2) at t = 3 is 4 w t; d/dt of a constant in t is 0, in w too.
#[test]
fn forward_inside_reverse() {
    let tape = Tape::new();
    let w = tape.variable(0.5);
    let slope = derivative(
        |t: Dual<Var>| {
            let w = Dual::lift(w);
            w * w * t * t + w
        },
        w.constant(3.0),
    );
    assert_eq!(slope.value(), 1.5);
    assert_eq!(tape.gradient(slope, &[w]), [6.0]);
    let still = derivative(|_| Dual::lift(w), w.constant(3.0));
    assert_eq!((still.value(), tape.gradient(still, &[w])), (0.0, vec![0.0]));
}

const HIDDEN: usize = 3;
const WEIGHTS: usize = 2 * HIDDEN + HIDDEN * HIDDEN + HIDDEN + HIDDEN + 1;

/// y(t) = w3 . tanh(W2 tanh(w1 t + b1) + b2) + b3, the weights in this order.
fn net<S: Scalar>(t: S, w: &[S]) -> S {
    let (w1, w) = w.split_at(HIDDEN);
    let (b1, w) = w.split_at(HIDDEN);
    let (w2, w) = w.split_at(HIDDEN * HIDDEN);
    let (b2, w) = w.split_at(HIDDEN);
    let (w3, b3) = w.split_at(HIDDEN);
    let first: [S; HIDDEN] = std::array::from_fn(|i| w1[i].mul_add(t, b1[i]).tanh());
    let mut y = b3[0];
    for (i, row) in w2.chunks_exact(HIDDEN).enumerate() {
        let mut z = b2[i];
        for (&w, &a) in row.iter().zip(&first) {
            z = w.mul_add(a, z);
        }
        y = w3[i].mul_add(z.tanh(), y);
    }
    y
}

const TIMES: [f64; 4] = [0.0, 0.3, 0.8, 1.1];

/// A physics-informed loss: the residual y' + y^2 at four times and the initial condition y(0) = 1.
/// The kind of number decides how dy/dt is had; the rest is the same.
fn loss<S: Scalar>(w: &[S], value_and_slope: impl Fn(f64, &[S]) -> (S, S)) -> S {
    let (start, _) = value_and_slope(0.0, w);
    let mut sum = (start - 1.0) * (start - 1.0);
    for t in TIMES {
        let (y, slope) = value_and_slope(t, w);
        let residual = y.mul_add(y, slope);
        sum = residual.mul_add(residual * 0.25, sum);
    }
    sum
}

fn by_dual<S: Scalar>(t: f64, w: &[S]) -> (S, S) {
    let lifted: Vec<_> = w.iter().map(|&w| Dual::lift(w)).collect();
    let y: Dual<S> = net(Dual::variable(w[0].constant(t), 0), &lifted);
    (y.re, y.eps[0])
}

/// dy/dt by hand: the chain rule written out, without any dual number.
fn by_hand(t: f64, w: &[f64]) -> (f64, f64) {
    let (w1, b1) = (&w[..3], &w[3..6]);
    let (w2, b2) = (&w[6..15], &w[15..18]);
    let (w3, b3) = (&w[18..21], w[21]);
    let a: Vec<f64> = (0..3).map(|i| (w1[i] * t + b1[i]).tanh()).collect();
    let da: Vec<f64> = (0..3).map(|i| (1.0 - a[i] * a[i]) * w1[i]).collect();
    let (mut y, mut dy) = (b3, 0.0);
    for i in 0..3 {
        let z: f64 = b2[i] + (0..3).map(|j| w2[3 * i + j] * a[j]).sum::<f64>();
        let dz: f64 = (0..3).map(|j| w2[3 * i + j] * da[j]).sum();
        y += w3[i] * z.tanh();
        dy += w3[i] * (1.0 - z.tanh().powi(2)) * dz;
    }
    (y, dy)
}

/// Weights of both signs and of order 1, spread by the golden ratio.
fn weights() -> [f64; WEIGHTS] {
    let mut phase = 0.0;
    std::array::from_fn(|_| {
        phase = (phase + 0.618_033_988_749_895) % 1.0;
        2.4 * (phase - 0.5)
    })
}

#[test]
fn gradient_of_a_loss_with_a_time_derivative() {
    let w = weights();
    let tape = Tape::new();
    let inputs = w.map(|v| tape.variable(v));
    let output = loss(&inputs, by_dual);
    let gradient = tape.gradient(output, &inputs);

    let expected = loss(&w, by_hand);
    // About 100 operations on numbers of order 1 in either path.
    assert!((output.value() - expected).abs() < 1e-13, "{expected}");
    // Every weight matters; a gradient of zeros would agree with nothing.
    assert!(gradient.iter().all(|g| g.abs() > 1e-6), "{gradient:?}");
    // Central differences are good to about 1e-10 of the loss and its third derivatives.
    check_gradient(|w| loss(w, by_hand), &w, &gradient, 1e-8).unwrap();
}
