//! A training without a run directory, watched by its caller.

use super::TrainingSetup;
use crate::RunError;
use pinc_config::Experiment;
use pinc_net::{PincNet, Progress, Totals, Validation};
use std::ops::ControlFlow;
use std::time::Instant;

/// How far a training is.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct TrainingProgress {
    /// Iterations done.
    pub iteration: u64,
    /// How many there are at most.
    pub iterations: u64,
    /// Time since the training began, in s.
    pub elapsed_s: f64,
    /// The loss.
    pub loss: f64,
    /// The last validation's `mse_gen`, if there has been one.
    pub validation_mse: Option<f64>,
}

/// The result of [`train_watched`].
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct TrainedNet {
    /// The net.
    pub net: PincNet,
    /// Its errors, on scenarios that it was not chosen by.
    pub validation: Validation,
    /// Why the training ended; `stopped` if the caller stopped it.
    pub stop_reason: String,
    /// The work done.
    pub totals: Totals,
    /// How long the training took, in s.
    pub wall_s: f64,
}

/// Trains the net of `experiment` and shows `watch` every iteration, which may stop the training;
/// the net is then the best so far. The net equals [`train`](crate::train)'s, which also writes a
/// run directory and can be resumed.
///
/// # Errors
///
/// [`RunError`] if the config has no training, asks for a proof, or the training fails.
pub fn train_watched(
    experiment: &Experiment,
    mut watch: impl FnMut(&TrainingProgress) -> ControlFlow<()>,
) -> Result<TrainedNet, RunError> {
    let begun = Instant::now();
    let elapsed_s = || begun.elapsed().as_secs_f64();
    let setup = TrainingSetup::of(experiment)?;
    if !setup.training.proven_tolerance.is_empty() {
        let problem = "training.proven_tolerance needs a run directory: use `pinc train`, or \
                       `pinc.run` in Python";
        return Err(RunError::usage(&experiment.name, problem));
    }
    let plant = &*experiment.plant.family(&experiment.varying());
    let (inputs, test) = setup.inputs(plant, experiment)?;
    let mut trainer = inputs.trainer(setup.threads())?;
    let limit_s = setup.training.effort.time_limit_s.unwrap_or(f64::INFINITY);
    let mut validation_mse = None;
    let stop_reason = loop {
        if elapsed_s() >= limit_s {
            break "time-limit".to_owned();
        }
        let iterated = match trainer.step()? {
            Progress::Finished(reason) => break reason.to_string(),
            Progress::Iterated(iterated) => iterated,
        };
        if trainer.validation_due() {
            validation_mse = Some(trainer.validate().mse_gen);
        }
        let progress = TrainingProgress {
            iteration: iterated.iteration,
            iterations: inputs.iterations(),
            elapsed_s: elapsed_s(),
            loss: iterated.loss,
            validation_mse,
        };
        if watch(&progress).is_break() {
            break "stopped".to_owned();
        }
    };
    // The last net too may be the best.
    if trainer.validation_due() {
        trainer.validate();
    }
    let net = trainer.net();
    let found = setup.found(experiment, &inputs.estimates(&trainer))?;
    let validation = found.map_or(test, |found| found.test).evaluate(&net);
    let totals = trainer.totals();
    Ok(TrainedNet { net, validation, stop_reason, totals, wall_s: elapsed_s() })
}
