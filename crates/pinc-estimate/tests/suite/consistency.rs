//! Consistency of estimators, and their robustness against any measurement.

use crate::support::{oscillator, tanks};
use pinc_estimate::{Ekf, Estimator, EstimatorStatus, Mhe, Tuning, Ukf};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

fn normal(rng: &mut ChaCha8Rng) -> f64 {
    StandardNormal.sample(rng)
}

/// e' P^-1 e of the first `e.len()` states, by elimination.
fn normalized(p: &[f64], e: &[f64]) -> f64 {
    let n = e.len();
    let mut rows: Vec<Vec<f64>> =
        (0..n).map(|i| [&p[i * n..(i + 1) * n], &[e[i]]].concat()).collect();
    let mut sum = 0.0;
    for c in 0..n {
        let pivot = rows[c].clone();
        sum += pivot[n] * pivot[n] / pivot[c];
        for row in &mut rows[c + 1..] {
            let factor = row[c] / pivot[c];
            row.iter_mut().zip(&pivot).for_each(|(entry, pivot)| *entry -= factor * pivot);
        }
    }
    sum
}

/// NEES and NIS in each of 240 steps on a simulated plant with just the noise that the filter is
/// told of; the first estimate is off by `spread` times what the filter is told.
fn simulated(unscented: bool, seed: u64, spread: f64) -> Vec<(f64, f64)> {
    let case = tanks();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let Tuning { initial_estimate, initial_sd, process_sd, measurement_sd, .. } =
        case.tuning.clone();
    let mut filter: Box<dyn Estimator> = if unscented {
        Box::new(Ukf::new(case.model(), case.tuning.clone()).unwrap())
    } else {
        Box::new(Ekf::new(case.model(), case.tuning.clone()).unwrap())
    };
    let mut plant = case.model();
    let start = initial_estimate.iter().zip(&initial_sd);
    let mut x: Vec<f64> = start.map(|(z, sd)| z + spread * sd * normal(&mut rng)).collect();
    let step = |k| {
        let y = [0, 1].map(|i| x[i] + measurement_sd[i] * normal(&mut rng));
        let nis = filter.correct(&y).nis;
        let errors: Vec<_> = filter.estimate().iter().zip(&x).map(|(z, x)| z - x).collect();
        let nees = normalized(filter.covariance(), &errors);
        let u = case.data.at(k, case.inputs);
        filter.predict(&u);
        let mut next = [0.0; 4];
        plant.step(&x, &u, &[], &mut next);
        for ((x, next), sd) in x.iter_mut().zip(next).zip(&process_sd) {
            *x = next + sd * normal(&mut rng);
        }
        (nees, nis)
    };
    (0..240).map(step).collect()
}

/// Means of NEES and NIS over plants and steps.
#[test]
fn errors_and_innovations_have_the_spread_that_is_claimed() {
    for unscented in [false, true] {
        let of_seed = |seed| simulated(unscented, seed, 0.5).into_iter().skip(20);
        let (nees, nis): (Vec<f64>, Vec<f64>) = (0..20).flat_map(of_seed).unzip();
        let mean = |values: &[f64]| {
            values.iter().sum::<f64>() / f64::from(u32::try_from(values.len()).unwrap())
        };
        // 95 % bands of the means: 4400 independent innovations with 2 degrees of freedom; errors
        // with 4, of which some ten steps in a row are alike.
        assert!((mean(&nis) - 2.0).abs() < 1.96 * (4.0 / 4400.0_f64).sqrt(), "{}", mean(&nis));
        assert!((mean(&nees) - 4.0).abs() < 1.96 * (8.0 / 440.0_f64).sqrt(), "{}", mean(&nees));
    }
}

/// At each step the means over 20 plants are within their 95 % bands, as often as that says.
#[test]
fn means_over_seeds_are_within_their_bands() {
    // 2.5 % of the chi-square distributions with 20 * 4 and 20 * 2 degrees of freedom lie below,
    // and 2.5 % above (a table's quantiles).
    let (nees_band, nis_band) = (57.153..106.629, 24.433..59.342);
    for unscented in [false, true] {
        let plants: Vec<_> = (100..120).map(|seed| simulated(unscented, seed, 1.0)).collect();
        let sums = (0..240).map(|k| {
            let steps = plants.iter().map(|plant| plant[k]);
            steps.fold((0.0, 0.0), |sum, step| (sum.0 + step.0, sum.1 + step.1))
        });
        let (nees, nis): (Vec<f64>, Vec<f64>) = sums.unzip();
        // Of 240 independent sums 228 are expected inside, with a standard deviation of 3.4; for
        // errors it is some three times as large, since errors of neighbouring steps are alike.
        for (sums, band, least) in [(nees, &nees_band, 207), (nis, &nis_band, 217)] {
            let inside = sums.iter().filter(|sum| band.contains(*sum)).count();
            assert!((least..240).contains(&inside), "{inside} of 240");
        }
    }
}

/// Measurements of all kinds: right, far off, of the wrong sign, absent, infinite.
fn stream(rng: &mut ChaCha8Rng, truth: f64) -> f64 {
    match rng.random_range(0..100) {
        0 => f64::NAN,
        1 => f64::INFINITY,
        2 => -truth,
        3 => 1e6 * normal(rng),
        4 => 0.0,
        5..20 => f64::NAN,
        _ => truth + 0.05 * normal(rng),
    }
}

/// How many steps a stream has: `default`, or as the environment says. The long streams are run by
/// `PINC_STREAM_STEPS=100000 cargo test --release -p pinc-estimate --test suite wild`.
fn steps_of_a_stream(default: usize) -> usize {
    std::env::var("PINC_STREAM_STEPS").map_or(default, |n| n.parse().unwrap())
}

#[test]
fn wild_measurements_do_no_harm() {
    for (case, low, high) in [(tanks(), 0.0, 20.0), (oscillator(), -3.0, 3.0)] {
        let n = case.states.len();
        let tuning = Tuning { low: vec![low; n], high: vec![high; n], ..case.tuning.clone() };
        let estimators: [(Box<dyn Estimator>, usize); 3] = [
            (Box::new(Ekf::new(case.model(), tuning.clone()).unwrap()), 10_000),
            (Box::new(Ukf::new(case.model(), tuning.clone()).unwrap()), 3_000),
            (Box::new(Mhe::new(case.model(), tuning, 3).unwrap()), 500),
        ];
        for (mut estimator, steps) in estimators {
            let steps = steps_of_a_stream(steps);
            let mut rng = ChaCha8Rng::seed_from_u64(7);
            let mut updated = 0;
            for k in 0..steps {
                let row = k % case.data.len();
                let truth = case.data.at(row, &case.states[..case.measured.len()]);
                let y: Vec<_> = truth.iter().map(|y| stream(&mut rng, *y)).collect();
                let correction = estimator.correct(&y);
                let there = y.iter().filter(|y| y.is_finite()).count();
                assert_eq!(correction.measured + correction.rejected, there);
                let status = correction.status;
                assert!(status != EstimatorStatus::NothingMeasured || there == 0, "{k}");
                updated += usize::from(status.has_succeeded());
                let is_optimal = correction.kkt <= 1e-8;
                assert!(is_optimal || !status.has_succeeded(), "{k}: {correction:?}");
                assert!(estimator.estimate().iter().all(|z| (low..=high).contains(z)), "{k}");
                estimator.predict(&case.data.at(row, case.inputs));
                assert!(estimator.covariance().iter().all(|p| p.is_finite()), "{k}");
                assert!(estimator.estimate().iter().all(|z| z.is_finite()), "{k}");
            }
            assert!(updated > steps * 7 / 10, "{updated} of {steps}");
        }
    }
}
