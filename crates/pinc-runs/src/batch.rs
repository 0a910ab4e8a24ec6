//! The controller of a config, in batches.

use super::chosen::{Chosen, ModelFile};
use crate::RunError;
use pinc_batch::{LoopTrace, Loops, NmpcBatch};
use pinc_config::{ControlSpec, CostSpec, Experiment, ModelKind, Variables};
use pinc_mpc::Reference;
use pinc_ode::Simulator;

/// The controller of a config for many states at once, with the config's plant for closed loops.
#[derive(Debug)]
pub struct BatchController {
    batch: NmpcBatch,
    spec: ControlSpec,
    variables: Variables,
    kind: ModelKind,
    plant: Simulator,
    parameter_names: Vec<String>,
    /// What the config's loop has and a loop of a batch does not.
    without: Option<&'static str>,
    command: &'static str,
}

impl BatchController {
    /// The controller of `experiment` with the net of `model`, or `only` one of the config's models, or else
    /// the first of them, on so many threads (0: one per core). `command` is named in errors.
    ///
    /// # Errors
    ///
    /// [`RunError`] if the controller cannot be made, or depends on when its loop began.
    pub fn new(
        experiment: &Experiment,
        model: Option<ModelFile<'_>>,
        only: Option<ModelKind>,
        threads: usize,
        command: &'static str,
    ) -> Result<Self, RunError> {
        let chosen = Chosen::of(experiment, model, only, command)?;
        let (setup, spec) = (chosen.setup(), chosen.spec);
        let of_a_loop = [
            ("control.bound_schedule", !spec.bound_schedule.is_empty()),
            ("control.first_plan", spec.first_plan.is_some()),
            ("control.target", spec.target),
            ("control.uncertainty", spec.uncertainty.is_some()),
            ("control.outside_domain = \"refuse\"", chosen.refuses_outside()),
        ];
        if let Some(key) = first(of_a_loop) {
            let problem = format!(
                "steps of a batch have no time, earlier plan, estimator or check of the domain, but the \
                 config has `{key}`"
            );
            return Err(RunError::usage(format!("`{command}`"), problem));
        }
        let make = || setup.judged_controller(chosen.kind, &*chosen.plant).map(|(nmpc, _)| nmpc);
        let batch = NmpcBatch::new(threads, make)?;
        Ok(Self {
            batch,
            plant: Simulator::new(setup.truth, spec.plant_tolerance),
            variables: Variables::of(&*chosen.plant),
            kind: chosen.kind,
            parameter_names: chosen.names_of_parameters(),
            without: first([
                ("control.estimator", setup.sections().is_some()),
                ("control.measured_parameters", !chosen.measured.is_empty()),
                ("control.plant", spec.plant.is_some()),
                ("control.plant_schedule", !spec.plant_schedule.is_empty()),
                ("control.loads", !spec.loads.is_empty()),
            ]),
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

    /// The controllers, for steps of their own.
    ///
    /// # Errors
    ///
    /// [`RunError::Usage`] if a step depends on when it is taken.
    pub fn for_steps(&mut self) -> Result<&mut NmpcBatch, RunError> {
        if self.spec.cost.as_ref().is_some_and(CostSpec::has_time) {
            let problem = "steps of a batch have no time, but `t` stands in [control.cost]";
            return Err(RunError::usage(format!("`{}`", self.command), problem));
        }
        Ok(&mut self.batch)
    }

    /// The controllers and the config's plant.
    pub fn parts(&mut self) -> (&mut NmpcBatch, &Simulator) {
        (&mut self.batch, &self.plant)
    }

    /// The section of the config.
    #[must_use]
    pub fn spec(&self) -> &ControlSpec {
        &self.spec
    }

    /// Which of the config's models it works with.
    #[must_use]
    pub fn kind(&self) -> ModelKind {
        self.kind
    }

    /// The names of the model's parameters p; with an estimator those of its unknowns.
    #[must_use]
    pub fn parameter_names(&self) -> &[String] {
        &self.parameter_names
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
    /// [`RunError::Usage`] if the config has an estimator, measured parameters, loads, or a plant that
    /// is not always the models', and the errors of [`NmpcBatch::loops`].
    pub fn loops(
        &mut self,
        x: &[f64],
        references: &[Reference],
        u_before: &[f64],
    ) -> Result<Vec<LoopTrace>, RunError> {
        if let Some(key) = self.without {
            let problem = format!(
                "loops in a batch have the models' plant and measure its states: remove `{key}`"
            );
            return Err(RunError::usage(format!("`{}`", self.command), problem));
        }
        let Self { batch, plant, spec, .. } = self;
        let plants = std::slice::from_ref(&*plant);
        Ok(batch.loops(Loops { x, references, plants, u_before, preview: spec.preview })?)
    }
}

/// The first key that is there.
pub(crate) fn first<const N: usize>(keys: [(&'static str, bool); N]) -> Option<&'static str> {
    keys.into_iter().find_map(|(key, is_there)| is_there.then_some(key))
}
