//! A net for the Van der Pol oscillator, trained on its equation alone and judged by an accurate integration.
//!
//! `cargo run --release -p pinc-net --example 01_train`
#![expect(clippy::print_stdout, reason = "an example shows what it computes")]

use pinc_net::optim::{OptimizerConfig, SelfScaledBroydenConfig};
use pinc_net::{
    Ansatz, Domain, InitialScale, NetConfig, NetError, Phase, PincNet, Progress, ResidualScale,
    Sampler, SelectNet, Trainer, TrainingConfig, TrainingTarget, ValidationConfig, ValidationSet,
};
use pinc_plants::VanDerPol;

/// Two layers of 16 neurons that predict up to T = 0.5 s ahead.
pub(crate) fn net() -> NetConfig {
    NetConfig {
        sample_time_s: 0.5,
        hidden_layers: 2,
        neurons: 16,
        ansatz: Ansatz::HardLinear,
        time_only: None,
    }
}

/// The box of initial states and inputs that the net is to be good for.
pub(crate) fn domain() -> Domain {
    Domain {
        state_low: vec![-3.0, -4.35],
        state_high: vec![3.0, 4.35],
        input_low: vec![-1.0],
        input_high: vec![1.0],
    }
}

/// 1000 iterations of a quasi-Newton method on 2048 points of the box.
pub(crate) fn training() -> TrainingConfig {
    let optimizer = OptimizerConfig::SelfScaledBroyden(SelfScaledBroydenConfig {
        initial_step: 0.1,
        gradient_tolerance: 1e-14,
    });
    TrainingConfig {
        source: TrainingTarget::Physics,
        sampler: Sampler::Sobol,
        collocation_points: 2048,
        initial_points: 1,
        lambda: 1.0,
        residual_scale: ResidualScale::Normalized,
        initial_scale: InitialScale::Normalized,
        phases: vec![Phase { optimizer, iterations: 1000, restore_best: false }],
        growth: None,
        validation_every: 200,
        keep: SelectNet::Best,
        target_one_step_rms: None,
    }
}

/// Scenarios of 5 s from initial states of a smaller box, in which their trajectories stay.
pub(crate) fn validation(plant: &VanDerPol) -> Result<ValidationSet, NetError> {
    let scenarios = ValidationConfig {
        scenarios: 2,
        duration_s: 5.0,
        subintervals: 1,
        domain: Domain { state_low: vec![-2.0; 2], state_high: vec![2.0; 2], ..domain() },
        tolerance: 1e-10,
        one_step_points: 100,
    };
    ValidationSet::generate(plant, net().sample_time_s, &scenarios, 1)
}

/// The net, trained on one thread with seed 0.
pub(crate) fn trained() -> Result<PincNet, NetError> {
    let plant = VanDerPol::default();
    let validation = validation(&plant)?;
    let mut trainer = Trainer::new(&plant, &net(), &domain(), &training(), validation, 0, 1)?;
    while let Progress::Iterated(record) = trainer.step()? {
        if trainer.validation_due() {
            let rms = trainer.validate().one_step_mse.sqrt();
            println!(
                "iteration {:4}: loss {:.2e}, error of a step {rms:.2e}",
                record.iteration, record.loss
            );
        }
    }
    Ok(trainer.net())
}

pub(crate) fn main() -> Result<(), NetError> {
    let net = trained()?;
    let errors = validation(&VanDerPol::default())?.evaluate(&net);
    println!(
        "{} weights; over 5 s, fed with itself: mse {:.2e}",
        net.mlp().parameters().len(),
        errors.mse_gen
    );
    assert!(errors.one_step_mse < 1e-3 && errors.mse_gen < 1e-2);
    Ok(())
}
