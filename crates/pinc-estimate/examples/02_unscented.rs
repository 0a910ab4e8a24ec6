//! The oscillator, of which the position is measured: the unscented filter needs no Jacobians of
//! the model, and a sensor that is silent for a while does no harm.
//!
//! `cargo run -p pinc-estimate --example 02_unscented`
#![expect(clippy::print_stdout, reason = "an example shows what it computes")]

use pinc_estimate::{
    Augmentation, Augmented, EstimateError, Estimator, EstimatorStatus, Measured, Tuning, Ukf,
};
use pinc_ode::{Model, Rk4};
use pinc_plants::VanDerPol;

pub(crate) fn main() -> Result<(), EstimateError> {
    let oscillator = || Box::new(Rk4::new(VanDerPol::default(), 0.5, 4));
    let model = Augmented::new(oscillator(), Augmentation::measured(Measured::states([0])))?;
    let tuning = Tuning {
        initial_estimate: vec![0.0, 0.0],
        initial_sd: vec![1.0, 1.0],
        process_sd: vec![0.01, 0.01],
        measurement_sd: vec![0.02],
        ..Tuning::default()
    };
    let mut filter = Ukf::new(Box::new(model), tuning)?;

    let (mut plant, mut x) = (oscillator(), [1.0, 0.5]);
    let mut uncertain = 0.0_f64;
    for k in 0..40 {
        // Nothing comes from the sensor between steps 20 and 30.
        let silent = (20..30).contains(&k);
        let correction = filter.correct(&[if silent { f64::NAN } else { x[0] }]);
        let expected =
            if silent { EstimatorStatus::NothingMeasured } else { EstimatorStatus::Updated };
        assert_eq!(correction.status, expected);
        let (z, sd) = (filter.estimate(), filter.covariance()[3].sqrt());
        if k % 5 == 0 {
            println!("velocity {:6.3}, estimated {:6.3} +- {:.3}", x[1], z[1], 1.96 * sd);
        }
        if silent {
            uncertain = uncertain.max(sd);
        } else if k >= 5 {
            assert!((z[1] - x[1]).abs() < 0.1);
        }
        filter.predict(&[0.2]);
        let mut next = [0.0; 2];
        plant.step(&x, &[0.2], &[], &mut next);
        x = next;
    }
    assert!(uncertain > 2.0 * filter.covariance()[3].sqrt());
    Ok(())
}
