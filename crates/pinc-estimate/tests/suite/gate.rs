//! Wild, stuck and jumping readings.

use super::filters::Linear;
use super::support::{Case, oscillator, tanks};
use pinc_estimate::{
    Augmentation, Augmented, Disturbance, Ekf, Estimator, EstimatorStatus, Gate, Measured, Mhe,
    Tuning, Ukf,
};
use pinc_ode::{Model, Rk4};
use pinc_plants::VanDerPol;

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

/// A reading that passes takes back one rejection, not all.
#[test]
fn rejections_count_beyond_a_reading_that_passes() {
    let case = tanks();
    let tuning = Tuning { initial_sd: vec![1.0; 4], ..case.tuning.clone() };
    for mut estimator in estimators(&case, &tuning) {
        let off = [100, 101, 103, 104, 106, 107, 108];
        let found = run(&case, estimator.as_mut(), &|k, y| {
            if off.contains(&k) {
                y[0] += 20.0;
            }
        });
        for (k, row) in found.iter().enumerate().take(109).skip(100) {
            let expected = match k {
                108 => EstimatorStatus::Reacquired,
                _ if off.contains(&k) => EstimatorStatus::Rejected,
                _ => EstimatorStatus::Updated,
            };
            assert_eq!(row.1, expected, "{k}");
        }
    }
}

/// The first covariance by which a reading is judged again is the widest of three: the initial one,
/// a step's, and the range's.
#[test]
fn a_covariance_is_widened_to_the_range() {
    let tuning = Tuning {
        initial_sd: vec![0.5, 0.1, 0.1, 0.5],
        process_sd: vec![0.2, 0.3, 0.2, 0.6],
        range: vec![9.0, 6.0, 12.0],
        gate: Gate::Sd(30.0),
        ..Tuning::default()
    };
    for (found, expected) in Gate::widened(&tuning).iter().zip([0.25, 0.09, 0.16, 0.36]) {
        assert!((found - expected).abs() < 1e-12, "{found} {expected}");
    }
    let off = Tuning { gate: Gate::Off, ..tuning };
    assert!((Gate::widened(&off)[2] - 0.04).abs() < 1e-12);
}

/// The controlled oscillator with a disturbed input, whose estimators trust themselves too much.
fn lost(range: Vec<f64>) -> ([Box<dyn Estimator>; 3], Tuning) {
    let measured = Augmentation::measured(Measured::states([0]));
    let augmentation = Augmentation { disturbance: Disturbance::Input, ..measured };
    let tuning = Tuning {
        initial_estimate: vec![1.0, 0.0, 0.0],
        initial_sd: vec![0.001, 0.001, 0.5],
        process_sd: vec![0.001, 0.001, 0.1],
        measurement_sd: vec![0.001],
        range,
        ..Tuning::default()
    };
    let model = || Box::new(Augmented::new(plant(), augmentation.clone()).unwrap());
    let estimators: [Box<dyn Estimator>; 3] = [
        Box::new(Ekf::new(model(), tuning.clone()).unwrap()),
        Box::new(Ukf::new(model(), tuning.clone()).unwrap()),
        Box::new(Mhe::new(model(), tuning.clone(), 10).unwrap()),
    ];
    (estimators, tuning)
}

fn plant() -> Box<Rk4<VanDerPol>> {
    Box::new(Rk4::new(VanDerPol::default(), 0.5, 4))
}

/// How far the estimate is off `after` steps after a fault of `length` steps that `read` makes of the
/// plant's position and the last one that was read well.
fn off_after(
    estimator: &mut dyn Estimator,
    (begin, length, after): (u32, u32, u32),
    read: &dyn Fn(f64, f64) -> f64,
) -> f64 {
    estimator.reset();
    let (mut plant, mut x, mut next, mut last) = (plant(), vec![1.0, 0.0], vec![0.0; 2], 0.0);
    for k in 0..begin + length + after {
        if k < begin {
            last = x[0];
        }
        let is_faulty = (begin..begin + length).contains(&k);
        estimator.correct(&[if is_faulty { read(x[0], last) } else { x[0] }]);
        let u = (0.25 * f64::from(k)).sin();
        estimator.predict(&[u]);
        plant.step(&x, &[u - 0.15], &[], &mut next);
        x.copy_from_slice(&next);
    }
    (estimator.estimate()[0] - x[0]).abs()
}

/// After a sensor froze while the oscillator moved on, estimators that trust themselves too much are
/// back at the plant.
#[test]
fn a_lost_estimate_finds_the_plant_again() {
    for mut estimator in lost(vec![2.0, 2.0]).0 {
        for begin in [13, 16, 46, 49] {
            let off = off_after(estimator.as_mut(), (begin, 50, 35), &|_, last| last);
            assert!(off < 0.01, "{begin}: {off}");
        }
    }
}

/// So they are after readings were missing or wild for so long that a covariance without a limit
/// would have left the finite numbers.
#[test]
fn an_estimate_without_readings_finds_the_plant_again() {
    for mut estimator in lost(vec![2.0, 2.0]).0 {
        for wild in [f64::NAN, 4095.0, 1e308] {
            let off = off_after(estimator.as_mut(), (20, 40, 12), &|_, _| wild);
            assert!(off < 0.01, "{wild}: {off}");
        }
    }
}

/// A prediction leaves no standard deviation beyond a range, and correlations as they are.
#[test]
fn no_prediction_leaves_more_than_the_range() {
    let (free, _) = lost(Vec::new());
    let (limited, tuning) = lost(vec![0.2, 0.3]);
    let most = tuning.most_variance();
    assert!((most[0] - 0.04).abs() < 1e-15 && (most[1] - 0.09).abs() < 1e-15, "{most:?}");
    assert!(most[2].is_infinite());
    for (mut free, mut limited) in free.into_iter().zip(limited) {
        for k in 0..40 {
            for estimator in [&mut free, &mut limited] {
                estimator.predict(&[0.0]);
            }
            let (p, q) = (free.covariance(), limited.covariance());
            let is_wide = p[0] > most[0];
            assert!(q[0] <= most[0] * (1.0 + 1e-12) && q[4] <= most[1] * (1.0 + 1e-12), "{k}");
            if is_wide {
                // This is the first step that is limited.
                let factors = [(most[0] / p[0]).sqrt(), (most[1] / p[4]).sqrt().min(1.0), 1.0];
                for i in 0..9 {
                    let expected = p[i] * factors[i / 3] * factors[i % 3];
                    assert!((q[i] - expected).abs() < 1e-9 * expected.abs(), "{k}, {i}: {q:?}");
                }
                break;
            }
        }
        assert!(limited.covariance()[0] > 0.039, "{:?}", limited.covariance());
    }
    let wide = Tuning {
        initial_sd: vec![3.0, 0.1, 0.5],
        process_sd: vec![0.001, 4.0, 0.1],
        range: vec![2.0, 2.0, 0.0],
        ..tuning
    };
    let most = wide.most_variance();
    assert!((most[0] - 9.0).abs() < 1e-12 && (most[1] - 16.0).abs() < 1e-12, "{most:?}");
    assert!(most[2].is_infinite());
}

/// A sound sensor and a model that is right, but an estimate that begins far off and is sure of
/// itself: a reading that passes with a wider covariance moves the measured state alone, and the next
/// one is rejected again, until the covariance is wide enough for what is not measured, a disturbance
/// among it. Then the estimate is right within a few steps, in all estimators.
#[test]
fn an_estimate_that_is_sure_of_a_wrong_state_is_given_up_in_a_dozen_steps() {
    let plant = Linear {
        a: [[0.82, 0.3], [0.0, 0.67]],
        b: [0.06, 0.33],
        c: [[1.0, 0.0], [0.0, 1.0]],
        d: [0.0; 2],
    };
    let load = Augmentation {
        disturbance: Disturbance::Input,
        ..Augmentation::measured(Measured::states([0]))
    };
    for sd in [1e-2, 1e-3] {
        let tuning = Tuning {
            initial_estimate: vec![2.0, 0.0, 0.0],
            initial_sd: vec![sd, sd, 0.3],
            process_sd: vec![0.01, 0.01, 0.05],
            measurement_sd: vec![0.01],
            range: vec![6.0; 2],
            ..Tuning::default()
        };
        let model = || Box::new(Augmented::new(Box::new(plant.clone()), load.clone()).unwrap());
        let estimators: [Box<dyn Estimator>; 3] = [
            Box::new(Ekf::new(model(), tuning.clone()).unwrap()),
            Box::new(Ukf::new(model(), tuning.clone()).unwrap()),
            Box::new(Mhe::new(model(), tuning.clone(), 5).unwrap()),
        ];
        for mut filter in estimators {
            let (mut x, mut reacquired) = ([0.0; 2], 0);
            for k in 0..40_u32 {
                let u = [f64::from(k / 10 % 2)];
                let status = filter.correct(&x[..1]).status;
                reacquired += u32::from(status == EstimatorStatus::Reacquired);
                if k >= 16 {
                    let off = filter.estimate().iter().zip([x[0], x[1], 0.0]);
                    let off = off.fold(0.0, |most: f64, (z, x)| most.max((z - x).abs()));
                    assert!(off < 0.05, "{sd}, step {k}: {off} {:?}", filter.estimate());
                }
                filter.predict(&u);
                let mut next = [0.0; 2];
                plant.clone().step(&x, &u, &[], &mut next);
                x = next;
            }
            assert!((2..=8).contains(&reacquired), "{sd}: {reacquired}");
        }
    }
}
