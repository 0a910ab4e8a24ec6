//! The error of prediction.

use crate::support::{noise, oscillator, plant, problem, steps};
use pinc_identify::{
    Criterion, Diagnosis, Estimate, FitStatus, Identified, IdentifyError, InitialState, Method,
    Problem, Recording, Starts, fitted_steps, identify, identify_from_starts, simulate_held_out,
};
use pinc_ode::Integrator;

/// The truth of the oscillator.
const TRUTH: [f64; 2] = [0.8, 1.3];
const START: [f64; 2] = [0.5, 1.0];

/// The position of the oscillator, measured to 0.02, with its states shaken by `shaken` at each
/// step.
fn shaken(seed: u64, rows: usize, shaken: f64) -> (Vec<f64>, Vec<f64>) {
    let mut model = oscillator().model(Integrator::Rk4, 0.1, 2).unwrap();
    let u = steps(seed, rows, 15, (-1.0, 1.0));
    let (w, e) = (noise(seed + 100, shaken, 2 * rows), noise(seed + 200, 0.02, rows));
    let (mut x, mut next, mut y) = (vec![1.0, 0.0], vec![0.0; 2], Vec::new());
    for k in 0..rows {
        y.push(x[0] + e[k]);
        model.step(&x, &u[k..=k], &TRUTH, &mut next);
        x.copy_from_slice(&next);
        x.iter_mut().zip(&w[2 * k..]).for_each(|(x, w)| *x += w);
    }
    (u, y)
}

fn fitted(criterion: Criterion, [mu, k]: [f64; 2], (u, y): &(Vec<f64>, Vec<f64>)) -> Identified {
    let plant = oscillator();
    let start = [(mu, 0.0, 5.0), (k, 0.1, 20.0)];
    let free = InitialState::Free(vec![1.0, 0.0]);
    let problem = Problem { criterion, ..problem(&*plant, &[0], Some(0.02), &start, free) };
    let mut model = plant.model(Integrator::Rk4, 0.1, 2).unwrap();
    identify(&mut *model, &problem, &[Recording { name: "shaken", before: None, u, y }]).unwrap()
}

/// A simulation blames the parameters for what shakes the plant, and says that it is sure of them.
#[test]
fn parameters_of_a_disturbed_plant_are_within_their_intervals() {
    let errors = |criterion: Criterion| -> Vec<f64> {
        let found = (0..6).map(|seed| fitted(criterion, START, &shaken(seed, 500, 0.05)));
        let estimates = found.flat_map(|found| found.parameters.into_iter().zip(TRUTH));
        let error =
            |(of, truth): (Estimate, f64)| (of.value - truth).abs() / of.half_width.unwrap();
        estimates.map(error).collect()
    };
    let [simulated, predicted] = [Criterion::Simulation, Criterion::PredictionError].map(errors);
    let mean = |of: &[f64]| of.iter().sum::<f64>() / 12.0;
    // 0.37 half widths on average; one in twenty lies beyond it.
    assert!(mean(&predicted) < 0.6, "{predicted:?}");
    assert!(predicted.iter().filter(|error| **error > 1.0).count() <= 1, "{predicted:?}");
    assert!(mean(&simulated) > 2.0, "{simulated:?}");
}

/// The state is corrected before it runs away from the data, so that the start matters less.
#[test]
fn predictions_find_the_same_parameters_from_other_starts() {
    let differing = |criterion: Criterion| {
        let differ = |seed: &u64| {
            let data = shaken(*seed, 500, 0.05);
            let [a, b] = [START, [2.0, 2.0]].map(|start| fitted(criterion, start, &data).cost);
            (a - b).abs() > 1e-6 * a
        };
        (0..4).filter(differ).count()
    };
    assert_eq!(differing(Criterion::PredictionError), 0);
    assert!(differing(Criterion::Simulation) > 1);
}

/// Predictions forget a disturbance as fast as the state is corrected, and their errors are white.
#[test]
fn errors_of_prediction_are_white_and_have_no_finding() {
    let data = shaken(2, 500, 0.05);
    let found = fitted(Criterion::PredictionError, START, &data);
    assert_eq!(found.status, FitStatus::Converged);
    assert_eq!(found.findings, []);
    let names: Vec<&str> = found.estimates().map(|of| of.name.as_str()).collect();
    assert_eq!(names, ["mu", "k", "K[x1, x1]", "K[x2, x1]", "x1(0)", "x2(0)"]);
    assert_eq!(found.p.len(), 2);
    // The disturbance is larger than the noise, so that a measurement is nearly believed.
    assert!((0.7..1.0).contains(&found.gains[0].value), "{:?}", found.gains);
    assert!(found.channels[0].correlation.abs() < 0.15, "{:?}", found.channels);
    let simulated = fitted(Criterion::Simulation, START, &data);
    assert!(simulated.gains.is_empty());
    assert!(simulated.channels[0].rms > 3.0 * found.channels[0].rms, "{simulated:?}");
}

/// Starts are spread over the parameters, whose bounds K has not; data that are held out are
/// simulated, without K.
#[test]
fn predictions_have_starts_and_are_validated_by_simulation() {
    let plant = oscillator();
    let (u, y) = shaken(1, 200, 0.02);
    let start = [(0.5, 0.0, 5.0), (1.0, 0.1, 20.0)];
    let free = InitialState::Free(vec![1.0, 0.0]);
    let criterion = Criterion::PredictionError;
    let problem = Problem { criterion, ..problem(&*plant, &[0], Some(0.02), &start, free) };
    let model = || plant.model(Integrator::Rk4, 0.1, 2).unwrap();
    let recording = Recording { name: "shaken", before: None, u: &u, y: &y };
    let starts = Starts { finished: 1, ..Starts::default() };
    let models = (0..4).map(|_| model()).collect();
    let found = identify_from_starts(models, &problem, &[recording], starts).unwrap();
    assert_eq!((found.starts.len(), found.gains.len()), (4, 2));
    let held_out = simulate_held_out(&mut *model(), &problem, &found.p, recording, 20).unwrap();
    let criterion = Criterion::Chosen;
    let known = Problem { criterion, ..problem };
    let simulated = simulate_held_out(&mut *model(), &known, &found.p, recording, 20).unwrap();
    assert_eq!(held_out, simulated);
    assert_ne!(held_out, found.fitted[0]);
    // The state at the beginning follows from the first rows alone.
    let mut later = y.clone();
    later[20..].iter_mut().for_each(|y| *y += 1.0);
    let later = Recording { y: &later, ..recording };
    let unseen = simulate_held_out(&mut *model(), &known, &found.p, later, 20).unwrap();
    assert_eq!(unseen, simulated);
    // So it does where only every third step has a measurement, from twenty of these.
    let sparse = |y: &[f64]| -> Vec<f64> {
        y.iter().zip(0..).map(|(y, k)| if k % 3 == 0 { *y } else { f64::NAN }).collect()
    };
    let third = sparse(&y);
    let fitted = Recording { u: &u[..58], y: &third[..58], ..recording };
    let state = Problem { parameters: found.p.clone(), unknown: Vec::new(), ..known.clone() };
    let state = identify(&mut *model(), &state, &[fitted]).unwrap().initial_states;
    let state = state[0].iter().map(|of| of.value).collect();
    let known_state = Problem { initial_state: InitialState::Fixed(state), ..known.clone() };
    let recording = Recording { y: &third, ..recording };
    let expected = simulate_held_out(&mut *model(), &known_state, &found.p, recording, 0).unwrap();
    assert_eq!(fitted_steps(&known, recording, 20).unwrap(), 58);
    let held_out = simulate_held_out(&mut *model(), &known, &found.p, recording, 20).unwrap();
    assert_eq!(held_out, expected);
    // Too few to tell the state, or no more behind them.
    let error = |rows| fitted_steps(&known, recording, rows).unwrap_err();
    assert_eq!(error(2), IdentifyError::TooFewMeasurements { measurements: 2, unknowns: 2 });
    let third: Vec<f64> = third[..199].iter().copied().chain([0.0]).collect();
    let recording = Recording { y: &third, ..recording };
    assert!(fitted_steps(&known, recording, 67).is_ok());
    let error = fitted_steps(&known, recording, 68).unwrap_err();
    assert_eq!(error, IdentifyError::NothingHeldOut { rows: 68 });
}

/// A lag under steps with noise alone, of which short records have an optimum where the predictor is
/// unstable, and fits the noise by the initial state: its growth is the pole to the power of the
/// steps.
#[test]
fn a_predictor_that_does_not_forget_the_initial_state_is_named() {
    let plant = plant(&[("x", "b*u - a*x")], &["u"], &[("a", 1.5), ("b", 1.0)], &["a", "b"]);
    let fitted = |seed: u64, shaken: f64| {
        let mut model = plant.model(Integrator::Rk4, 0.1, 2).unwrap();
        let (u, w) = (steps(seed, 60, 10, (-1.0, 1.0)), noise(seed + 100, shaken, 60));
        let (mut x, mut next, mut y) = ([1.0], [0.0], Vec::new());
        for (k, e) in noise(seed + 200, 0.01, 60).into_iter().enumerate() {
            y.push(x[0] + e);
            model.step(&x, &u[k..=k], &[1.5, 1.0], &mut next);
            x[0] = next[0] + w[k];
        }
        let start = [(1.0, 0.1, 5.0), (0.8, 0.1, 5.0)];
        let free = InitialState::Free(vec![1.0]);
        let criterion = Criterion::PredictionError;
        let problem = Problem { criterion, ..problem(&*plant, &[0], Some(0.01), &start, free) };
        identify(&mut *model, &problem, &[Recording { name: "lag", before: None, u: &u, y: &y }])
            .unwrap()
    };
    let mut unstable = 0;
    for seed in 0..20 {
        let found = fitted(seed, 0.0);
        let pole = (-0.1 * found.parameters[0].value).exp() * (1.0 - found.gains[0].value);
        let growth = pole.abs().powi(59);
        let said = found.findings.iter().find_map(|finding| match finding {
            Diagnosis::UnstablePredictor { growth } => Some(*growth),
            _ => None,
        });
        assert_eq!(said.is_some(), growth > 10.0, "{growth} {said:?}");
        let Some(said) = said else { continue };
        // RK4 has the pole to 1e-7.
        assert!((said / growth - 1.0).abs() < 1e-3, "{growth} {said}");
        unstable += 1;
        let not_converged = |of: &Diagnosis| matches!(of, Diagnosis::NotConverged { .. });
        assert!(!found.findings.iter().any(not_converged), "{:?}", found.findings);
        if let Method::SingleShooting { growth } = found.method {
            assert!(growth >= said, "{growth} {said}");
        }
    }
    assert!((3..=15).contains(&unstable), "{unstable}");
    for seed in 0..10 {
        assert_eq!(fitted(seed, 0.03).findings, []);
    }
}
