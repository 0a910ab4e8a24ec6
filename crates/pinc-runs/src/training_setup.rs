//! The parts of a training: sections of the config, the plant, and recorded data.

use super::data::{self, Data};
use crate::RunError;
use crate::invocation::cores;
use pinc_config::{DataSpec, Experiment, TrainingSpec};
use pinc_net::{
    Domain, Measurements, NetConfig, Trainer, Training, ValidationConfig, ValidationSet,
};
use pinc_ode::DynPlant;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// The sections that a training needs.
#[derive(Debug)]
pub struct TrainingSetup<'a> {
    /// `[model]`
    pub net: &'a NetConfig,
    /// `[domain]`
    pub domain: &'a Domain,
    /// `[training]`
    pub training: &'a TrainingSpec,
    /// `[validation]`
    pub validation: &'a ValidationConfig,
    data: Option<&'a DataSpec>,
}

impl<'a> TrainingSetup<'a> {
    /// Returns the setup of the experiment.
    ///
    /// # Errors
    ///
    /// [`RunError`] if a section is missing.
    pub fn of(experiment: &'a Experiment) -> Result<Self, RunError> {
        let missing = |section| RunError::missing_section(experiment, section, "training");
        Ok(Self {
            net: experiment.model.as_ref().ok_or_else(|| missing("model"))?,
            domain: experiment.domain.as_ref().ok_or_else(|| missing("domain"))?,
            training: experiment.training.as_ref().ok_or_else(|| missing("training"))?,
            validation: experiment.validation.as_ref().ok_or_else(|| missing("validation"))?,
            data: experiment.data.as_ref(),
        })
    }

    /// What a trainer is made from, and the scenarios that its net is judged by.
    pub(super) fn inputs<'p>(
        &self,
        plant: &'p dyn DynPlant,
        experiment: &Experiment,
    ) -> Result<(TrainerInputs<'p>, ValidationSet), RunError> {
        let training = self.training(experiment.seed);
        let (mut validation, mut test) =
            (training.validation_set(plant)?, training.test_set(plant)?);
        if let Some(held_out) = self.measured(experiment, |data| &data.held_out)? {
            validation = validation.with_measurements(held_out.measurements.clone());
            test = test.with_measurements(held_out.measurements);
        }
        let measured = self.measured(experiment, |data| &data.files)?;
        measured.iter().for_each(|data| self.warn_outside(&data.measurements));
        let weight = self.data.map_or(0.0, |data| data.weight);
        let unknown = self.data.filter(|data| !data.parameters.is_empty());
        let unknown = unknown.map(|data| Unknown::of(experiment, &data.parameters));
        Ok((TrainerInputs { plant, training, validation, measured, weight, unknown }, test))
    }

    /// The plant with the parameters that were trained with the net, if any were, and the scenarios of it.
    pub(super) fn found(
        &self,
        experiment: &Experiment,
        parameters: &BTreeMap<String, f64>,
    ) -> Result<Option<IdentifiedPlant>, RunError> {
        if parameters.is_empty() {
            return Ok(None);
        }
        let plant = experiment.plant.with_parameters(parameters).dyn_plant();
        let test = self.training(experiment.seed).test_set(&*plant)?;
        Ok(Some(IdentifiedPlant { plant, test }))
    }

    /// The threads that the config gives.
    pub(super) fn threads(&self) -> usize {
        match self.training.effort.threads {
            0 => cores(),
            threads => threads,
        }
    }

    /// The training that they describe, on one thread.
    fn training(&self, seed: u64) -> Training {
        Training {
            net: self.net.clone(),
            domain: self.domain.clone(),
            config: self.training.config.clone(),
            validation: self.validation.clone(),
            seed,
            threads: 1,
        }
    }

    /// Says where measurements alone hold the net.
    fn warn_outside(&self, measured: &Measurements) {
        let points = measured.points();
        let excess = |k: usize| self.domain.excess(points.state(k), points.input(k), &[]);
        let outside = (0..measured.len()).filter(|k| excess(*k).any(|off| off > 0.0)).count();
        if outside > 0 {
            let of = measured.len();
            tracing::warn!(
                "data.files: {outside} of {of} points lie outside [domain], where the equation \
                 is not asked for"
            );
        }
    }

    /// Reads the files of `[data]`; an error names the file and what is wrong with it.
    pub(super) fn check_files(&self, experiment: &Experiment) -> Result<(), RunError> {
        self.measured(experiment, |data| &data.files)?;
        self.measured(experiment, |data| &data.held_out).map(drop)
    }

    /// What is in some of the files of `[data]`, if there are any.
    fn measured(
        &self,
        experiment: &Experiment,
        files: impl Fn(&DataSpec) -> &Vec<PathBuf>,
    ) -> Result<Option<Data>, RunError> {
        let files = self.data.map(files).filter(|files| !files.is_empty());
        let variables = experiment.plant.variables();
        files.map(|files| data::read(&variables, self.net.sample_time_s, files)).transpose()
    }
}

/// The plant with the parameters that were trained with the net, and scenarios of it.
pub(super) struct IdentifiedPlant {
    pub(super) plant: Box<dyn DynPlant>,
    pub(super) test: ValidationSet,
}

/// What a trainer is made from.
pub(super) struct TrainerInputs<'a> {
    plant: &'a dyn DynPlant,
    training: Training,
    validation: ValidationSet,
    pub(super) measured: Option<Data>,
    /// The weight of the measurements.
    weight: f64,
    unknown: Option<Unknown>,
}

/// Parameters of the plant that are trained with the net.
struct Unknown {
    names: Vec<String>,
    /// Where they start.
    start: Vec<f64>,
    /// The plant in which they are the p of f(x, u, p).
    family: Box<dyn DynPlant>,
}

impl Unknown {
    fn of(experiment: &Experiment, names: &[String]) -> Self {
        let nominal = experiment.plant.parameters();
        let varying: Vec<&str> = names.iter().map(String::as_str).collect();
        Self {
            names: names.to_vec(),
            start: names.iter().map(|name| nominal[name]).collect(),
            family: experiment.plant.family(&varying),
        }
    }
}

impl TrainerInputs<'_> {
    /// How many iterations a training has at most.
    pub(super) fn iterations(&self) -> u64 {
        self.training.config.phases.iter().map(|phase| phase.iterations).sum()
    }

    /// A trainer at the beginning.
    pub(super) fn trainer(&self, threads: usize) -> Result<Trainer, RunError> {
        let training = Training { threads, ..self.training.clone() };
        let mut trainer = Trainer::new(self.plant, &training, self.validation.clone())?;
        if let Some(unknown) = &self.unknown {
            trainer = trainer.with_unknown(&*unknown.family, &unknown.start)?;
        }
        Ok(match &self.measured {
            Some(data) => trainer.with_measurements(&data.measurements, self.weight)?,
            None => trainer,
        })
    }

    /// The parameters that are trained with the net, as far as they have come.
    pub(super) fn estimates(&self, trainer: &Trainer) -> BTreeMap<String, f64> {
        let names = self.unknown.iter().flat_map(|unknown| &unknown.names).cloned();
        names.zip(trainer.estimates()).collect()
    }
}
