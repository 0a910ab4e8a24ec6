//! Levenberg-Marquardt on problems with known answers, judged by work counters.

use pinc_net::Workers;
use pinc_net::optim::{
    Iterate, LeastSquares, LevenbergMarquardtConfig, Objective, Optimizer, OptimizerConfig, Outcome,
};

/// A sum of squares, from a function that fills the residuals and their Jacobian, `[residuals,
/// variables]`. Where the residuals are not finite, the value is not either.
struct Squares<F> {
    residuals: usize,
    f: F,
    evaluations: usize,
}

impl<F: Fn(&[f64], &mut [f64], &mut [Vec<f64>])> Squares<F> {
    fn new(residuals: usize, f: F) -> Self {
        Self { residuals, f, evaluations: 0 }
    }

    fn linearize(&self, x: &[f64]) -> (Vec<f64>, Vec<Vec<f64>>) {
        let (mut r, mut jacobian) =
            (vec![0.0; self.residuals], vec![vec![0.0; x.len()]; self.residuals]);
        (self.f)(x, &mut r, &mut jacobian);
        (r, jacobian)
    }
}

impl<F: Fn(&[f64], &mut [f64], &mut [Vec<f64>])> Objective for Squares<F> {
    fn evaluate(&mut self, x: &[f64], gradient: &mut [f64]) -> f64 {
        self.evaluations += 1;
        let (r, jacobian) = self.linearize(x);
        for (j, g) in gradient.iter_mut().enumerate() {
            *g = 2.0 * r.iter().zip(&jacobian).map(|(r, row)| r * row[j]).sum::<f64>();
        }
        r.iter().map(|r| r * r).sum()
    }
}

impl<F: Fn(&[f64], &mut [f64], &mut [Vec<f64>])> LeastSquares for Squares<F> {
    fn normal_matrix(&mut self, x: &[f64], out: &mut [f64]) {
        let (_, jacobian) = self.linearize(x);
        for j in 0..x.len() {
            for i in 0..x.len() {
                // NaN above the diagonal: that part has no meaning and must not be read.
                let entry = jacobian.iter().map(|row| row[i] * row[j]).sum();
                out[j * x.len() + i] = if i < j { f64::NAN } else { entry };
            }
        }
    }
}

/// Iterates Levenberg-Marquardt to the end; the last iterate, its outcome, iterations and
/// evaluations.
fn fit<F: Fn(&[f64], &mut [f64], &mut [Vec<f64>])>(
    mut problem: Squares<F>,
    start: Vec<f64>,
    initial_damping: f64,
) -> (Iterate, Outcome, usize, usize) {
    let config = LevenbergMarquardtConfig { initial_damping, gradient_tolerance: 1e-10 };
    let workers = Workers::new(1).unwrap();
    let config = OptimizerConfig::LevenbergMarquardt(config);
    let mut optimizer = Optimizer::new(&config, start.len());
    let mut at = Iterate::new(&mut problem, start);
    for iteration in 0..200 {
        let before = at.clone();
        let outcome = optimizer.step(&mut problem, &mut at, &workers);
        if outcome != Outcome::Moved {
            assert_eq!(at, before, "it has not moved");
            return (at, outcome, iteration, problem.evaluations);
        }
        assert!(at.value < before.value, "it falls");
        let mut gradient = vec![0.0; at.x.len()];
        let value = problem.evaluate(&at.x, &mut gradient);
        problem.evaluations -= 1;
        assert_eq!((value.to_bits(), &gradient), (at.value.to_bits(), &at.gradient));
    }
    (at, Outcome::Moved, 200, problem.evaluations)
}

/// Rosenbrock's function of two variables as residuals 10 (y - x^2), 1 - x.
fn rosenbrock_residuals(x: &[f64], r: &mut [f64], jacobian: &mut [Vec<f64>]) {
    r.copy_from_slice(&[10.0 * (x[1] - x[0] * x[0]), 1.0 - x[0]]);
    jacobian[0].copy_from_slice(&[-20.0 * x[0], 10.0]);
    jacobian[1].copy_from_slice(&[-1.0, 0.0]);
}

#[test]
fn levenberg_marquardt_solves_rosenbrocks_problem_in_few_iterations() {
    let problem = Squares::new(2, rosenbrock_residuals);
    let (at, outcome, iterations, evaluations) = fit(problem, vec![-1.2, 1.0], 1e-3);
    assert_eq!(outcome, Outcome::Converged);
    // Quasi-Newton methods take about 35 iterations.
    assert!(iterations <= 25, "{iterations}");
    assert!(evaluations <= 2 * iterations, "one per trial: {evaluations} for {iterations}");
    // |x - x*| <= |g| / smallest eigenvalue of the Hessian, about 0.4.
    assert!(at.x.iter().all(|x| (x - 1.0).abs() < 1e-9), "{:?}", at.x);
}

#[test]
fn levenberg_marquardt_recovers_the_exponentials_behind_exact_data() {
    // y = 4 exp(-4 t) - 4 exp(-5 t) at 45 times, from the reference's start (example 1.1).
    let model = |x: &[f64], t: f64| x[2] * (x[0] * t).exp() + x[3] * (x[1] * t).exp();
    let truth = [-4.0, -5.0, 4.0, -4.0];
    let problem = Squares::new(45, move |x, r, jacobian| {
        for (i, (r, row)) in r.iter_mut().zip(jacobian).enumerate() {
            let t = 0.02 * (i as f64 + 1.0);
            *r = model(x, t) - model(&truth, t);
            let (a, b) = ((x[0] * t).exp(), (x[1] * t).exp());
            row.copy_from_slice(&[x[2] * t * a, x[3] * t * b, a, b]);
        }
    });
    let (at, outcome, iterations, _) = fit(problem, vec![-1.0, -2.0, 1.0, -1.0], 1e-3);
    assert_ne!(outcome, Outcome::Moved, "{iterations}");
    // Residuals of zero, up to rounding; the problem is ill-conditioned (the reference stops after
    // 62 iterations with x to 4 digits), so that x is much less exact.
    assert!(at.value < 1e-20, "{:e} after {iterations}", at.value);
    for (x, truth) in at.x.iter().zip(truth) {
        assert!((x - truth).abs() < 1e-2, "{:?}", at.x);
    }
}

#[test]
fn levenberg_marquardt_bears_a_jacobian_without_full_rank() {
    // Only the sum of the first two variables counts, and the third not at all.
    let problem = Squares::new(3, |x, r, jacobian| {
        for (i, (r, row)) in r.iter_mut().zip(jacobian).enumerate() {
            let slope = i as f64 + 1.0;
            *r = slope * (x[0] + x[1] - 3.0);
            row.copy_from_slice(&[slope, slope, 0.0]);
        }
    });
    let (at, outcome, iterations, _) = fit(problem, vec![10.0, -4.0, 7.0], 1e-3);
    assert_eq!(outcome, Outcome::Converged);
    assert!(iterations < 10, "{iterations}");
    // Each step lies in the row space: the first two move alike, the third not at all.
    for (x, expected) in at.x.iter().zip([8.5, -5.5, 7.0]) {
        assert!((x - expected).abs() < 1e-9, "{:?}", at.x);
    }
}

#[test]
fn levenberg_marquardt_steps_back_from_where_the_residuals_are_not_finite() {
    // log(x) = 0 from 50: the undamped step goes to a negative x.
    let logarithm = |x: &[f64], r: &mut [f64], jacobian: &mut [Vec<f64>]| {
        r[0] = x[0].ln();
        jacobian[0][0] = 1.0 / x[0];
    };
    let (at, outcome, _, evaluations) = fit(Squares::new(1, logarithm), vec![50.0], 1e-9);
    assert_eq!(outcome, Outcome::Converged);
    assert!((at.x[0] - 1.0).abs() < 1e-9, "{:?}", at.x);
    assert!(evaluations < 40, "{evaluations}");
}

#[test]
fn levenberg_marquardt_reports_a_function_without_descent() {
    // Wrong signs: the residual grows along each step. And a Jacobian that is not finite, or zero.
    for slope in [-1.0, f64::NAN, f64::INFINITY] {
        let mut problem = Squares::new(1, move |x, r, jacobian| {
            r[0] = 1.0 + x[0];
            jacobian[0][0] = slope;
        });
        let config = LevenbergMarquardtConfig { initial_damping: 1e-3, gradient_tolerance: 1e-10 };
        let config = OptimizerConfig::LevenbergMarquardt(config);
        let mut optimizer = Optimizer::new(&config, 1);
        let mut at = Iterate { x: vec![0.0], value: 1.0, gradient: vec![2.0 * slope] };
        let workers = Workers::new(1).unwrap();
        let outcome = optimizer.step(&mut problem, &mut at, &workers);
        assert_eq!((outcome, at.x[0].to_bits()), (Outcome::Stuck, 0), "{slope}");
        assert!(problem.evaluations < 30, "{slope}: {}", problem.evaluations);
    }
}

/// The optimizer after its first iterations on the residual `f` of one variable, from 1.
fn iterate(initial_damping: f64, f: fn(f64) -> (f64, f64), iterations: usize) -> f64 {
    let mut problem = Squares::new(1, move |x, r, jacobian| (r[0], jacobian[0][0]) = f(x[0]));
    let config = LevenbergMarquardtConfig { initial_damping, gradient_tolerance: 0.0 };
    let mut optimizer = Optimizer::new(&config.into(), 1);
    let mut at = Iterate::new(&mut problem, vec![1.0]);
    let workers = Workers::new(1).unwrap();
    for _ in 0..iterations {
        assert_eq!(optimizer.step(&mut problem, &mut at, &workers), Outcome::Moved);
    }
    at.x[0]
}

/// The first damping is relative to J'J: in whatever units the residual a x is, the first step from
/// 1 with mu = J'J / 2 goes to 1 - 1/(1 + 1/2).
#[test]
fn the_first_damping_is_relative_to_the_normal_matrix() {
    for f in [|x| (1e-5 * x, 1e-5), |x| (3.0 * x, 3.0), |x| (1e5 * x, 1e5)] {
        let x = iterate(0.5, f, 1);
        assert!((x - 1.0 / 3.0).abs() < 1e-14, "{x}");
    }
}

/// Algorithm 3.16 of the reference, worked out for r = x^2 from 1 with mu = J'J = 4.
#[test]
fn the_damping_follows_the_gain() {
    let (first, second) = (iterate(1.0, |x| (x * x, 2.0 * x), 1), 0.75);
    assert!((first - second).abs() < 1e-15, "{first}");
    // From r^2 = 1 to (9/16)^2; the linear model falls by h (mu h - J r) = 3/4 with h = -1/4.
    let gain: f64 = (1.0 - (9.0_f64 / 16.0).powi(2)) / 0.75;
    let mu = 4.0 * (1.0 - (2.0 * gain - 1.0).powi(3));
    // That is more than a third of 4; now J = 3/2 and r = 9/16.
    assert!(mu > 4.0 / 3.0);
    let expected = 0.75 - 1.5 * 9.0 / 16.0 / (2.25 + mu);
    let x = iterate(1.0, |x| (x * x, 2.0 * x), 2);
    assert!((x - expected).abs() < 1e-15, "{x} {expected}");
}

/// Damping grows by 2, 4, 8, .. from 1e-3 to 1e30 times J'J, in whatever units: its exponent of 2
/// is k (k + 1)/2 after k failures, which must not exceed log2 of 1e33, so that k = 0 .. 14.
#[test]
fn damping_grows_to_its_limit_in_any_units() {
    for slope in [-1e-5, -1.0, -1e5] {
        let mut problem = Squares::new(1, move |x, r, jacobian| {
            (r[0], jacobian[0][0]) = (1.0 + x[0], slope);
        });
        let config = LevenbergMarquardtConfig::default();
        let mut optimizer = Optimizer::new(&config.into(), 1);
        let mut at = Iterate { x: vec![0.0], value: 1.0, gradient: vec![2.0 * slope] };
        let outcome = optimizer.step(&mut problem, &mut at, &Workers::new(1).unwrap());
        assert_eq!((outcome, problem.evaluations), (Outcome::Stuck, 15), "{slope}");
    }
}
