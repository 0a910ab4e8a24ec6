//! Small trainings of the oscillator's net.

use pinc_net::optim::{AdamConfig, LbfgsConfig, LevenbergMarquardtConfig, SelfScaledBroydenConfig};
use pinc_net::{
    Ansatz, Domain, GrowthConfig, IterationRecord, NetConfig, NetError, Phase, PincNet, Progress,
    StopReason, Trainer, Training, TrainingConfig, Validation, ValidationConfig,
};
use pinc_ode::DynRhs;
use pinc_plants::VanDerPol;

pub(crate) fn adam(iterations: u64) -> Phase {
    Phase::new(AdamConfig::new(1e-2), iterations)
}

pub(crate) fn lbfgs(iterations: u64) -> Phase {
    Phase::new(LbfgsConfig::default(), iterations)
}

pub(crate) fn broyden(iterations: u64) -> Phase {
    Phase::new(SelfScaledBroydenConfig::default(), iterations)
}

pub(crate) fn levenberg_marquardt(iterations: u64) -> Phase {
    Phase::new(LevenbergMarquardtConfig::default(), iterations)
}

pub(crate) fn training(phases: Vec<Phase>) -> TrainingConfig {
    TrainingConfig {
        collocation_points: 256,
        initial_points: 32,
        lambda: 0.5,
        phases,
        growth: None,
        validation_every: 10,
        ..TrainingConfig::recommended()
    }
}

pub(crate) fn growth() -> Option<GrowthConfig> {
    Some(GrowthConfig {
        max_points: 2048,
        factor: 2,
        overfit_ratio: 1.2,
        check_every: 20,
        fresh_points: 512,
    })
}

pub(crate) fn van_der_pol_domain() -> Domain {
    Domain::new(vec![-3.0..=3.0; 2], [-1.0..=1.0])
}

pub(crate) fn validation(sample_time_s: f64, domain: &Domain) -> ValidationConfig {
    ValidationConfig {
        scenarios: 3,
        subintervals: 3,
        tolerance: 1e-10,
        one_step_points: 64,
        ..ValidationConfig::new(4.0 * sample_time_s, domain.clone())
    }
}

/// A training of the oscillator's 2x8 net.
pub(crate) fn small(config: &TrainingConfig, ansatz: Ansatz, threads: usize) -> Training {
    let domain = van_der_pol_domain();
    let validation = validation(0.5, &domain);
    let net = NetConfig { ansatz, ..NetConfig::new(0.5, 2, 8) };
    Training { config: config.clone(), validation, seed: 3, threads, ..Training::new(net, domain) }
}

pub(crate) fn begin(plant: &dyn DynRhs, training: &Training) -> Result<Trainer, NetError> {
    Trainer::new(plant, training, training.validation_set(plant)?)
}

pub(crate) fn van_der_pol(config: &TrainingConfig, ansatz: Ansatz, threads: usize) -> Trainer {
    begin(&VanDerPol::default(), &small(config, ansatz, threads)).unwrap()
}

/// Steps to the end, validating when due.
pub(crate) fn finish(trainer: &mut Trainer) -> (Vec<IterationRecord>, StopReason) {
    let mut records = Vec::new();
    loop {
        match trainer.step().unwrap() {
            Progress::Iterated(record) => records.push(record),
            Progress::Finished(reason) => return (records, reason),
        }
        if trainer.validation_due() {
            trainer.validate();
        }
    }
}

pub(crate) fn validation_of(net: &PincNet) -> Validation {
    let training = small(&training(vec![]), Ansatz::HardLinear, 1);
    training.validation_set(&VanDerPol::default()).unwrap().evaluate(net)
}
