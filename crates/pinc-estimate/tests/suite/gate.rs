//! Wild, stuck and jumping readings.

use super::support::{Case, oscillator, tanks};
use pinc_estimate::{Ekf, Estimator, EstimatorStatus, Gate, Mhe, Tuning, Ukf};

fn estimators(case: &Case, tuning: &Tuning) -> [Box<dyn Estimator>; 3] {
    [
        Box::new(Ekf::new(case.model(), tuning.clone()).unwrap()),
        Box::new(Ukf::new(case.model(), tuning.clone()).unwrap()),
        Box::new(Mhe::new(case.model(), tuning.clone(), 10).unwrap()),
    ]
}

/// The measurements of row `k`, changed by `fault`.
fn readings(case: &Case, k: usize, fault: &dyn Fn(usize, &mut [f64])) -> Vec<f64> {
    let mut y = case.data.at(k, case.measured);
    fault(k, &mut y);
    y
}

/// Estimates and statuses, row by row.
fn run(
    case: &Case,
    estimator: &mut dyn Estimator,
    fault: &dyn Fn(usize, &mut [f64]),
) -> Vec<(Vec<f64>, EstimatorStatus, usize)> {
    (0..case.data.len().min(130))
        .map(|k| {
            let correction = estimator.correct(&readings(case, k, fault));
            let found = (estimator.estimate().to_vec(), correction.status, correction.rejected);
            estimator.predict(&case.data.at(k, case.inputs));
            found
        })
        .collect()
}

/// A wild reading is a missing one, to the bit; what the other sensor says is used.
#[test]
fn a_wild_reading_is_a_missing_one() {
    for case in [tanks(), oscillator()] {
        for wild in [65535.0, -1e308] {
            let both = [wild, f64::NAN].map(|value| {
                estimators(&case, &case.tuning).map(|mut estimator| {
                    run(&case, estimator.as_mut(), &|k, y| {
                        if k == 100 {
                            y[0] = value;
                        }
                    })
                })
            });
            for (rejected, missing) in both[0].iter().zip(&both[1]) {
                for (k, (rejected, missing)) in rejected.iter().zip(missing).enumerate() {
                    assert_eq!(rejected.0, missing.0, "{wild} at {k}");
                    let expected =
                        if k == 100 { (EstimatorStatus::Rejected, 1) } else { (missing.1, 0) };
                    assert_eq!((rejected.1, rejected.2), expected, "{wild} at {k}");
                }
            }
        }
    }
}

/// With the bound just above and just below the innovation, whose variance is H P H' + R.
#[test]
fn the_gate_counts_standard_deviations_of_the_innovation() {
    let case = oscillator();
    // P is 1 and R is 0.01: a reading of 3 is 3 / sqrt(1.01) = 2.985 standard deviations off.
    for (sd, rejected) in [(2.98, 1), (2.99, 0)] {
        let tuning = Tuning { gate: Gate::Sd(sd), ..case.tuning.clone() };
        for mut estimator in estimators(&case, &tuning) {
            assert_eq!(estimator.correct(&[3.0]).rejected, rejected, "{sd}");
        }
    }
    let off = Tuning { gate: Gate::Off, ..case.tuning.clone() };
    for mut estimator in estimators(&case, &off) {
        assert_eq!(estimator.correct(&[65535.0]).status, EstimatorStatus::Updated);
    }
}

/// A jump that the gate rejects at first is believed after five rejections, each with its count.
#[test]
fn a_jump_that_stays_gets_through() {
    let case = tanks();
    let tuning = Tuning { initial_sd: vec![1.0; 4], ..case.tuning.clone() };
    for mut estimator in estimators(&case, &tuning) {
        let found = run(&case, estimator.as_mut(), &|k, y| {
            if k >= 100 {
                y[0] += 20.0;
            }
        });
        let statuses: Vec<_> = found[100..105].iter().map(|row| row.1).collect();
        let rejected = EstimatorStatus::Rejected;
        let expected = [rejected, rejected, rejected, rejected, EstimatorStatus::Reacquired];
        assert_eq!(statuses, expected);
        assert_eq!(found[104].2, 0);
        assert!((found[104].0[0] - case.data.at(104, case.measured)[0] - 20.0).abs() < 0.5);
    }
}

/// A sensor that is stuck far beyond what the plant can do is never believed, and does not harm what
/// the other one tells.
#[test]
fn a_stuck_sensor_is_never_believed() {
    let case = tanks();
    for mut estimator in estimators(&case, &case.tuning) {
        let found = run(&case, estimator.as_mut(), &|k, y| {
            if k >= 100 {
                y[0] = 65535.0;
            }
        });
        assert!(found[100..].iter().all(|row| (row.1, row.2) == (EstimatorStatus::Rejected, 1)));
        assert!(found.iter().flat_map(|row| &row.0).all(|z| (0.0..25.0).contains(z)));
    }
}

/// The gate needs a width.
#[test]
fn a_gate_without_a_width_is_refused() {
    let case = tanks();
    for sd in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        let tuning = Tuning { gate: Gate::Sd(sd), ..case.tuning.clone() };
        let error = Ekf::new(case.model(), tuning).unwrap_err().to_string();
        assert!(error.starts_with("gate is ") && error.ends_with("positive and finite"), "{error}");
    }
}
