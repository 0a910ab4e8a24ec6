//! The controller of a config, in batches.

use super::chosen::{Chosen, ModelFile};
use crate::RunError;
use pinc_batch::{LoopTrace, Loops, NmpcBatch};
use pinc_config::{ControlSpec, Experiment, ModelKind, Variables};
use pinc_mpc::Reference;
use pinc_ode::Simulator;

/// The controller of a config for many states at once, with the config's plant for closed loops.
#[derive(Debug)]
pub struct BatchController {
    batch: NmpcBatch,
    spec: ControlSpec,
    variables: Variables,
    plant: Simulator,
    /// Whether the config has an estimator.
    estimates: bool,
    command: &'static str,
}

impl BatchController {
    /// The controller of `experiment` with the net of `model`, or `only` one of the config's
    /// models, or else the first of them, on so many threads (0: one per core). `command` is named
    /// in errors.
    ///
    /// # Errors
    ///
    /// [`RunError`] if the controller cannot be made.
    pub fn new(
        experiment: &Experiment,
        model: Option<ModelFile<'_>>,
        only: Option<ModelKind>,
        threads: usize,
        command: &'static str,
    ) -> Result<Self, RunError> {
        let chosen = Chosen::of(experiment, model, only, command)?;
        let (setup, spec) = (chosen.setup(), chosen.spec);
        let make = || setup.judged_controller(chosen.kind, &*chosen.plant).map(|(nmpc, _)| nmpc);
        let batch = NmpcBatch::new(threads, make)?;
        Ok(Self {
            batch,
            plant: Simulator::new(setup.truth, spec.plant_tolerance),
            variables: Variables::of(&*chosen.plant),
            estimates: setup.sections().is_some(),
            spec: spec.clone(),
            command,
        })
    }

    /// The controllers.
    #[must_use]
    pub fn batch(&self) -> &NmpcBatch {
        &self.batch
    }

    /// The controllers, to be used.
    pub fn batch_mut(&mut self) -> &mut NmpcBatch {
        &mut self.batch
    }

    /// The section of the config.
    #[must_use]
    pub fn spec(&self) -> &ControlSpec {
        &self.spec
    }

    /// The plant's variables.
    #[must_use]
    pub fn variables(&self) -> &Variables {
        &self.variables
    }

    /// The input that was applied before the first step: the config's, or 0.
    #[must_use]
    pub fn initial_input(&self) -> Vec<f64> {
        let inputs = self.variables.input_names().len();
        self.spec.initial_input.clone().unwrap_or_else(|| vec![0.0; inputs])
    }

    /// Runs closed loops with the config's plant, whose states the controller sees.
    ///
    /// # Errors
    ///
    /// [`RunError::Usage`] if the config has an estimator, and the errors of
    /// [`NmpcBatch::loops`].
    pub fn loops(
        &mut self,
        x: &[f64],
        references: &[Reference],
        u_before: &[f64],
    ) -> Result<Vec<LoopTrace>, RunError> {
        if self.estimates {
            let problem = "loops in a batch use the measured states, but the config has a section \
                           `estimator`; leave it out";
            return Err(RunError::usage(format!("`{}`", self.command), problem));
        }
        let Self { batch, plant, spec, .. } = self;
        let plants = std::slice::from_ref(&*plant);
        Ok(batch.loops(Loops { x, references, plants, u_before, preview: spec.preview })?)
    }
}
