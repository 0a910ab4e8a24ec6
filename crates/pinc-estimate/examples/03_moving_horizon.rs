//! A batch reactor of which the total pressure is measured: with a bad prior the Kalman filter
//! finds a negative pressure and stays there; moving horizon estimation knows that there is none.
//!
//! `cargo run -p pinc-estimate --example 03_moving_horizon`
#![expect(clippy::print_stdout, reason = "an example shows what it computes")]

use pinc_ad::Scalar;
use pinc_estimate::{
    Augmentation, Augmented, Ekf, EstimateError, Estimator, Measured, Mhe, Tuning,
};
use pinc_ode::{Model, Plant, Rk4, Variable};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

/// 2 A -> B, after Haseltine and Rawlings: pA' = -2 k pA^2, pB' = k pA^2.
#[derive(Clone, Debug)]
struct Batch;

impl Plant for Batch {
    fn states(&self) -> &[Variable] {
        static STATES: [Variable; 2] = [Variable::new("pA", ""), Variable::new("pB", "")];
        &STATES
    }
    // A model has an input; this one does nothing.
    fn inputs(&self) -> &[Variable] {
        static INPUTS: [Variable; 1] = [Variable::new("none", "")];
        &INPUTS
    }
    fn outputs(&self) -> &[Variable] {
        static OUTPUTS: [Variable; 1] = [Variable::new("total", "")];
        &OUTPUTS
    }
    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], _u: &[S], _p: &[S], dx: &mut [S]) {
        let rate = x[0] * x[0] * 0.16;
        dx[0] = rate * -2.0;
        dx[1] = rate;
    }
    fn output<S: Scalar>(&self, x: &[S], _u: &[S], _p: &[S], y: &mut [S]) {
        y[0] = x[0] + x[1];
    }
}

pub(crate) fn main() -> Result<(), EstimateError> {
    let reactor = || Box::new(Rk4::new(Batch, 0.1, 4));
    let total = || Augmentation::measured(vec![Measured::Output(0)]);
    let model = || Augmented::new(reactor(), total());
    let tuning = Tuning {
        initial_estimate: vec![0.1, 4.5],
        initial_sd: vec![6.0, 6.0],
        process_sd: vec![0.001, 0.001],
        measurement_sd: vec![0.1],
        ..Tuning::default()
    };
    let mut filter = Ekf::new(Box::new(model()?), tuning.clone())?;
    let bounded = Tuning { low: vec![0.0, 0.0], ..tuning };
    let mut horizon = Mhe::new(Box::new(model()?), bounded, 10)?;

    let (mut plant, mut x) = (reactor(), [3.0, 1.0]);
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let noise = Normal::new(0.0, 0.1).expect("a positive standard deviation");
    for k in 0..100 {
        let measured = [x[0] + x[1] + noise.sample(&mut rng)];
        filter.correct(&measured);
        horizon.correct(&measured);
        if k % 20 == 0 {
            let [by_filter, by_horizon] = [filter.estimate()[0], horizon.estimate()[0]];
            println!("pA {:.3}: filter {by_filter:.3}, moving horizon {by_horizon:.3}", x[0]);
        }
        filter.predict(&[0.0]);
        horizon.predict(&[0.0]);
        let mut next = [0.0; 2];
        plant.step(&x, &[0.0], &[], &mut next);
        x = next;
    }
    assert!(filter.estimate()[0] < 0.0);
    assert!((horizon.estimate()[0] - x[0]).abs() < 0.1);
    Ok(())
}
