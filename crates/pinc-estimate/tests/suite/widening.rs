//! The covariance by which a reading is judged again after too many rejections.

use super::filters::Linear;
use pinc_estimate::{Ekf, Estimator, EstimatorStatus, Gate, Mhe, Tuning, Ukf};

/// Neither sensor sees a state alone, and no coefficient is its own square.
fn model() -> Linear {
    Linear {
        a: [[0.9, 0.3], [-0.2, 0.8]],
        b: [0.5, -0.4],
        c: [[2.0, 0.5], [-0.6, 1.5]],
        d: [0.0; 2],
    }
}

/// The first state is widened to a step's variance, 0.49, the second to the initial one, 2.25.
fn tuning() -> Tuning {
    Tuning {
        initial_estimate: vec![0.3, -0.2],
        initial_sd: vec![0.5, 1.5],
        process_sd: vec![0.7, 0.1],
        measurement_sd: vec![0.4, 0.3],
        gate: Gate::Sd(10.0),
        ..Tuning::default()
    }
}

const WIDENED: [f64; 2] = [0.49, 2.25];

fn estimators() -> [(Box<dyn Estimator>, f64); 3] {
    let model = || Box::new(model());
    [
        (Box::new(Ekf::new(model(), tuning()).unwrap()), 1e-10),
        (Box::new(Ukf::new(model(), tuning()).unwrap()), 1e-4),
        (Box::new(Mhe::new(model(), tuning(), 3).unwrap()), 1e-10),
    ]
}

/// What sensor 0 is expected to read.
fn expected(estimator: &dyn Estimator) -> f64 {
    let (c, z) = (model().c[0], estimator.estimate());
    c[0] * z[0] + c[1] * z[1]
}

/// Sensor 0 is wild `wild` times while sensor 1 goes on.
fn after_rejections(estimator: &mut dyn Estimator, wild: usize) {
    estimator.reset();
    for k in 0..wild + 3 {
        let both = [
            expected(estimator),
            model().c[1].iter().zip(estimator.estimate()).map(|(c, z)| c * z).sum(),
        ];
        let y = if k < 3 { both } else { [1e9, both[1]] };
        let status = estimator.correct(&y).status;
        let rejected = if k < 3 { EstimatorStatus::Updated } else { EstimatorStatus::Rejected };
        assert_eq!(status, rejected, "{k}");
        estimator.predict(&[0.2]);
    }
}

/// Without correlations, nowhere narrower than it was, with the standard deviations doubled after
/// five rejections more: readings just within pass and are used with this covariance, those just
/// beyond do not.
#[test]
fn a_reading_is_judged_again_by_the_widened_covariance() {
    let (h, r) = (model().c[0], 0.16);
    for (wild, factor) in [(4, 1.0), (9, 4.0), (14, 16.0)] {
        for (mut estimator, tolerance) in estimators() {
            after_rejections(estimator.as_mut(), wild);
            let p = estimator.covariance().to_vec();
            assert!(p[1].abs() > 0.01 && p[0] > WIDENED[0] && p[3] < WIDENED[1], "{p:?}");
            let wide = [0, 1].map(|k| p[3 * k].max(factor * WIDENED[k]));
            let s = h[0] * h[0] * wide[0] + h[1] * h[1] * wide[1] + r;
            let z = estimator.estimate().to_vec();
            let off = 10.0 * s.sqrt();
            let beyond = expected(estimator.as_ref()) + 1.001 * off;
            let status = estimator.correct(&[beyond, f64::NAN]).status;
            assert_eq!(status, EstimatorStatus::Rejected, "{wild}");
            after_rejections(estimator.as_mut(), wild);
            let within = expected(estimator.as_ref()) - 0.999 * off;
            let correction = estimator.correct(&[within, f64::NAN]);
            assert_eq!(correction.status, EstimatorStatus::Reacquired, "{wild}");
            assert_eq!((correction.measured, correction.rejected), (1, 0));
            assert!((correction.nis - 0.999 * 0.999 * 100.0).abs() < 1e-2, "{}", correction.nis);
            let gain = [h[0] * wide[0] / s, h[1] * wide[1] / s];
            let p = estimator.covariance();
            for i in 0..2 {
                let change = -0.999 * off * gain[i];
                assert!((estimator.estimate()[i] - z[i] - change).abs() < tolerance * off, "{i}");
                for j in 0..2 {
                    let before = if i == j { wide[i] } else { 0.0 };
                    let found = p[2 * i + j] - (before - gain[i] * s * gain[j]);
                    assert!(found.abs() < tolerance * wide[1], "{i} {j}: {p:?}");
                }
            }
        }
    }
}
