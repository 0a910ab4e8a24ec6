//! The content of `metrics.json`, each section with its rows in the table of metrics.

pub(crate) mod control;
pub(crate) mod net;
pub(crate) mod one_step;

use crate::error::RecordError;
use crate::files::{file, read_json};
use crate::verdict::significant;
use pinc_config::{Experiment, ModelKind, Preset, TimeUnit};
use pinc_net::TrainingTarget;
use serde::{Deserialize, Deserializer, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

pub use control::{
    ControlMetrics, CostMetrics, EstimatorMetrics, FirstPlanMetrics, ModelErrorMetrics,
    ReferenceMetrics, TubeMetrics, is_failure,
};
pub use net::{PredictionMetrics, TrainingMetrics, ValidationMetrics};
pub use one_step::{OneStepMetrics, StepErrors};

/// The numbers that a run gave; each section is there once its stage is done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// The experiment's name.
    pub experiment: String,
    /// The reading of the paper.
    pub preset: Preset,
    /// The units of the plant's variables by name; empty for a number without dimension.
    pub variables: BTreeMap<String, String>,
    /// The unit in which times of the plant are shown, if the config says one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_unit: Option<TimeUnit>,
    /// The plant's states, in its order.
    #[serde(default)]
    pub states: Vec<String>,
    /// The files with results.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub files: BTreeMap<String, FileNote>,
    /// Its inputs.
    #[serde(default)]
    pub inputs: Vec<String>,
    /// The training.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub training: Option<TrainingMetrics>,
    /// The validation of the net that was kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub validation: Option<ValidationMetrics>,
    /// The free run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prediction: Option<PredictionMetrics>,
    /// Whether the net in the loops was trained on an integrator's steps.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub distilled: bool,
    /// The closed loops.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub control: Vec<ControlMetrics>,
    /// One step of each model by itself.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub one_step: Vec<OneStepMetrics>,
    /// The trials of a sweep.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sweep: Option<SweepMetrics>,
}

/// The title of a net that was trained on an integrator's steps.
pub const DISTILLED: &str = "distilled net";

impl Metrics {
    /// Whether any stage has left numbers.
    #[must_use]
    pub fn has_results(&self) -> bool {
        let of_net = self.training.is_some() || self.validation.is_some();
        let of_loops = !(self.control.is_empty() && self.one_step.is_empty());
        of_net || of_loops || self.prediction.is_some() || self.sweep.is_some()
    }

    /// No results yet of `experiment`.
    #[must_use]
    pub fn new(experiment: &Experiment) -> Self {
        let variables = experiment.plant.variables();
        let outputs = variables.own_outputs().into_iter().map(|(_, output)| output);
        let all = variables.states.iter().chain(&variables.inputs).chain(outputs);
        let units = all.map(|v| (v.name.to_string(), v.unit.to_string())).collect();
        Self {
            variables: units,
            time_unit: experiment.time_unit,
            states: variables.state_names(),
            files: BTreeMap::new(),
            inputs: variables.input_names(),
            experiment: experiment.name.clone(),
            preset: experiment.preset,
            training: None,
            validation: None,
            prediction: None,
            distilled: false,
            control: Vec::new(),
            one_step: Vec::new(),
            sweep: None,
        }
    }
}

impl Metrics {
    /// The metrics of the run in `dir`; `None` if it has none yet.
    ///
    /// # Errors
    ///
    /// [`RecordError`] if the file cannot be read or is damaged.
    pub fn read(dir: &Path) -> Result<Option<Self>, RecordError> {
        read_json(&dir.join(file::METRICS))
    }

    /// The closed loop with a model, if it was run.
    #[must_use]
    pub fn loop_with(&self, model: ModelKind) -> Option<&ControlMetrics> {
        self.control.iter().find(|of| of.model == model)
    }

    /// One step of a model, if it was measured.
    #[must_use]
    pub fn step_of(&self, model: ModelKind) -> Option<&OneStepMetrics> {
        self.one_step.iter().find(|of| of.model == model)
    }

    /// What a user must know of a net that is badly wrong somewhere in its domain.
    #[must_use]
    pub fn domain_finding(&self) -> Option<String> {
        let training = self.training.as_ref();
        let losses = training.and_then(|training| training.loss.zip(training.fresh_loss));
        let validation = self.validation.as_ref()?;
        // Data may have corrected the equation that this error is of.
        let judged =
            validation.domain_error.as_ref().filter(|_| validation.measured_mse.is_none())?;
        judged.finding([&self.states, &self.inputs], losses)
    }

    /// Whether the net was trained on an integrator's steps.
    #[must_use]
    pub fn is_distilled(&self) -> bool {
        let is_trained = |t: &TrainingMetrics| t.source == TrainingTarget::Integrator;
        self.distilled || self.training.as_ref().is_some_and(is_trained)
    }

    /// The title of a model in the loops, which tells distilled nets from others.
    #[must_use]
    pub fn title_of(&self, model: ModelKind) -> &'static str {
        match self.is_distilled() && model == ModelKind::Pinc {
            true => DISTILLED,
            false => model.title(),
        }
    }
}

/// The state of a file when it was written.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileNote {
    /// Its size.
    pub bytes: u64,
    /// Its SHA-256, unless it is large.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
}

/// How far a sweep is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SweepMetrics {
    /// All trials.
    pub trials: usize,
    /// Those that ended as they should.
    pub done: usize,
    /// Those that ended with an error.
    pub failed: usize,
    /// Those that a search has dropped before they were run.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub dropped: usize,
    /// The models whose loop broke a bound in some trials that are done.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub broken_bounds: Vec<BrokenBounds>,
    /// The best candidate of a search, in words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub best: Option<String>,
}

/// The trials of a sweep in which a loop broke a bound, hard or not, by more than rounding.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct BrokenBounds {
    /// The model.
    pub model: ModelKind,
    /// How many there are.
    pub trials: usize,
}

impl SweepMetrics {
    /// What went wrong in the loops of trials that are done, in words.
    #[must_use]
    pub fn loop_notes(&self) -> Vec<String> {
        let note = |BrokenBounds { model, trials }: &BrokenBounds| {
            let (title, name, done) = (model.title(), model.name(), self.done);
            format!(
                "With {title} a bound was broken in {trials} of {done} trials: column \
                 `{name}_max_violation` of sweep.csv."
            )
        };
        self.broken_bounds.iter().map(note).collect()
    }

    /// Those that are still to be run.
    #[must_use]
    pub fn pending(&self) -> usize {
        self.trials - self.done - self.failed - self.dropped
    }
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}

fn nan() -> f64 {
    f64::NAN
}

/// A number; JSON has `null` in place of NaN and infinity.
pub(crate) fn number_or_null<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::NAN))
}

/// How often and how far a net was used outside the box that it was trained on, where it is wrong.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct OutsideDomain {
    /// How many steps were looked at: their initial state and input.
    pub samples: usize,
    /// In how many of them a variable was outside.
    pub outside: usize,
    /// The variables that were, by name.
    pub variables: BTreeMap<String, Excess>,
}

/// How one variable left the box.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Excess {
    /// In how many steps.
    pub samples: usize,
    /// The largest distance from the box, in the variable's unit.
    pub farthest: f64,
}

impl OutsideDomain {
    /// Adds a step with these variables outside, each with its distance from the box.
    pub fn add(&mut self, excesses: impl IntoIterator<Item = (String, f64)>) {
        self.samples += 1;
        let mut outside = false;
        for (name, excess) in excesses {
            outside = true;
            let nothing = Excess { samples: 0, farthest: 0.0 };
            let of = self.variables.entry(name).or_insert(nothing);
            of.samples += 1;
            of.farthest = of.farthest.max(excess);
        }
        self.outside += usize::from(outside);
    }

    /// What to make of it where a net stands for the plant along recorded data; `None` if it was never
    /// outside.
    #[must_use]
    pub fn note(&self) -> Option<String> {
        (self.outside > 0).then(|| {
            format!(
                "{self}; the net's errors there look like another plant: train it on a larger \
                 [domain], or take an integrator (--only rk4)"
            )
        })
    }
}

impl std::fmt::Display for OutsideDomain {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "outside the training domain in {} of {} steps", self.outside, self.samples)?;
        for (i, (name, excess)) in self.variables.iter().enumerate() {
            let separator = if i == 0 { ": " } else { ", " };
            write!(
                f,
                "{separator}{name} by up to {} ({} steps)",
                significant(excess.farthest),
                excess.samples
            )?;
        }
        Ok(())
    }
}
