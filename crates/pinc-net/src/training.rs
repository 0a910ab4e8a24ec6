//! A whole training in one call.

use crate::{
    Domain, NetConfig, NetError, PincNet, StopReason, Totals, Trainer, TrainingConfig, Validation,
    ValidationConfig, ValidationSet,
};
use pinc_ode::DynRhs;

/// A training as a description: which net, on which domain, trained and validated how.
///
/// Others than the recommended settings are given by struct update:
///
/// ```
/// # use pinc_net::{Domain, NetConfig, Training};
/// # let (net, domain) = (NetConfig::new(0.5, 2, 10), Domain::new([-3.0..=3.0], [-1.0..=1.0]));
/// let training = Training { seed: 7, threads: 2, ..Training::new(net, domain) };
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Training {
    /// The net.
    pub net: NetConfig,
    /// The box of initial states and inputs that the net is trained on.
    pub domain: Domain,
    /// How it is trained.
    pub config: TrainingConfig,
    /// How it is validated.
    pub validation: ValidationConfig,
    /// All random numbers follow from it.
    pub seed: u64,
    /// Threads that share the work, 0 for one per core. The result does not depend on their number.
    pub threads: usize,
}

/// The result of a [`Training`].
#[derive(Clone, Debug, PartialEq)]
pub struct Trained {
    /// The net, selected as [`TrainingConfig::keep`] says.
    pub net: PincNet,
    /// Its errors, on scenarios that it was not chosen by ([`Training::test_set`]).
    pub validation: Validation,
    /// Why the training ended.
    pub stop_reason: StopReason,
    /// The work done.
    pub totals: Totals,
}

impl Training {
    /// A training with the recommended settings, seed 0 and one thread per core.
    ///
    /// It is validated over ten steps from random states of `domain`. Where trajectories from there
    /// leave the domain, give [`Training::validation`] a smaller box: outside, nets are inaccurate.
    #[must_use]
    pub fn new(net: NetConfig, domain: Domain) -> Self {
        let validation = ValidationConfig::new(10.0 * net.sample_time_s, domain.clone());
        Self { net, domain, config: TrainingConfig::recommended(), validation, seed: 0, threads: 0 }
    }

    /// The scenarios that the best net is chosen by, integrated accurately.
    ///
    /// # Errors
    ///
    /// [`NetError`] if a setting makes no sense or the plant cannot be integrated.
    pub fn validation_set(&self, plant: &dyn DynRhs) -> Result<ValidationSet, NetError> {
        let (sample_time_s, config) = (self.net.sample_time_s, &self.validation);
        match &self.net.time_only {
            Some(scenario) => ValidationSet::of_scenario(plant, sample_time_s, config, scenario),
            None => ValidationSet::generate(plant, sample_time_s, config, self.seed),
        }
    }

    /// The scenarios that the net which was kept is judged by: others of the same kind, from the
    /// same seed. A conventional PINN has but one scenario.
    ///
    /// # Errors
    ///
    /// As [`Training::validation_set`].
    pub fn test_set(&self, plant: &dyn DynRhs) -> Result<ValidationSet, NetError> {
        match &self.net.time_only {
            Some(_) => self.validation_set(plant),
            None => {
                let (sample_time_s, config) = (self.net.sample_time_s, &self.validation);
                ValidationSet::generate_test(plant, sample_time_s, config, self.seed)
            }
        }
    }

    /// Trains a net for `plant`. To watch the progress, or to be able to interrupt the training,
    /// use a [`Trainer`].
    ///
    /// # Errors
    ///
    /// [`NetError`] if a setting makes no sense, the plant has no finite value in the domain or
    /// cannot be integrated, the threads cannot be started, or the loss becomes NaN or infinite.
    pub fn run(&self, plant: &dyn DynRhs) -> Result<Trained, NetError> {
        let validation = self.validation_set(plant)?;
        let mut trainer = Trainer::new(plant, self, validation)?;
        let stop_reason = trainer.run()?;
        let net = trainer.net();
        let validation = self.test_set(plant)?.evaluate(&net);
        Ok(Trained { net, validation, stop_reason, totals: trainer.totals() })
    }
}
