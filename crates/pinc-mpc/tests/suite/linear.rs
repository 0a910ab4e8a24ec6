//! Linear models, whose optimal control is known by a formula.

use crate::support::{Linear, scalar_problem};
use pinc_mpc::{Bounds, Nmpc, NmpcProblem, SqpConfig, SqpStatus, Weights};

/// The QP solver's accuracy: gap and residuals of 1e-10 in problems of curvature 1 and more.
const TOLERANCE: f64 = 1e-8;

fn first_input(problem: NmpcProblem, model: Linear, x: f64, reference: &[f64]) -> f64 {
    let mut nmpc = Nmpc::new(problem, Box::new(model), SqpConfig::default()).unwrap();
    let step = nmpc.step(&[x], reference).unwrap();
    assert_eq!(step.status, SqpStatus::Converged);
    // The QP is the problem itself.
    assert_eq!(step.sqp_iterations, 1);
    step.u[0]
}

/// min q (a x + b u - y)^2 + r u^2
#[test]
fn one_step_ahead() {
    let (a, b, x, y, q, r) = (1.3, 0.7, 2.0, -1.5, 2.0, 3.0);
    let expected = q * b * (y - a * x) / (q * b * b + r);
    let u = first_input(scalar_problem(1, 1), Linear::scalar(a, b), x, &[y]);
    assert!((u - expected).abs() < TOLERANCE, "{u} {expected}");
}

/// u\[k-1\] is the input given before: the second step minimizes q (..)^2 + r (u - before)^2.
#[test]
fn moves_are_counted_from_the_last_input() {
    let (a, b, q, r) = (1.3, 0.7, 2.0, 3.0);
    let model = Box::new(Linear::scalar(a, b));
    let mut nmpc = Nmpc::new(scalar_problem(1, 1), model, SqpConfig::default()).unwrap();
    let before = nmpc.step(&[2.0], &[-1.5]).unwrap().u[0];
    let (x, y) = (0.4, 0.9);
    let expected = (q * b * (y - a * x) + r * before) / (q * b * b + r);
    let u = nmpc.step(&[x], &[y]).unwrap().u[0];
    assert!((u - expected).abs() < TOLERANCE, "{u} {expected}");

    nmpc.reset();
    let again = nmpc.step(&[2.0], &[-1.5]).unwrap().u[0];
    assert_eq!(again.to_bits(), before.to_bits());
}

/// The Riccati recursion in the state s = (x, u\[k-1\]) and the move du, both weights depending on
/// the stage: the cost to go is s'P s.
fn riccati(a: f64, b: f64, x: f64, weights: &[f64]) -> f64 {
    let (f, g) = ([[a, b], [0.0, 1.0]], [b, 1.0]);
    let mut p = [[0.0; 2]; 2];
    let mut gain = [0.0; 2];
    for &weight in weights.iter().rev() {
        let (q, r) = (2.0 * weight, 3.0 * weight);
        // The cost of stage j is on the state it leads to.
        p[0][0] += q;
        let dot = |v: [f64; 2], w: [f64; 2]| v[0] * w[0] + v[1] * w[1];
        let times = |v: [f64; 2]| [dot(p[0], v), dot(p[1], v)];
        let column = |j: usize| [f[0][j], f[1][j]];
        let denominator = r + dot(g, times(g));
        gain = [0, 1].map(|j| dot(g, times(column(j))) / denominator);
        p = [0, 1].map(|i| {
            [0, 1].map(|j| dot(column(i), times(column(j))) - denominator * gain[i] * gain[j])
        });
    }
    -gain[0] * x
}

#[test]
fn a_horizon_of_four_is_the_linear_quadratic_regulator() {
    for (a, b) in [(0.9, 0.5), (1.4, -0.3), (-1.1, 2.0)] {
        let expected = riccati(a, b, 1.7, &[1.0; 4]);
        let u = first_input(scalar_problem(4, 4), Linear::scalar(a, b), 1.7, &[0.0; 4]);
        assert!((u - expected).abs() < TOLERANCE, "{u} {expected}");
    }
}

#[test]
fn weights_may_differ_by_stage() {
    let mut problem = scalar_problem(3, 3);
    let factors = [3.0, 2.0, 1.0];
    problem.weights = Weights::scaled(vec![2.0], vec![3.0], &factors, &factors);
    let expected = riccati(1.2, 0.8, 1.7, &factors);
    let u = first_input(problem, Linear::scalar(1.2, 0.8), 1.7, &[0.0; 3]);
    assert!((u - expected).abs() < TOLERANCE, "{u} {expected}");
}

/// With Nu = 1 the input is held: `x_j = alpha_j x + beta_j u`, a least-squares problem in u alone.
#[test]
fn inputs_are_held_after_nu() {
    let (a, b, x, q, r) = (0.8, 0.6, 2.5, 2.0, 3.0);
    let alpha = [a, a * a, a * a * a];
    let beta = [b, b * (1.0 + a), b * (1.0 + a + a * a)];
    let y = [1.0, -0.5, 0.25];
    let least_squares = |first: usize| {
        let stages = first - 1..3;
        let pull: f64 = stages.clone().map(|j| beta[j] * (y[j] - alpha[j] * x)).sum();
        let square: f64 = stages.map(|j| beta[j] * beta[j]).sum();
        q * pull / (q * square + r)
    };
    let u = first_input(scalar_problem(3, 1), Linear::scalar(a, b), x, &y);
    assert!((u - least_squares(1)).abs() < TOLERANCE);

    // N1 = 3: only the last state is tracked.
    let mut problem = scalar_problem(3, 1);
    problem.n1 = 3;
    let u = first_input(problem, Linear::scalar(a, b), x, &y);
    assert!((u - least_squares(3)).abs() < TOLERANCE);
}

#[test]
fn a_bound_on_the_input_is_met_exactly() {
    let mut problem = scalar_problem(2, 2);
    problem.input_bounds.high = vec![0.25];
    let model = Box::new(Linear::scalar(1.0, 1.0));
    let mut nmpc = Nmpc::new(problem, model, SqpConfig::default()).unwrap();
    let step = nmpc.step(&[0.0], &[100.0; 2]).unwrap();
    assert_eq!(step.status, SqpStatus::Converged);
    // Beside an active bound the solver's distance is its gap, 1e-10, over the multiplier, 1e2.
    assert!(step.u[0] <= 0.25 && step.u[0] > 0.25 - 1e-10, "{}", step.u[0]);
    assert!(nmpc.plan().input_multipliers()[0] > 1.0);
}

#[test]
fn a_bound_on_the_state_holds_from_the_first_predicted_one_on() {
    let mut problem = scalar_problem(2, 2);
    problem.state_bounds.high = vec![1.0];
    let model = Box::new(Linear::scalar(1.0, 1.0));
    let mut nmpc = Nmpc::new(problem, model, SqpConfig::default()).unwrap();
    // The measured state is outside, the reference too.
    let step = nmpc.step(&[4.0], &[100.0; 2]).unwrap();
    assert_eq!(step.status, SqpStatus::Converged);
    assert!((step.u[0] + 3.0).abs() < TOLERANCE, "{}", step.u[0]);
    assert!((nmpc.plan().states()[1] - 1.0).abs() < TOLERANCE);
}

/// An input whose bounds are one value, and a state bound that is out of reach beside it.
#[test]
fn bounds_may_coincide() {
    let mut problem = scalar_problem(3, 3);
    problem.input_bounds = Bounds { low: vec![0.5], high: vec![0.5] };
    problem.state_bounds.low = vec![-50.0];
    let model = Box::new(Linear::scalar(1.0, 1.0));
    let mut nmpc = Nmpc::new(problem, model, SqpConfig::default()).unwrap();
    let step = nmpc.step(&[1.0], &[0.0; 3]).unwrap();
    assert_eq!(step.status, SqpStatus::Converged, "{:?}", step.kkt);
    assert!((step.u[0] - 0.5).abs() < 1e-15);
    assert!((nmpc.plan().states()[2] - 2.5).abs() < TOLERANCE);
}
