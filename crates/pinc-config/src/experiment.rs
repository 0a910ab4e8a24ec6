//! The types of a config file, and how one is read.

use crate::arrays::{self, AsWritten};
use crate::control::ControlSpec;
use crate::data::DataSpec;
use crate::identify::IdentifySpec;
use crate::model_kind::ModelKind;
use crate::one_step::OneStepSpec;
use crate::plant::PlantSpec;
use crate::plants::Plants;
use crate::prediction::PredictionSpec;
use crate::presets::Preset;
use crate::sweep::SweepSpec;
use crate::training::{Effort, TrainingSpec};
use crate::tune::TuneSpec;
use crate::{identified, net_weights, presets, sampled};
use pinc_expr::TimeUnit;
use pinc_mpc::Scenarios;
use pinc_net::{Domain, NetConfig, ValidationConfig};
use pinc_ode::Dims;
use pinc_toml::{ConfigError, Layers, Problem, assign, differences_of, first_not_finite};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::path::Path;
use toml::{Table, Value};

/// An experiment: a resolved config file, every value spelled out and checked.
///
/// The sections present say what is done: `training` (which needs `model`, `domain` and
/// `validation`, and may have `data`) trains a net, `prediction` lets it run freely, `control` puts
/// it into the loop.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Experiment {
    /// The name of the experiment and of its run directory.
    pub name: String,
    /// The reading of the paper, which sets the defaults of all sections.
    pub preset: Preset,
    /// The seed from which every random draw follows.
    pub seed: u64,
    /// The unit in which reports show times of the plant; if absent, the unit of the plant's equations, or
    /// else the unit that makes each time a small number. Keys and tables stay in seconds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_unit: Option<TimeUnit>,
    /// The plant, with its parameters.
    pub plant: PlantSpec,
    /// The architecture of the net.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub model: Option<NetConfig>,
    /// The box of states, inputs and parameters that the net is trained on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub domain: Option<Domain>,
    /// The training of the net.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub training: Option<TrainingSpec>,
    /// Measurements that the net is fitted to, beside the equation.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub data: Option<DataSpec>,
    /// The scenarios that the net is validated on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub validation: Option<ValidationConfig>,
    /// A free run of the net, for the report.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub prediction: Option<PredictionSpec>,
    /// The closed loop and its controller.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub control: Option<ControlSpec>,
    /// Measurements of the error and the time of one step of each model.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub one_step: Option<OneStepSpec>,
    /// The parameters and initial states that `pinc identify` finds in recorded data.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub identify: Option<IdentifySpec>,
    /// Many trials of the experiment, each with other values.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sweep: Option<SweepSpec>,
    /// What `pinc tune` may change, and the cost that it minimizes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tune: Option<TuneSpec>,
    /// The plants that the config may name, for the trials of a sweep.
    #[serde(skip)]
    plants: Plants,
    /// Lists for a plant with arrays and schedules as they were written, for the trials of a sweep.
    #[serde(skip)]
    as_written: AsWritten,
}

/// The parameters p of the models in a closed loop.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LoopParameters<'a> {
    /// Their names.
    pub names: Vec<&'a str>,
    /// Their values, or the initial estimates.
    pub values: Vec<f64>,
    /// The places of those that are estimated, in the order of the estimator.
    pub estimated: Vec<usize>,
    /// The places of those that are told: all, or with an estimator those measured or scheduled.
    pub known: Vec<usize>,
}

impl Experiment {
    /// Reads a config file with the overrides `sets`: `key.path=value`, as TOML, puts a value over
    /// its own, and `--unset key.path` takes a key away.
    /// Its plant is a built-in one, one of `plants`, or written in the file.
    ///
    /// # Errors
    ///
    /// [`ConfigError`], which says where, which key and what was expected.
    pub fn load(path: &Path, sets: &[String], plants: &Plants) -> Result<Self, ConfigError> {
        Self::parse(path, &read(path)?, sets, plants)
    }

    /// Like [`Experiment::load`], from the text of the file `path`.
    ///
    /// # Errors
    ///
    /// Like [`Experiment::load`].
    pub fn parse(
        path: &Path,
        text: &str,
        sets: &[String],
        plants: &Plants,
    ) -> Result<Self, ConfigError> {
        let mut layers = Layers::resolve(path, text, sets, presets::PRESETS)?;
        let experiment = Self::of_layers(&mut layers, path, plants)?;
        // Mistakes in the keys of another preset are found before it is chosen. What else is wrong
        // with it is not: nobody asked for it.
        for preset in layers.other_presets() {
            let sets = [sets, &[format!("preset={preset}")]].concat();
            let other = Layers::resolve(path, text, &sets, presets::PRESETS)
                .and_then(|mut layers| Self::of_layers(&mut layers, path, plants));
            match other {
                Err(ConfigError::Key { origin, key, problem })
                    if key.starts_with(&differences_of(preset)) =>
                {
                    return Err(ConfigError::Key { origin, key, problem });
                }
                Ok(_) | Err(_) => {}
            }
        }
        Ok(experiment)
    }

    fn of_layers(layers: &mut Layers, path: &Path, plants: &Plants) -> Result<Self, ConfigError> {
        let dir = path.parent().unwrap_or(Path::new(""));
        let weights = net_weights::read(&mut layers.table, dir);
        weights.map_err(|(key, problem)| layers.error(key, problem))?;
        if let Some((key, value)) = first_not_finite(&layers.table, &arrays::BOUNDS) {
            return Err(layers.error(key, Problem::NotFinite(value)));
        }
        arrays::in_one_order(layers)?;
        let experiment = Self::from_table(std::mem::take(&mut layers.table), plants);
        let mut experiment = experiment.map_err(|(key, problem)| layers.error(key, problem))?;
        path.clone_into(&mut experiment.as_written.file);
        Ok(experiment)
    }

    /// The file that it was read from, or else its name.
    #[must_use]
    pub fn source(&self) -> String {
        let file = self.as_written.file.display().to_string();
        if file.is_empty() { self.name.clone() } else { file }
    }

    /// Reads the resolved config of a finished run from the `text` of the file `path`. It was
    /// checked when it was run: neither its values nor its plant are looked at again. Keys that it
    /// lacks, since it is older than they are, have the values of its preset.
    ///
    /// # Errors
    ///
    /// Like [`Experiment::load`], of syntax, keys and types.
    pub fn read_back(path: &Path, text: &str) -> Result<Self, ConfigError> {
        let mut layers = Layers::resolve(path, text, &[], presets::PRESETS)?;
        let experiment = Self::deserialized(std::mem::take(&mut layers.table));
        experiment.map_err(|(key, problem)| layers.error(key, problem))
    }

    fn deserialized(table: Table) -> Result<Self, (String, Problem)> {
        serde_path_to_error::deserialize(Value::Table(table))
            .map_err(|error| pinc_toml::explain(&error))
    }

    /// The experiment of a resolved table, checked; or the key and what is wrong with its value.
    fn from_table(mut table: Table, plants: &Plants) -> Result<Self, (String, Problem)> {
        let schedules = sampled::write_out(&mut table)?;
        let lists: Vec<String> = schedules.iter().map(|(key, _)| format!("{key}[")).collect();
        Self::with_schedules(table, schedules, plants).map_err(|(key, problem)| {
            // The config has no such list, but what it was made from.
            let made = lists.iter().find(|list| key.starts_with(*list));
            (made.map_or(&*key, |list| &list[..list.len() - 1]).to_owned(), problem)
        })
    }

    fn with_schedules(
        mut table: Table,
        schedules: Vec<(String, Value)>,
        plants: &Plants,
    ) -> Result<Self, (String, Problem)> {
        identified::read(&mut table)?;
        let as_written = arrays::write_out(&mut table, plants)?.and(schedules);
        let mut experiment = Self::deserialized(table)?;
        experiment.as_written = as_written;
        experiment.plants = plants.clone();
        experiment.plant.bind(plants);
        let in_the_loop = experiment.control.as_mut().and_then(|control| control.plant.as_mut());
        if let Some(plant) = in_the_loop {
            plant.bind(plants);
        }
        experiment.share_parameters();
        experiment.time_unit = experiment.time_unit.or(experiment.plant.time_unit());
        experiment.validate()?;
        experiment.choose_optimizers();
        Ok(experiment)
    }

    /// The experiment as a table.
    pub(crate) fn to_table(&self) -> Table {
        Table::try_from(self).expect("the values have a form in TOML")
    }

    /// The experiment as a table, with lists for arrays and schedules as they were written.
    pub(crate) fn to_table_as_written(&self) -> Table {
        let mut table = self.to_table();
        self.as_written.restore(&mut table);
        table
    }

    /// The experiment of a table with other values for some keys, checked; or the key and what is wrong there.
    pub(crate) fn with_values<'a>(
        mut table: Table,
        plants: &Plants,
        values: impl IntoIterator<Item = (&'a str, Value)>,
    ) -> Result<Self, (String, Problem)> {
        for (key, value) in values {
            assign(&mut table, key, value).map_err(|path| {
                let expected = format!("a key that can be set: `{path}` has no such element");
                (key.to_owned(), Problem::Value { found: format!("`{key}`"), expected })
            })?;
        }
        Self::from_table(table, plants)
    }

    /// The plants that the config may name.
    pub(crate) fn plants(&self) -> &Plants {
        &self.plants
    }

    /// Validates a net of a family of plants over the family, unless the config says otherwise.
    fn share_parameters(&mut self) {
        if let (Some(domain), Some(validation)) = (&self.domain, &mut self.validation)
            && validation.domain.parameters.is_empty()
        {
            validation.domain.parameters.clone_from(&domain.parameters);
        }
    }

    /// The parameters that the net takes as inputs, by their names.
    #[must_use]
    pub fn varying(&self) -> Vec<&str> {
        let ranges = self.domain.iter().flat_map(|domain| &domain.parameters);
        ranges.map(|range| range.name.as_str()).collect()
    }

    /// The values that the models of the controller have for [`Experiment::varying`], in order.
    #[must_use]
    pub fn model_parameters(&self) -> Vec<f64> {
        let (nominal, truth) = (self.plant.parameters(), self.plant_in_the_loop().parameters());
        let own = self.control.as_ref().map(|control| &control.parameters);
        let measured = self.measured_parameters();
        let told = |name: &str| truth.get(name).filter(|_| measured.iter().any(|of| of == name));
        let own = |name: &str| own.and_then(|own| own.get(name));
        let value = |name: &str| told(name).or_else(|| own(name)).or_else(|| nominal.get(name));
        self.varying().into_iter().filter_map(|name| value(name).copied()).collect()
    }

    /// The parameters that the controller measures.
    #[must_use]
    pub fn measured_parameters(&self) -> &[String] {
        self.control.as_ref().map_or(&[], |control| &control.measured_parameters)
    }

    /// Whether parameters of the plant are trained with the net: the config then has those that the
    /// training begins with.
    #[must_use]
    pub fn trains_parameters(&self) -> bool {
        self.data.as_ref().is_some_and(|data| !data.parameters.is_empty())
    }

    /// The seed of the noise of the loop's sensors.
    #[must_use]
    pub fn noise_seed(&self) -> u64 {
        self.control.as_ref().and_then(|control| control.noise_seed).unwrap_or(self.seed)
    }

    /// The parameters of the models in the loop: those that vary, are estimated, or are uncertain.
    #[must_use]
    pub fn loop_parameters(&self) -> LoopParameters<'_> {
        let (mut names, mut values) = (self.varying(), self.model_parameters());
        let mut estimated = Vec::new();
        let estimator = self.control.as_ref().and_then(|control| control.estimator.as_ref());
        for parameter in estimator.into_iter().flat_map(|estimator| &estimator.parameters) {
            let place = names.iter().position(|name| *name == parameter.name);
            let place = place.unwrap_or_else(|| {
                names.push(&parameter.name);
                values.push(parameter.initial);
                names.len() - 1
            });
            values[place] = parameter.initial;
            estimated.push(place);
        }
        let nominal = self.plant.parameters();
        let control = self.control.as_ref();
        let branching = control.and_then(|of| of.scenarios.as_ref()).map(|of| of.values.keys());
        let uncertain =
            control.and_then(|of| of.uncertainty.as_ref()).map(|of| of.parameters.keys());
        for name in branching.into_iter().flatten().chain(uncertain.into_iter().flatten()) {
            if !names.contains(&name.as_str())
                && let Some(value) = nominal.get(name)
            {
                names.push(name);
                values.push(*value);
            }
        }
        let mut known: Vec<usize> = (0..names.len()).collect();
        known.retain(|&i| estimator.is_none() || control.is_some_and(|of| of.tells(names[i])));
        LoopParameters { names, values, estimated, known }
    }

    /// Whether the controller is told several values of a parameter.
    #[must_use]
    pub fn has_uncertain_parameters(&self) -> bool {
        self.control.as_ref().is_some_and(|control| {
            let intervals = control.uncertainty.as_ref().map(|of| &of.parameters);
            control.scenarios.is_some() || intervals.is_some_and(|of| !of.is_empty())
        })
    }

    /// The scenarios of the controller, if it has any, by the places of [`Experiment::loop_parameters`].
    #[must_use]
    pub fn scenarios(&self) -> Option<Scenarios> {
        let spec = self.control.as_ref()?.scenarios.as_ref()?;
        Some(spec.of(&self.loop_parameters().names, self.seed))
    }

    /// The dimensions of the plant, with the parameters that vary.
    ///
    /// # Panics
    ///
    /// As [`PlantSpec::dyn_plant`].
    #[must_use]
    pub fn dims(&self) -> Dims {
        self.plant.variables().dims().with_parameters(self.varying().len())
    }

    /// Makes the choices by the size of the net, so that what is used is what is written down.
    fn choose_optimizers(&mut self) {
        let Some(model) = self.model.as_ref().filter(|_| self.training.is_some()) else {
            return;
        };
        let weights = model.parameters(self.dims());
        let Some(training) = &mut self.training else { return };
        for phase in &mut training.config.phases {
            phase.optimizer = phase.optimizer.for_size(weights);
        }
    }

    /// The config as TOML with every value spelled out: loading it gives the same experiment.
    ///
    /// # Panics
    ///
    /// If the seed is 2^63 or more, which no TOML file can hold.
    #[must_use]
    pub fn to_toml(&self) -> String {
        toml::to_string(self).expect("the values have a form in TOML")
    }

    /// SHA-256 of the resolved config, in hexadecimal digits.
    ///
    /// # Panics
    ///
    /// Like [`Experiment::to_toml`].
    #[must_use]
    pub fn fingerprint(&self) -> String {
        sha256(self.to_toml())
    }

    /// The experiment without settings that change no number: threads, the interval of checkpoints,
    /// the unit in which times are shown, the identification and the tuning.
    #[must_use]
    pub fn normalized(&self) -> Self {
        let mut same = Self { time_unit: None, identify: None, tune: None, ..self.clone() };
        if let Some(training) = &mut same.training {
            let time_limit_s = training.effort.time_limit_s;
            training.effort = Effort { time_limit_s, ..Effort::default() };
        }
        same
    }

    /// Whether a trial of a sweep trains a net: not if all that it does takes numerical models.
    #[must_use]
    pub fn asks_for_a_net(&self) -> bool {
        let numerical = self.control.as_ref().is_some_and(|c| !c.models.contains(&ModelKind::Pinc));
        self.training.is_some() && (self.prediction.is_some() || !numerical)
    }

    /// The length T of a control step in s, where the config says it: the net's T, unless the
    /// stages of the horizon differ in length.
    #[must_use]
    pub fn sample_time_s(&self) -> Option<f64> {
        let stages = self.control.as_ref().and_then(|control| control.stages_s.as_ref());
        let first = stages.and_then(|stages| stages.first().copied());
        let model = self.model.as_ref().map(|m| m.sample_time_s);
        first.or(model).or_else(|| self.control.as_ref().and_then(|c| c.step_s))
    }

    /// The length in s of the step that the net is trained for, where the config says it; otherwise
    /// the length of a control step, unless the stages of the horizon differ in length.
    #[must_use]
    pub fn net_step_s(&self) -> Option<f64> {
        let has_stages = self.control.as_ref().is_some_and(|control| control.stages_s.is_some());
        let model = self.model.as_ref().map(|m| m.sample_time_s);
        model.or_else(|| self.sample_time_s().filter(|_| !has_stages))
    }
}

/// How many steps of `sample_time_s` a duration has, one at least; it was checked to be whole.
#[must_use]
pub fn steps(duration_s: f64, sample_time_s: f64) -> usize {
    step_at(duration_s, sample_time_s).max(1)
}

/// The step that begins at a time, 0 at the loop's beginning; the config was checked for one to begin there.
pub(crate) fn step_at(time_s: f64, sample_time_s: f64) -> usize {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "a number of steps that is not negative and fits into memory"
    )]
    let step = (time_s / sample_time_s).round() as usize;
    step
}

/// The text of a file.
pub(crate) fn read(path: &Path) -> Result<String, ConfigError> {
    std::fs::read_to_string(path)
        .map_err(|source| ConfigError::Unreadable { path: path.to_owned(), source })
}

/// SHA-256 in hexadecimal digits.
#[must_use]
pub fn sha256(bytes: impl AsRef<[u8]>) -> String {
    Sha256::digest(bytes).iter().map(|byte| format!("{byte:02x}")).collect()
}
