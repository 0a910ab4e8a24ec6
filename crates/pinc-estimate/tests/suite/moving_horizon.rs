//! Moving horizon estimation: what it must be equal to, and how its steps end.

use crate::filters::{linear, tuning};
use crate::support::{Case, batch, oscillator, tanks};
use pinc_estimate::{Ekf, EstimateError, Estimator, EstimatorStatus, Mhe, Tuning};
use proptest::prelude::*;

fn mhe(case: &Case, window: usize) -> Mhe {
    Mhe::new(case.model(), case.tuning.clone(), window).unwrap()
}

proptest! {
    /// Without bounds and on a linear model the arrival cost says all of the past.
    #[test]
    fn on_a_linear_model_it_is_the_kalman_filter(
        model in linear(),
        window in 1..12_usize,
        data in prop::collection::vec(
            (prop::array::uniform2(-3.0..3.0_f64), -1.0..1.0_f64, 0..10_u8),
            1..30,
        ),
    ) {
        let mut kalman = Ekf::new(Box::new(model.clone()), tuning()).unwrap();
        let mut horizon = Mhe::new(Box::new(model), tuning(), window).unwrap();
        for (y, u, silent) in data {
            let y = if silent == 0 { [f64::NAN, y[1]] } else { y };
            let (a, b) = (kalman.correct(&y), horizon.correct(&y));
            prop_assert_eq!(b.status, EstimatorStatus::Updated);
            prop_assert!(b.kkt <= 1e-8);
            prop_assert!((a.nis - b.nis).abs() <= 1e-9 * (1.0 + a.nis));
            for (a, b) in kalman.estimate().iter().zip(horizon.estimate()) {
                prop_assert!((a - b).abs() <= 1e-12 * (1.0 + a.abs()), "{} {}", a, b);
            }
            kalman.predict(&[u]);
            horizon.predict(&[u]);
        }
    }
}

#[test]
fn the_window_grows_and_then_moves_on() {
    let case = oscillator();
    let mut estimator = mhe(&case, 5);
    for k in 0..12 {
        estimator.correct(&case.data.at(k, case.measured));
        assert_eq!(estimator.window(), k.min(5));
        let trajectory = estimator.trajectory();
        assert_eq!(trajectory.len(), 2 * (estimator.window() + 1));
        assert_eq!(&trajectory[trajectory.len() - 2..], estimator.estimate());
        estimator.predict(&case.data.at(k, case.inputs));
    }
}

/// A few programs a step: the shifted solution is near the next one.
#[test]
fn the_last_solution_is_a_good_guess() {
    for case in [tanks(), oscillator()] {
        let mut estimator = mhe(&case, 10);
        let mut iterations = 0;
        for k in 0..case.data.len() {
            let correction = estimator.correct(&case.data.at(k, case.measured));
            assert_eq!(correction.status, EstimatorStatus::Updated, "row {k}");
            assert!(correction.kkt <= 1e-8);
            iterations += correction.iterations;
            estimator.predict(&case.data.at(k, case.inputs));
        }
        assert!(iterations <= 6 * case.data.len(), "{iterations}");
    }
}

/// With bounds that the truth does not keep the steps converge slowly, or not in time: what is
/// found is within the bounds all the same, and said to be what it is.
#[test]
fn estimates_are_within_their_bounds() {
    let case = oscillator();
    let tuning = Tuning { low: vec![-1.9, -2.2], high: vec![1.9, 2.2], ..case.tuning.clone() };
    let mut estimator = Mhe::new(case.model(), tuning.clone(), 8).unwrap();
    let (mut at_bounds, mut updated) = (0, 0);
    for k in 0..case.data.len() {
        let correction = estimator.correct(&case.data.at(k, case.measured));
        let is_updated = correction.status == EstimatorStatus::Updated;
        assert_eq!(is_updated, correction.kkt <= 1e-8, "row {k}: {correction:?}");
        updated += usize::from(is_updated);
        for z in estimator.trajectory().chunks(2).filter(|_| is_updated) {
            let inside = z[0].abs() <= 1.9 + 1e-7 && z[1].abs() <= 2.2 + 1e-7;
            assert!(inside, "row {k}: {z:?}");
            at_bounds += usize::from(z[1].abs() > 2.2 - 1e-7);
        }
        assert!(estimator.estimate()[0].abs() <= 1.9 && estimator.estimate()[1].abs() <= 2.2);
        estimator.predict(&case.data.at(k, case.inputs));
    }
    assert!(at_bounds > 20, "{at_bounds}");
    assert!(updated >= case.data.len() * 9 / 10, "{updated}");
}

/// Without time the estimate is the filter's, and more time helps.
#[test]
fn a_deadline_is_met() {
    let case = tanks();
    let mut estimator = mhe(&case, 10);
    for k in 0..40 {
        let y = case.data.at(k, case.measured);
        let late = k % 3 == 0;
        let correction = estimator.correct_within(&y, &mut || late);
        if late && correction.status != EstimatorStatus::Updated {
            assert_eq!((correction.status, correction.iterations), (EstimatorStatus::Deadline, 0));
        } else {
            assert_eq!(correction.status, EstimatorStatus::Updated);
        }
        let truth = case.data.at(k, case.states);
        assert!((estimator.estimate()[0] - truth[0]).abs() < 0.2, "row {k}");
        estimator.predict(&case.data.at(k, case.inputs));
    }
}

#[test]
fn reset_forgets_everything() {
    for case in [tanks(), batch()] {
        let mut estimator = mhe(&case, 4);
        let first = case.run(&mut estimator);
        estimator.reset();
        assert_eq!(estimator.estimate(), &case.tuning.initial_estimate[..]);
        assert_eq!(case.run(&mut estimator), first);
    }
}

#[test]
fn a_window_has_a_length() {
    let case = oscillator();
    for steps in [0, 201] {
        let error = Mhe::new(case.model(), case.tuning.clone(), steps).unwrap_err();
        assert_eq!(error, EstimateError::Window { found: steps, most: 200 });
    }
}
