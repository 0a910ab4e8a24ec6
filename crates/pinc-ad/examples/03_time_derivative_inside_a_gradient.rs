//! The idea of a physics-informed net: a loss that contains dy/dt of a net, and its gradient in the
//! net's weights. Forward mode in time, inside reverse mode in the weights; no derivative is
//! written by hand.
//!
//! `cargo run -p pinc-ad --example 03_time_derivative_inside_a_gradient`
#![expect(clippy::print_stdout, reason = "an example shows what it computes")]

use pinc_ad::{Dual, Scalar, Tape, Var, derivative};

/// Neurons in the net's one layer.
const NEURONS: usize = 3;

/// Times in s at which the net has to satisfy the equation y' = -y.
const TIMES_S: [f64; 5] = [0.0, 0.25, 0.5, 0.75, 1.0];

/// `y(t) = 1 + t sum_i a_i tanh(b_i t + c_i)`, which begins in 1 whatever the weights (a, b, c)
/// are.
fn net<S: Scalar>(weights: &[S], t: S) -> S {
    let neuron = |w: &[S]| w[0] * (w[1] * t + w[2]).tanh();
    let sum = weights.chunks(NEURONS).map(neuron).fold(t.constant(0.0), |sum, term| sum + term);
    t * sum + 1.0
}

/// The mean of the squared residuals (y' + y)^2.
fn loss<'t>(weights: &[Var<'t>]) -> Var<'t> {
    let lifted: Vec<_> = weights.iter().map(|&w| Dual::lift(w)).collect();
    let squared = |&time_s: &f64| {
        let t = weights[0].constant(time_s);
        let slope = derivative(|t| net(&lifted, t), t);
        (slope + net(weights, t)).powi(2)
    };
    let sum = TIMES_S.iter().map(squared).fold(weights[0].constant(0.0), |sum, term| sum + term);
    sum / 5.0
}

pub(crate) fn main() {
    let mut weights = [-0.5, 1.0, 0.1, -0.3, -0.5, 0.5, 0.2, 0.7, -0.4];
    let mut momentum = [0.0; 3 * NEURONS];
    let mut tape = Tape::new();
    for iteration in 0..=2000 {
        let variables: Vec<_> = weights.iter().map(|&w| tape.variable(w)).collect();
        let loss = loss(&variables);
        let gradient = tape.gradient(loss, &variables);
        if iteration % 500 == 0 {
            println!("iteration {iteration:4}: loss {:.2e}", loss.value());
        }
        for (i, slope) in gradient.iter().enumerate() {
            momentum[i] = 0.9 * momentum[i] - 0.05 * slope;
            weights[i] += momentum[i];
        }
        tape.clear();
    }
    // The net has seen the equation only, never its solution exp(-t).
    let end = net(&weights, 1.0);
    println!("y(1) = {end:.5}, and exp(-1) = {:.5}", (-1.0_f64).exp());
    assert!((end - (-1.0_f64).exp()).abs() < 1e-2);
}
