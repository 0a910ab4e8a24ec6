//! Derivatives of plans against formulas, and points without derivatives.

use crate::support::Linear;
use pinc_mpc::{Bounds, Nmpc, NmpcProblem, Softness, SqpConfig, Weights};
use pinc_ode::Dims;
use pinc_sensitivity::{Given, Regularity, Sensitivity};

/// min q (a x + b u - r)^2 + rho (u - v)^2 has u = (q b (r - a x) + rho v) / (q b^2 + rho).
#[test]
fn a_step_of_a_linear_plant_has_the_derivatives_of_the_formula() {
    let [a, b, q, rho, x, r, v] = [0.9, 0.5, 3.0, 2.0, 0.7, 0.4, -0.2];
    let problem = NmpcProblem::new(Dims::new(1, 1), 1, Weights::uniform(vec![q], vec![rho]));
    let mut nmpc =
        Nmpc::new(problem, Box::new(Linear::scalar(a, b)), SqpConfig::default()).unwrap();
    nmpc.reset_to(&[x], &[v]).unwrap();
    nmpc.step(&[x], &[r]).unwrap();
    let mut sensitivity = Sensitivity::new(&mut nmpc, &[r], &[v], None).unwrap();
    assert_eq!(sensitivity.regularity(), Regularity::Regular);
    let gradient = sensitivity.adjoint(&[], &[1.0]).unwrap();
    let pivot = q * b * b + rho;
    let u = (q * b * (r - a * x) + rho * v) / pivot;
    for (given, expected) in [
        (Given::State, -q * b * a / pivot),
        (Given::Reference, q * b / pivot),
        (Given::AppliedInput, rho / pivot),
        (Given::Q, (b * (r - a * x) - u * b * b) / pivot),
        (Given::R, (v - u) / pivot),
    ] {
        let found = gradient.get(given)[0];
        assert!((found - expected).abs() < 1e-9, "{}: {found} is not {expected}", given.name());
    }
    assert!(gradient.get(Given::Parameters).is_empty());
    // A chain of steps, one of which has no derivative, goes on.
    let unknown = sensitivity.adjoint(&[], &[f64::NAN]).unwrap();
    assert!(unknown.get(Given::State)[0].is_nan() && unknown.get(Given::Q)[0].is_nan());
    assert!(sensitivity.adjoint(&[], &[0.0; 2]).is_err());
}

/// A plant whose state is counted in other units, far from its reference and with the input near its bound:
/// du/dx times the unit, smoothed.
#[test]
fn smoothed_derivatives_do_not_depend_on_units() {
    let derivative = |unit: f64, tau: f64| {
        let problem = NmpcProblem {
            input_bounds: Bounds::new(vec![-1.0], vec![0.3]),
            state_bounds: Bounds::new(vec![-unit], vec![0.9 * unit]),
            ..NmpcProblem::new(Dims::new(1, 1), 6, Weights::uniform(vec![unit.powi(-2)], vec![0.1]))
        };
        let model = Linear::scalar(0.9, 0.5 * unit);
        let mut nmpc = Nmpc::new(problem, Box::new(model), SqpConfig::default()).unwrap();
        let reference = [0.8 * unit; 6];
        nmpc.step(&[0.2 * unit], &reference).unwrap();
        let mut sensitivity = Sensitivity::new(&mut nmpc, &reference, &[0.0], Some(tau)).unwrap();
        assert_eq!(sensitivity.regularity(), Regularity::Regular, "{unit} {tau}");
        sensitivity.adjoint(&[], &[1.0]).unwrap().get(Given::State)[0] * unit
    };
    for tau in [1e-1, 1e-3, 1e-5] {
        let expected = derivative(1.0, tau);
        for unit in [1e-7, 1e-5, 1e5, 1e8] {
            let found = derivative(unit, tau);
            assert!((found - expected).abs() < 1e-8, "{unit} {tau}: {found} {expected}");
        }
    }
}

/// The same with the limit u <= h: there u moves with h alone, and the smoothed input goes from one
/// to the other.
#[test]
fn at_its_bound_an_input_moves_with_the_bound() {
    let high = 0.1;
    let problem = NmpcProblem {
        input_bounds: Bounds::new(vec![-1.0], vec![high]),
        ..NmpcProblem::new(Dims::new(1, 1), 1, Weights::uniform(vec![3.0], vec![2.0]))
    };
    let mut nmpc =
        Nmpc::new(problem, Box::new(Linear::scalar(0.9, 0.5)), SqpConfig::default()).unwrap();
    // u = (1.5 r) / 2.75 without the bound: 0.1 for r = 0.18333..
    let touching = high * 2.75 / 1.5;
    let gradient = |nmpc: &mut Nmpc, r: f64, smoothing| {
        nmpc.reset_to(&[0.0], &[0.0]).unwrap();
        nmpc.step(&[0.0], &[r]).unwrap();
        let mut sensitivity = Sensitivity::new(nmpc, &[r], &[0.0], smoothing).unwrap();
        let gradient = sensitivity.adjoint(&[], &[1.0]).unwrap();
        let by = [Given::InputHigh, Given::Reference].map(|given| gradient.get(given)[0]);
        (sensitivity.regularity(), by)
    };
    let close = |[a, b]: [f64; 2], [c, d]: [f64; 2]| (a - c).abs() + (b - d).abs() < 1e-9;
    let (regularity, by) = gradient(&mut nmpc, 1.0, None);
    assert!(regularity == Regularity::Regular && close(by, [1.0, 0.0]), "{by:?}");
    let (regularity, by) = gradient(&mut nmpc, 0.0, None);
    assert!(regularity == Regularity::Regular && close(by, [0.0, 1.5 / 2.75]), "{by:?}");
    let (regularity, by) = gradient(&mut nmpc, touching, None);
    assert!(matches!(regularity, Regularity::Kink(_)), "{regularity:?}");
    assert!(close(by, [0.0, 1.5 / 2.75]), "{by:?}");
    // With mu = 2 (1.5 r - 2.75 u) and s = h - u, mu s = tau: where both are equal, ds = 5.5 s,
    // the derivative is between the two.
    let tau = 1e-6_f64;
    let (regularity, by) = gradient(&mut nmpc, touching, Some(tau));
    assert_eq!(regularity, Regularity::Regular);
    // There mu = 5.5 s, so that s = sqrt(tau / 5.5), and du (5.5 + mu / s) = 3 dr + mu / s dh. The
    // lower bound, at a distance of 1.1, moves s by 1e-7.
    let stiffness = 5.5;
    let expected = [stiffness / (5.5 + stiffness), 3.0 / (5.5 + stiffness)];
    assert!((by[0] - expected[0]).abs() + (by[1] - expected[1]).abs() < 1e-2, "{by:?}");
}

/// The first state is outside its bounds whatever the input is: a plan that violates them as little as
/// possible is a solution where that was allowed, and has the derivatives of one with a penalty.
#[test]
fn a_violation_that_is_allowed_has_derivatives() {
    let gradient = |softness: Softness| {
        let dims = Dims::new(2, 1);
        let problem = NmpcProblem {
            state_bounds: Bounds::new(vec![f64::NEG_INFINITY; 2], vec![0.3, f64::INFINITY]),
            state_softness: softness,
            ..NmpcProblem::new(dims, 4, Weights::uniform(vec![1.0, 0.1], vec![0.1]))
        };
        let model = Linear { dims, a: vec![1.0, 0.5, 0.0, 1.0], b: vec![0.0, 0.5] };
        let mut nmpc = Nmpc::new(problem, Box::new(model), SqpConfig::default()).unwrap();
        nmpc.step(&[0.5, -0.1], &[0.0; 8]).unwrap();
        let mut of = Sensitivity::new(&mut nmpc, &[0.0; 8], &[0.0], None).unwrap();
        let gradient = of.adjoint(&[], &[0.0, 0.0, 1.0]).unwrap();
        (of.regularity(), gradient.get(Given::State).to_vec())
    };
    let (listed, expected) = gradient(Softness::Penalty(vec![1e4, 1e4]));
    let (exact, found) = gradient(Softness::Exact);
    assert_eq!((listed, exact), (Regularity::Regular, Regularity::Regular));
    for (found, expected) in found.iter().zip(&expected) {
        assert!(expected.abs() > 0.1 && (found - expected).abs() < 1e-9, "{found} {expected}");
    }
    assert_eq!(gradient(Softness::Hard).0, Regularity::NotOptimal);
}

/// x = a x0 + b u is to be .3 at a price w: with q x^2 + r u^2 the input keeps it there, or, where that
/// costs more than w, moves as without it.
#[test]
fn a_state_that_may_miss_its_only_value_has_derivatives() {
    let ([a, b], [q, r]) = ([0.9, 0.5], [1.0, 0.4]);
    for (w, expected) in [(1e3, -a / b), (1e-2, -q * a * b / (q * b * b + r))] {
        let problem = NmpcProblem {
            state_bounds: Bounds::new(vec![0.3], vec![0.3]),
            state_softness: Softness::Penalty(vec![w]),
            ..NmpcProblem::new(Dims::new(1, 1), 1, Weights::uniform(vec![q], vec![r]))
        };
        let config = SqpConfig::default();
        let mut nmpc = Nmpc::new(problem, Box::new(Linear::scalar(a, b)), config).unwrap();
        nmpc.step(&[1.0], &[0.0]).unwrap();
        let mut of = Sensitivity::new(&mut nmpc, &[0.0], &[0.0], None).unwrap();
        assert_eq!(of.regularity(), Regularity::Regular);
        let found = of.adjoint(&[], &[1.0]).unwrap().get(Given::State)[0];
        assert!((found - expected).abs() < 1e-9, "{w}: {found} {expected}");
    }
}

/// A plan that is no solution of what is said, and one that is not determined.
#[test]
fn a_point_without_derivatives_says_so() {
    let problem = NmpcProblem::new(Dims::new(1, 1), 2, Weights::uniform(vec![1.0], vec![0.0]));
    let mut nmpc =
        Nmpc::new(problem, Box::new(Linear::scalar(0.9, 0.5)), SqpConfig::default()).unwrap();
    nmpc.step(&[1.0], &[0.0; 2]).unwrap();
    let other = Sensitivity::new(&mut nmpc, &[0.5; 2], &[0.0], None).unwrap();
    assert_eq!(other.regularity(), Regularity::NotOptimal);
    let error = Sensitivity::new(&mut nmpc, &[0.0; 2], &[0.0], Some(-1.0)).unwrap_err();
    assert_eq!(error.to_string(), "smoothing is -1, but must be positive and finite");
    assert!(Sensitivity::new(&mut nmpc, &[0.0], &[0.0], None).is_err());

    // Two inputs that do the same, without a cost of their own.
    let weights = Weights::uniform(vec![1.0], vec![0.0; 2]);
    let problem = NmpcProblem::new(Dims::new(1, 2), 1, weights);
    let model = Linear { dims: Dims::new(1, 2), a: vec![0.9], b: vec![0.5, 0.5] };
    let Ok(mut nmpc) = Nmpc::new(problem, Box::new(model), SqpConfig::default()) else { return };
    nmpc.step(&[0.0], &[0.0]).unwrap();
    let mut free = Sensitivity::new(&mut nmpc, &[0.0], &[0.0; 2], None).unwrap();
    assert_eq!(free.regularity(), Regularity::Singular);
    assert!(free.adjoint(&[], &[1.0]).unwrap().get(Given::State)[0].is_nan());
}
