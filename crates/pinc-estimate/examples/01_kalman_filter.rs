//! Four tanks of which two levels are measured, with noise: the extended Kalman filter finds the
//! other two, and what a worn pump lacks.
//!
//! `cargo run -p pinc-estimate --example 01_kalman_filter`
#![expect(clippy::print_stdout, reason = "an example shows what it computes")]

use pinc_estimate::{
    Augmentation, Augmented, Disturbance, Ekf, EstimateError, Estimator, EstimatorStatus, Measured,
    Tuning,
};
use pinc_ode::{Model, Rk4};
use pinc_plants::FourTanks;
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

pub(crate) fn main() -> Result<(), EstimateError> {
    // What the filter knows: new pumps, sensors in the lower tanks, and that something may be wrong
    // with the inputs.
    let model = Rk4::new(FourTanks::johansson_minimum(), 10.0, 4);
    let sensors = Augmentation {
        disturbance: Disturbance::Input,
        ..Augmentation::measured(Measured::states([0, 1]))
    };
    let model = Augmented::new(Box::new(model), sensors)?;
    // Of (h1, h2, h3, h4, d1, d2).
    let tuning = Tuning {
        initial_estimate: vec![12.0, 12.0, 1.0, 1.0, 0.0, 0.0],
        initial_sd: vec![1.0, 1.0, 1.0, 1.0, 0.5, 0.5],
        process_sd: vec![0.02, 0.02, 0.02, 0.02, 0.01, 0.01],
        measurement_sd: vec![0.05, 0.05],
        ..Tuning::default()
    };
    let mut filter = Ekf::new(Box::new(model), tuning)?;

    // What is true: pumps with 5 % less.
    let worn = FourTanks { pump: [0.95 * 3.33, 0.95 * 3.35], ..FourTanks::johansson_minimum() };
    let mut plant = Rk4::new(worn, 10.0, 4);
    let (mut level, u) = ([12.4, 12.7, 1.8, 1.4], [3.0, 3.0]);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let noise = Normal::new(0.0, 0.05).expect("a positive standard deviation");
    for k in 0..120 {
        let measured = [level[0], level[1]].map(|h| h + noise.sample(&mut rng));
        let correction = filter.correct(&measured);
        assert_eq!(correction.status, EstimatorStatus::Updated);
        if k % 30 == 0 {
            let z = filter.estimate();
            println!("h3 {:6.3}, estimated {:6.3}; d1 {:6.3} V", level[2], z[2], z[4]);
        }
        filter.predict(&u);
        let mut next = [0.0; 4];
        plant.step(&level, &u, &[], &mut next);
        level = next;
    }

    // 5 % of 3 V are missing.
    let (z, p) = (filter.estimate(), filter.covariance());
    let n = z.len();
    for i in 4..n {
        let sd = p[i * (n + 1)].sqrt();
        println!("d{} = {:.3} +- {:.3} V", i - 3, z[i], 1.96 * sd);
        assert!((z[i] + 0.15).abs() < 3.0 * sd && sd < 0.05);
    }
    assert!((z[2] - level[2]).abs() < 0.1);
    Ok(())
}
