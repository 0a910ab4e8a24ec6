//! A net for the Van der Pol oscillator, trained on its equation alone and judged by an accurate
//! integration.
//!
//! `cargo run --release -p pinc-net --example 01_train`
#![expect(clippy::print_stdout, reason = "an example shows what it computes")]

use pinc_net::{Domain, NetConfig, NetError, Trained, Training, TrainingConfig, ValidationConfig};
use pinc_plants::VanDerPol;

/// Two layers of 16 neurons for steps of 0.5 s, and the box of states and inputs that the net is to
/// be good for. All else is as recommended, but the training ends as soon as a step is accurate
/// to 5e-3.
pub(crate) fn training() -> Training {
    let domain = Domain::new([-3.0..=3.0, -4.35..=4.35], [-1.0..=1.0]);
    // Trajectories that begin in this smaller box stay in the domain.
    let inner = Domain::new([-2.0..=2.0, -2.0..=2.0], [-1.0..=1.0]);
    Training {
        config: TrainingConfig { target_one_step_rms: Some(5e-3), ..TrainingConfig::recommended() },
        validation: ValidationConfig::new(5.0, inner),
        ..Training::new(NetConfig::new(0.5, 2, 16), domain)
    }
}

/// The trained net with its errors.
pub(crate) fn trained() -> Result<Trained, NetError> {
    training().run(&VanDerPol::default())
}

pub(crate) fn main() -> Result<(), NetError> {
    let trained = trained()?;
    println!("{}: {} iterations", trained.stop_reason, trained.totals.iterations);
    println!("{} weights", trained.net.mlp().parameters().len());
    println!("rms error of a step: {:.1e}", trained.validation.one_step_mse.sqrt());
    println!("mse over 5 s, fed with itself: {:.1e}", trained.validation.mse_gen);
    assert!(trained.validation.one_step_mse.sqrt() <= 5e-3);
    Ok(())
}
