//! Recorded data: the answers agree with another program.

use crate::support::{Case, batch, distance, oscillator, tanks};
use pinc_estimate::{Ekf, Mhe, Tuning, Ukf};

fn ekf(case: &Case) -> Ekf {
    Ekf::new(case.model(), case.tuning.clone()).unwrap()
}

fn ukf(case: &Case) -> Ukf {
    Ukf::new(case.model(), case.tuning.clone()).unwrap()
}

#[track_caller]
fn close(found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() <= tolerance, "{found} is not {expected}");
    }
}

#[test]
fn the_filter_of_the_tanks() {
    let case = tanks();
    let found = case.run(&mut ekf(&case));
    let distance = distance(&found, "answer-tanks-ekf.csv", case.states, true);
    assert!(distance < 1e-8, "{distance:e}");
    close(&case.rmse(&found), &[0.032491, 0.030284, 0.044947, 0.047001], 6e-7);
}

#[test]
fn the_filter_of_the_oscillator() {
    let case = oscillator();
    let found = case.run(&mut ekf(&case));
    let distance = distance(&found, "answer-vdp-ekf.csv", case.states, true);
    assert!(distance < 1e-8, "{distance:e}");
    close(&case.rmse(&found), &[0.054382, 0.069948], 6e-7);
}

/// The filter finds a steady state with a negative pressure and stays there, as is known of it.
#[test]
fn the_filter_of_the_batch_reactor_is_wrong() {
    let case = batch();
    let found = case.run(&mut ekf(&case));
    let distance = distance(&found, "answer-batch-ekf.csv", case.states, false);
    assert!(distance < 1e-8, "{distance:e}");
    close(&case.rmse(&found), &[2.61, 2.38], 6e-3);
}

#[test]
fn the_unscented_filter_of_the_tanks() {
    let case = tanks();
    let found = case.run(&mut ukf(&case));
    let distance = distance(&found, "answer-tanks-ukf.csv", case.states, true);
    assert!(distance < 1e-8, "{distance:e}");
}

#[test]
fn the_unscented_filter_of_the_oscillator() {
    let case = oscillator();
    let found = case.run(&mut ukf(&case));
    let distance = distance(&found, "answer-vdp-ukf.csv", case.states, true);
    assert!(distance < 1e-8, "{distance:e}");
}

fn mhe(case: &Case, tuning: Tuning) -> Mhe {
    Mhe::new(case.model(), tuning, 10).unwrap()
}

#[test]
fn moving_horizon_estimates_of_the_tanks() {
    let case = tanks();
    let found = case.run(&mut mhe(&case, case.tuning.clone()));
    close(&case.rmse(&found), &[0.032491, 0.030280, 0.044947, 0.046999], 6e-7);
}

#[test]
fn moving_horizon_estimates_of_the_oscillator() {
    let case = oscillator();
    let found = case.run(&mut mhe(&case, case.tuning.clone()));
    close(&case.rmse(&found), &[0.054067, 0.069224], 6e-7);
}

/// Pressures are not negative: with that the estimator finds the right ones.
#[test]
fn moving_horizon_estimates_of_the_batch_reactor() {
    let case = batch();
    let bounded = Tuning { low: vec![0.0; 2], ..case.tuning.clone() };
    let found = case.run(&mut mhe(&case, bounded));
    let distance = distance(&found, "answer-batch-mhe10-bounds.csv", case.states, false);
    assert!(distance < 1e-5, "{distance:e}");
    close(&case.rmse(&found), &[0.0039, 0.0137], 6e-5);
    let found = case.run(&mut mhe(&case, case.tuning.clone()));
    close(&case.rmse(&found), &[2.38, 2.12], 6e-3);
}
