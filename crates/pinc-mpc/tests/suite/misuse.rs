//! Parts that do not fit together are errors that name the field.

use crate::problems::{four_tanks, van_der_pol};
use crate::support::{Linear, scalar_problem};
use pinc_mpc::{
    Bounds, MpcError, Nmpc, NmpcProblem, PerStage, Softness, SqpConfig, SqpStatus, Tracked, Weight,
    Weights,
};
use pinc_ode::{ArgumentError, Rk4};
use pinc_plants::VanDerPol;

fn refusal(change: impl FnOnce(&mut NmpcProblem)) -> String {
    let mut problem = van_der_pol();
    change(&mut problem);
    let model = Rk4::new(VanDerPol::default(), 0.5, 4);
    let refused = Nmpc::new(problem, Box::new(model), SqpConfig::default());
    refused.unwrap_err().to_string()
}

#[test]
fn horizons() {
    assert_eq!(
        refusal(|p| p.control_horizon = 6),
        "control_horizon (Nu) is 6, but must be from 1 to 5"
    );
    assert_eq!(
        refusal(|p| p.control_horizon = 0),
        "control_horizon (Nu) is 0, but must be from 1 to 5"
    );
    assert_eq!(refusal(|p| p.n1 = 0), "n1 is 0, but must be from 1 to 5");
    assert_eq!(refusal(|p| p.n1 = 6), "n1 is 6, but must be from 1 to 5");
    assert_eq!(refusal(|p| p.horizon = 0), "horizon (N2) is 0, but must be from 1 to 10000");
    assert!(refusal(|p| p.horizon = usize::MAX).ends_with("must be from 1 to 10000"));
}

#[test]
fn tracked_states() {
    assert_eq!(
        refusal(|p| p.tracked = Tracked::states([0, 2])),
        "tracked is 2, but must be from 0 to 1"
    );
    assert_eq!(refusal(|p| p.tracked = Tracked::states([1, 1])), "tracked names state 1 twice");
    assert_eq!(
        refusal(|p| p.tracked = Tracked::states([])),
        "weights.q: 2 numbers, but 0 are expected"
    );
}

#[test]
fn weights() {
    assert_eq!(
        refusal(|p| p.weights.q = vec![1.0].into()),
        "weights.q: 1 numbers, but 2 are expected"
    );
    assert_eq!(
        refusal(|p| p.weights.r = vec![-1.0].into()),
        "weights.r[0] is -1, but must be finite and not negative"
    );
    assert_eq!(
        refusal(|p| p.weights.q = vec![1.0, f64::NAN].into()),
        "weights.q[1] is NaN, but must be finite and not negative"
    );
    assert!(
        refusal(|p| p.weights.q = vec![f64::INFINITY, 1.0].into())
            .starts_with("weights.q[0] is inf")
    );
    assert_eq!(
        refusal(|p| p.weights = Weights::scaled(vec![1.0; 2], vec![1.0], &[1.0; 4], &[1.0; 5])),
        "weights.q is given for 4 stages, but there are 5"
    );
    assert_eq!(
        refusal(|p| p.weights.input_sequence = Some(vec![1.0; 5].into())),
        "weights.input_sequence: 5 numbers, but 6 are expected"
    );
}

#[test]
fn bounds() {
    assert_eq!(
        refusal(|p| p.state_bounds.low[1] = 2.0),
        "the bounds of state_bounds[1] are crossed: low 2 > high 1"
    );
    assert_eq!(
        refusal(|p| p.input_bounds = Bounds::none(2)),
        "input_bounds: 2 numbers, but 1 are expected"
    );
    assert_eq!(
        refusal(|p| p.input_bounds.high = vec![f64::NAN]),
        "input_bounds[0] is NaN, but must be finite or inf"
    );
    assert_eq!(
        refusal(|p| p.state_bounds.low[0] = f64::INFINITY),
        "state_bounds[0] is inf, but must be finite or -inf"
    );
    assert!(refusal(|p| p.state_bounds.high[0] = f64::NEG_INFINITY).contains("-inf"));
    assert_eq!(
        refusal(|p| p.state_bounds =
            Bounds::new(vec![f64::NEG_INFINITY; 2], vec![f64::NEG_INFINITY; 2])),
        "state_bounds[0] is -inf, but must be finite or inf"
    );
    // A variable that may not move is no mistake.
    let mut fixed = scalar_problem(2, 2);
    fixed.input_bounds = Bounds::new(vec![0.5], vec![0.5]);
    let model = Box::new(Linear::scalar(1.0, 1.0));
    let mut nmpc = Nmpc::new(fixed, model, SqpConfig::default()).unwrap();
    assert!((nmpc.step(&[1.0], &[0.0; 2]).unwrap().u[0] - 0.5).abs() < 1e-12);
}

#[test]
fn sizes_of_states() {
    assert_eq!(
        refusal(|p| p.state_sizes = Some(vec![1.0, -1.0])),
        "state_sizes[1] is -1, but must be not negative"
    );
    assert_eq!(
        refusal(|p| p.state_sizes = Some(vec![1.0])),
        "state_sizes: 1 numbers, but 2 are expected"
    );
}

#[test]
fn penalties() {
    for (weight, text) in [(0.0, "0"), (-1.0, "-1"), (f64::INFINITY, "inf"), (f64::NAN, "NaN")] {
        assert_eq!(
            refusal(|p| p.state_softness = Softness::Penalty(vec![1.0, weight])),
            format!("state_softness[1] is {text}, but must be positive and finite")
        );
    }
    assert_eq!(
        refusal(|p| p.state_softness = Softness::Penalty(vec![1.0])),
        "state_softness: 1 numbers, but 2 are expected"
    );
}

#[test]
fn a_problem_for_another_plant() {
    let model = Rk4::new(VanDerPol::default(), 0.5, 4);
    let refused = Nmpc::new(four_tanks(), Box::new(model), SqpConfig::default());
    assert!(matches!(
        refused.unwrap_err(),
        MpcError::Argument(ArgumentError::Length { field: "weights.r", expected: 1, found: 2 })
    ));
}

#[test]
fn settings() {
    for (tolerance, max_iterations) in [(0.0, 50), (f64::NAN, 50), (f64::INFINITY, 50), (1e-8, 0)] {
        let config = SqpConfig { tolerance, max_iterations, ..SqpConfig::default() };
        let model = Box::new(Linear::scalar(1.0, 1.0));
        assert!(Nmpc::new(scalar_problem(1, 1), model, config).is_err());
    }
}

#[test]
fn arguments_of_a_step() {
    let model = Box::new(Linear::scalar(1.0, 1.0));
    let mut nmpc = Nmpc::new(scalar_problem(2, 2), model, SqpConfig::default()).unwrap();
    let mut refusal = |x: &[f64], reference: &[f64]| {
        let refused = nmpc.step(x, reference);
        refused.unwrap_err().to_string()
    };
    assert_eq!(refusal(&[1.0, 2.0], &[0.0; 2]), "x: 2 numbers, but 1 are expected");
    assert_eq!(refusal(&[1.0], &[0.0]), "reference: 1 numbers, but 2 are expected");
    assert_eq!(refusal(&[1.0], &[0.0, f64::INFINITY]), "reference[1] is inf, but must be finite");
    assert!(nmpc.step(&[1.0], &[0.0; 2]).is_ok());
}

#[test]
fn tables_of_a_configuration_file() {
    let config: SqpConfig = toml::from_str("tolerance = 1e-6").unwrap();
    assert_eq!(config, SqpConfig { tolerance: 1e-6, ..SqpConfig::default() });
    let error = toml::from_str::<SqpConfig>("tolerence = 1e-6").unwrap_err();
    assert!(error.to_string().contains("tolerence"), "{error}");

    let weights: Weights =
        toml::from_str("q = [[1.0, 0.5], [0.5, 1.0]]\nr = { stages = [[2.0], [1.0]] }").unwrap();
    let q = Weight::Full(vec![vec![1.0, 0.5], vec![0.5, 1.0]]);
    let stages = vec![vec![2.0].into(), vec![1.0].into()];
    assert_eq!(weights, Weights::new(q.into(), PerStage::Each { stages }));
    let bounds: Bounds = toml::from_str("low = [-inf]\nhigh = [2.5]").unwrap();
    assert!(bounds.low[0].is_infinite());
    // What is written to a file is what is shown.
    for status in [
        SqpStatus::Converged,
        SqpStatus::IterationLimit,
        SqpStatus::Deadline,
        SqpStatus::Prepared,
        SqpStatus::InfeasibleQp,
        SqpStatus::Stalled,
        SqpStatus::NumericalTrouble,
        SqpStatus::BadArgument,
    ] {
        let written = toml::Value::try_from(status).unwrap();
        assert_eq!(written.as_str().unwrap(), status.to_string());
    }
}
