//! Optimizers on problems with known answers, judged by work counters.

use pinc_net::Workers;
use pinc_net::optim::{
    AdamConfig, AutoConfig, Iterate, LbfgsConfig, LeastSquares, LevenbergMarquardtConfig,
    LineSearch, Objective, Optimizer, OptimizerConfig, Outcome, SelfScaledBroydenConfig,
};

/// A function that counts its evaluations.
struct Counting<F> {
    f: F,
    evaluations: usize,
}

impl<F: FnMut(&[f64], &mut [f64]) -> f64> Objective for Counting<F> {
    fn evaluate(&mut self, x: &[f64], gradient: &mut [f64]) -> f64 {
        self.evaluations += 1;
        (self.f)(x, gradient)
    }
}

/// For optimizers that do not ask for the normal matrix.
impl<F: FnMut(&[f64], &mut [f64]) -> f64> LeastSquares for Counting<F> {
    fn normal_matrix(&mut self, _: &[f64], _: &mut [f64]) {
        panic!("not known to be a sum of squares");
    }
}

/// Rosenbrock's function in n dimensions: minimum 0 at (1, .., 1).
fn rosenbrock(x: &[f64], gradient: &mut [f64]) -> f64 {
    gradient.fill(0.0);
    let mut value = 0.0;
    for i in 0..x.len() - 1 {
        let (a, b) = (1.0 - x[i], x[i + 1] - x[i] * x[i]);
        value += a * a + 100.0 * b * b;
        gradient[i] += -2.0 * a - 400.0 * b * x[i];
        gradient[i + 1] += 200.0 * b;
    }
    value
}

/// A quadratic with eigenvalues 1 .. 100 on the diagonal and minimum at (1, 2, 3, ..).
fn quadratic(x: &[f64], gradient: &mut [f64]) -> f64 {
    let n = x.len() as f64;
    let mut value = 0.0;
    for (i, (x, g)) in x.iter().zip(gradient).enumerate() {
        let eigenvalue = 1e2_f64.powf(i as f64 / (n - 1.0));
        let distance = x - (i as f64 + 1.0);
        value += 0.5 * eigenvalue * distance * distance;
        *g = eigenvalue * distance;
    }
    value
}

fn lbfgs(line_search: LineSearch) -> OptimizerConfig {
    OptimizerConfig::Lbfgs(LbfgsConfig { memory: 10, line_search, gradient_tolerance: 1e-10 })
}

fn broyden() -> OptimizerConfig {
    let config = SelfScaledBroydenConfig { initial_step: 0.1, gradient_tolerance: 1e-10 };
    OptimizerConfig::SelfScaledBroyden(config)
}

/// Iterates to the end; returns the last iterate, its outcome and the numbers of iterations and
/// evaluations.
fn minimize(
    config: &OptimizerConfig,
    f: impl FnMut(&[f64], &mut [f64]) -> f64,
    start: Vec<f64>,
    limit: usize,
) -> (Iterate, Outcome, usize, usize) {
    let workers = Workers::new(2).unwrap();
    let mut objective = Counting { f, evaluations: 0 };
    let mut optimizer = Optimizer::new(config, start.len());
    let mut at = Iterate::new(&mut objective, start);
    for iteration in 0..limit {
        let outcome = optimizer.step(&mut objective, &mut at, &workers);
        if outcome != Outcome::Moved {
            return (at, outcome, iteration, objective.evaluations);
        }
    }
    (at, Outcome::Moved, limit, objective.evaluations)
}

#[test]
fn quasi_newton_methods_find_the_minimum_of_rosenbrocks_function() {
    for config in [lbfgs(LineSearch::HagerZhang), lbfgs(LineSearch::WeakWolfe), broyden()] {
        for n in [2, 10, 37] {
            let (at, outcome, iterations, evaluations) =
                minimize(&config, rosenbrock, vec![-1.2; n], 600);
            // -1.2 everywhere leads some methods to the local minimum near (-1, 1, .., 1).
            assert_eq!(
                outcome,
                Outcome::Converged,
                "{config:?}, n = {n}: {:e}",
                at.gradient_norm()
            );
            let global = at.x.iter().all(|x| (x - 1.0).abs() < 1e-8);
            let local = n > 2 && (at.x[0] + 1.0).abs() < 0.05;
            assert!(global || local, "{config:?}, n = {n}: {:?}", at.x);
            assert!(evaluations < 6 * iterations.max(10), "{config:?}: {evaluations}/{iterations}");
        }
    }
}

#[test]
fn quasi_newton_methods_minimize_an_ill_conditioned_quadratic() {
    for (config, most) in [
        (lbfgs(LineSearch::HagerZhang), 400),
        (lbfgs(LineSearch::WeakWolfe), 400),
        (broyden(), 250),
    ] {
        let (at, outcome, iterations, _) = minimize(&config, quadratic, vec![0.0; 50], most);
        assert_eq!(outcome, Outcome::Converged, "{config:?} after {iterations}");
        for (i, x) in at.x.iter().enumerate() {
            // |x - x*| <= |g| / smallest eigenvalue.
            assert!((x - (i as f64 + 1.0)).abs() <= 1e-10, "{config:?}, {i}: {x}");
        }
    }
}

#[test]
fn the_cheap_line_search_needs_fewer_evaluations_per_iteration() {
    let count = |line_search| {
        let (_, _, iterations, evaluations) =
            minimize(&lbfgs(line_search), rosenbrock, vec![0.3; 20], 500);
        evaluations as f64 / iterations as f64
    };
    assert!(count(LineSearch::WeakWolfe) < 1.6, "{}", count(LineSearch::WeakWolfe));
    assert!(count(LineSearch::HagerZhang) < 3.5, "{}", count(LineSearch::HagerZhang));
}

#[test]
fn adam_takes_the_steps_of_its_definition() {
    let config = OptimizerConfig::Adam(AdamConfig { epsilon: 0.0, ..AdamConfig::new(0.1) });
    // With one variable and f = x^2/2 from 1: g1 = 1, so the first step is the learning rate. Then
    // g2 = 0.9, m = 0.19, v = 0.001809, and the step 0.1 (m/0.19) / sqrt(v/0.001999).
    let half_square = |x: &[f64], g: &mut [f64]| {
        g[0] = x[0];
        0.5 * x[0] * x[0]
    };
    let second =
        0.9 - 0.1 * ((0.09 + 0.09) / 0.19) / ((0.000_999 + 0.000_81_f64) / 0.001_999).sqrt();
    for (steps, expected) in [(1, 0.9), (2, second)] {
        let (at, ..) = minimize(&config, half_square, vec![1.0], steps);
        assert!((at.x[0] - expected).abs() < 1e-14, "{} {expected}", at.x[0]);
    }
    // With epsilon = 1/4 the first step is 0.1 / (1 + 1/4).
    let config = OptimizerConfig::Adam(AdamConfig { epsilon: 0.25, ..AdamConfig::new(0.1) });
    let (at, ..) = minimize(&config, half_square, vec![1.0], 1);
    assert!((at.x[0] - 0.92).abs() < 1e-14, "{}", at.x[0]);
}

#[test]
fn settings_left_out_of_a_file_are_the_defaults() {
    let read = |text: &str| serde_json::from_str::<OptimizerConfig>(text).unwrap();
    let (beta1, beta2, epsilon) = (0.9, 0.999, 1e-7);
    let adam = AdamConfig { learning_rate: 0.5, beta1, beta2, epsilon };
    assert_eq!(read(r#"{"adam": {"learning_rate": 0.5}}"#), adam.into());
    let (line_search, gradient_tolerance) = (LineSearch::HagerZhang, 1e-14);
    let lbfgs = LbfgsConfig { memory: 10, line_search, gradient_tolerance };
    assert_eq!(read(r#"{"lbfgs": {}}"#), lbfgs.into());
    let broyden = SelfScaledBroydenConfig { initial_step: 0.1, gradient_tolerance };
    assert_eq!(read(r#"{"self-scaled-broyden": {}}"#), broyden.into());
    let marquardt = LevenbergMarquardtConfig { initial_damping: 1e-3, gradient_tolerance };
    assert_eq!(read(r#"{"levenberg-marquardt": {}}"#), marquardt.into());
    let misspelt = r#"{"lbfgs": {"memry": 3}}"#;
    assert!(serde_json::from_str::<OptimizerConfig>(misspelt).is_err());
}

#[test]
fn an_iterate_is_finite_if_value_and_gradient_are() {
    let finite = |value, g| Iterate { x: vec![0.0], value, gradient: vec![g] }.is_finite();
    assert!(finite(1.0, 2.0));
    assert!(!finite(f64::NAN, 2.0) && !finite(1.0, f64::NAN) && !finite(f64::INFINITY, f64::NAN));
}

#[test]
fn line_searches_step_back_from_where_the_function_is_not_finite() {
    // -log x + x, NaN for x <= 0: minimum at 1. The first steps from 20 overshoot.
    let barrier = |x: &[f64], g: &mut [f64]| {
        g[0] = 1.0 - 1.0 / x[0];
        if x[0] > 0.0 { x[0] - x[0].ln() } else { f64::NAN }
    };
    for config in [lbfgs(LineSearch::HagerZhang), lbfgs(LineSearch::WeakWolfe), broyden()] {
        for start in [20.0, 1e-3] {
            let (at, outcome, ..) = minimize(&config, barrier, vec![start], 100);
            assert_ne!(outcome, Outcome::Moved, "{config:?}");
            assert!((at.x[0] - 1.0).abs() < 1e-7, "{config:?} from {start}: {}", at.x[0]);
        }
    }
}

#[test]
fn a_function_without_descent_is_reported_not_looped_on() {
    // The gradient lies: the function rises along its negative.
    let lie = |x: &[f64], g: &mut [f64]| {
        g[0] = -1.0;
        x[0]
    };
    for config in [lbfgs(LineSearch::HagerZhang), lbfgs(LineSearch::WeakWolfe), broyden()] {
        let (at, outcome, ..) = minimize(&config, lie, vec![0.0], 10);
        assert_eq!(outcome, Outcome::Stuck, "{config:?}");
        assert_eq!(at.x, [0.0]);
    }
}

/// Where the objective changes under way (a sample grows), the next direction is -H g with the new
/// gradient g and the inverse Hessian H learnt so far.
#[test]
fn after_a_refresh_the_direction_is_of_the_new_gradient_and_the_old_curvature() {
    let workers = Workers::new(1).unwrap();
    let n = 20;
    let mut optimizer = Optimizer::new(&broyden(), n);
    let mut objective = Counting { f: quadratic, evaluations: 0 };
    let mut at = Iterate::new(&mut objective, vec![0.0; n]);
    // More iterations than updates are held back.
    for _ in 0..30 {
        assert_eq!(optimizer.step(&mut objective, &mut at, &workers), Outcome::Moved);
    }
    // The first point that the next step tries, less the present one.
    let direction = |gradient: &[f64]| -> Vec<f64> {
        let mut optimizer = optimizer.clone();
        let mut at = Iterate { gradient: gradient.to_vec(), ..at.clone() };
        optimizer.refresh(&at, &workers);
        let (from, mut first) = (at.x.clone(), None);
        let record = |x: &[f64], gradient: &mut [f64]| {
            first.get_or_insert_with(|| x.to_vec());
            quadratic(x, gradient)
        };
        optimizer.step(&mut Counting { f: record, evaluations: 0 }, &mut at, &workers);
        first.unwrap().iter().zip(from).map(|(to, from)| to - from).collect()
    };
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let a: Vec<f64> = (0..n).map(|i| (i as f64 + 1.0).sin()).collect();
    let b: Vec<f64> = (0..n).map(|i| (0.7 * i as f64).cos()).collect();
    let sum: Vec<f64> = a.iter().zip(&b).map(|(a, b)| a + 2.0 * b).collect();
    let (of_a, of_b, of_sum) = (direction(&a), direction(&b), direction(&sum));
    // H is positive definite, symmetric and linear; points of size 20 carry the rounding.
    assert!(dot(&of_a, &a) < 0.0 && dot(&of_b, &b) < 0.0);
    assert!(
        (dot(&of_a, &b) - dot(&of_b, &a)).abs() < 1e-12,
        "{} {}",
        dot(&of_a, &b),
        dot(&of_b, &a)
    );
    for i in 0..n {
        assert!((of_sum[i] - of_a[i] - 2.0 * of_b[i]).abs() < 1e-13, "{i}");
    }
    // And it has learnt: the eigenvalues 1 to 100 have other inverses than at its start, where all
    // are alike.
    let along = |i: usize| -direction(&std::array::from_fn::<f64, 20, _>(|j| f64::from(j == i)))[i];
    assert!(along(0) > 10.0 * along(n - 1), "{} {}", along(0), along(n - 1));
}

#[test]
fn broyden_is_the_same_on_any_number_of_threads() {
    let run = |threads| {
        let workers = Workers::new(threads).unwrap();
        let mut objective = Counting { f: rosenbrock, evaluations: 0 };
        let mut optimizer = Optimizer::new(&broyden(), 33);
        let mut at = Iterate::new(&mut objective, vec![0.1; 33]);
        for _ in 0..60 {
            optimizer.step(&mut objective, &mut at, &workers);
        }
        at
    };
    assert_eq!(run(1), run(2));
    assert_eq!(run(1), run(3));
}

/// Each setting just inside and just outside its range.
#[test]
fn settings_that_make_no_sense_are_named() {
    let (nan, infinite) = (f64::NAN, f64::INFINITY);
    let adam = AdamConfig::new(1e-3);
    let (broyden, lbfgs) = (SelfScaledBroydenConfig::default(), LbfgsConfig::default());
    let marquardt = LevenbergMarquardtConfig::default();
    let check = |key: &str, good: &[f64], bad: &[f64], set: &dyn Fn(f64) -> OptimizerConfig| {
        for &value in good {
            assert!(set(value).validate().is_ok(), "{key} {value}");
        }
        for &value in bad {
            let message = set(value).validate().expect_err(key).to_string();
            assert!(message.starts_with(&format!("{key}: {value} given")), "{message}");
        }
    };
    let positive: (&[f64], &[f64]) = (&[1e-300, 1e300], &[0.0, -1.0, nan, infinite]);
    let fraction: (&[f64], &[f64]) = (&[0.0, 0.5, 0.999], &[1.0, -0.1, 2.0, nan]);
    let not_negative: (&[f64], &[f64]) = (&[0.0, 1.0], &[-1e-300, nan]);
    check("learning_rate", positive.0, positive.1, &|v| AdamConfig::new(v).into());
    check("beta1", fraction.0, fraction.1, &|beta1| AdamConfig { beta1, ..adam.clone() }.into());
    check("beta2", fraction.0, fraction.1, &|beta2| AdamConfig { beta2, ..adam.clone() }.into());
    check("epsilon", positive.0, positive.1, &|v| AdamConfig { epsilon: v, ..adam.clone() }.into());
    check("initial_step", positive.0, positive.1, &|initial_step| {
        SelfScaledBroydenConfig { initial_step, ..broyden.clone() }.into()
    });
    check("initial_damping", positive.0, positive.1, &|initial_damping| {
        LevenbergMarquardtConfig { initial_damping, ..marquardt.clone() }.into()
    });
    let (good, bad) = not_negative;
    check("gradient_tolerance", good, bad, &|gradient_tolerance| {
        SelfScaledBroydenConfig { gradient_tolerance, ..broyden.clone() }.into()
    });
    check("gradient_tolerance", good, bad, &|gradient_tolerance| {
        LevenbergMarquardtConfig { gradient_tolerance, ..marquardt.clone() }.into()
    });
    check("gradient_tolerance", good, bad, &|gradient_tolerance| {
        LbfgsConfig { gradient_tolerance, ..lbfgs.clone() }.into()
    });
    let memory = |memory| OptimizerConfig::from(LbfgsConfig { memory, ..lbfgs.clone() });
    assert!(memory(1).validate().is_ok() && memory(0).validate().is_err());
    // A choice by size needs valid settings of both.
    for gradient_tolerance in [1e-14, nan] {
        let (full_memory, limited_memory) = (
            SelfScaledBroydenConfig { gradient_tolerance, ..broyden.clone() },
            LbfgsConfig { gradient_tolerance, ..lbfgs.clone() },
        );
        let valid = !gradient_tolerance.is_nan();
        let auto = AutoConfig { full_memory, ..AutoConfig::default() };
        assert_eq!(OptimizerConfig::from(auto).validate().is_ok(), valid);
        let auto = AutoConfig { limited_memory, ..AutoConfig::default() };
        assert_eq!(OptimizerConfig::from(auto).validate().is_ok(), valid);
    }
}

#[test]
fn the_choice_by_size_is_made_at_its_limit() {
    let auto = AutoConfig { max_full_memory_weights: 100, ..AutoConfig::default() };
    let config = OptimizerConfig::from(auto.clone());
    assert_eq!(config.for_size(100), auto.full_memory.into());
    assert_eq!(config.for_size(101), auto.limited_memory.into());
    assert_eq!(Optimizer::new(&config, 100), Optimizer::new(&config.for_size(100), 100));
    assert_eq!(Optimizer::new(&config, 101), Optimizer::new(&config.for_size(101), 101));
    let chosen = lbfgs(LineSearch::WeakWolfe);
    assert_eq!(chosen.for_size(1), chosen);
}
