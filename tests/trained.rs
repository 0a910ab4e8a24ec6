//! Nets for the tests of loops.

use pinc_net::optim::SelfScaledBroydenConfig;
use pinc_net::{Domain, NetConfig, Phase, PincModel, Training, TrainingConfig, ValidationConfig};
use pinc_ode::Plant;

/// A net of two layers, trained for some tenths of a second or a few seconds.
pub(crate) fn train<P: Plant>(
    plant: P,
    (sample_time_s, neurons): (f64, usize),
    domain: Domain,
    iterations: u64,
) -> PincModel {
    let training = Training {
        config: TrainingConfig {
            collocation_points: 512,
            phases: vec![Phase::new(SelfScaledBroydenConfig::default(), iterations)],
            growth: None,
            validation_every: iterations,
            ..TrainingConfig::recommended()
        },
        validation: ValidationConfig {
            scenarios: 1,
            subintervals: 1,
            tolerance: 1e-8,
            one_step_points: 10,
            ..ValidationConfig::new(4.0 * sample_time_s, domain.clone())
        },
        threads: 1,
        ..Training::new(NetConfig::new(sample_time_s, 2, neurons), domain)
    };
    PincModel::new(&training.run(&plant).unwrap().net).unwrap()
}
