//! The content of `metrics.json`.

use crate::domain_error::{DomainErrorMetrics, DomainFinding};
use crate::error::RecordError;
use crate::files::{file, read_json};
use crate::times::{StepTimes, WallTimes};
use crate::violation::ViolationMetrics;
use pinc_config::{Experiment, ModelKind, Preset, TimeUnit};
use pinc_mpc::SqpStatus;
use pinc_net::{TrainingTarget, Validation};
use serde::{Deserialize, Deserializer, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

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

impl Metrics {
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

    /// Whether the net is badly wrong somewhere in its domain.
    #[must_use]
    pub fn domain_finding(&self) -> Option<DomainFinding> {
        let validation = self.validation.as_ref()?;
        let finding = validation.domain_error.as_ref()?.finding(&self.states, &self.inputs)?;
        let training = self.training.as_ref();
        let losses = training.and_then(|training| training.loss.zip(training.fresh_loss));
        Some(match losses {
            Some((loss, fresh)) => finding.of_training(loss, fresh),
            None => finding,
        })
    }

    /// Whether the net was trained on an integrator's steps.
    #[must_use]
    pub fn is_distilled(&self) -> bool {
        self.training.as_ref().is_some_and(|t| t.source == TrainingTarget::Integrator)
    }
}

/// What a file was when it was written.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileNote {
    /// Its size.
    pub bytes: u64,
    /// Its SHA-256, unless it is large.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
}

/// One step of a model by itself.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OneStepMetrics {
    /// The model.
    pub model: ModelKind,
    /// How wrong it is over the domain.
    #[serde(flatten)]
    pub errors: StepErrors,
    /// Time of a step in ns, each waiting for the one before.
    pub forward_ns: f64,
    /// Time of a step with both Jacobians in ns, of as many at a time as the controller's horizon
    /// has.
    pub forward_jacobian_ns: f64,
}

/// How wrong one step is, over points that fill a domain. States are measured in widths of the
/// domain; the error at a point is the root mean square over the states. Not finite where a step is
/// not.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepErrors {
    /// Root mean square over the points.
    #[serde(deserialize_with = "number_or_null")]
    pub rms: f64,
    /// Median over the points.
    #[serde(deserialize_with = "number_or_null")]
    pub median: f64,
    /// 99th percentile over the points.
    #[serde(deserialize_with = "number_or_null")]
    pub p99: f64,
    /// The largest of the points.
    #[serde(default = "nan", deserialize_with = "number_or_null")]
    pub max: f64,
    /// Root mean square, over points and entries, of the errors of the Jacobians A and B, in widths
    /// of the domain per width.
    #[serde(deserialize_with = "number_or_null")]
    pub jacobian_rms: f64,
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
    /// The best candidate of a search, in words.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub best: Option<String>,
}

impl SweepMetrics {
    /// Those that are still to be run.
    #[must_use]
    pub fn pending(&self) -> usize {
        self.trials - self.done - self.failed - self.dropped
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde calls it with a reference")]
fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// How good the net that was kept is, on scenarios that it was not chosen by.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ValidationMetrics {
    /// Eq. (`mse_gen`) of the paper: self-loop, at the steps t = kT, in the states' units squared.
    #[serde(deserialize_with = "number_or_null")]
    pub mse_gen: f64,
    /// As the authors' program has it: self-loop, at all rows, in standard deviations of the box.
    #[serde(deserialize_with = "number_or_null")]
    pub mse_all_normalized: f64,
    /// Of one step from random points of the box, in the states' units squared.
    #[serde(deserialize_with = "number_or_null")]
    pub one_step_mse: f64,
    /// `mse_gen` with each state in standard deviations of the box.
    #[serde(default = "nan", deserialize_with = "number_or_null")]
    pub mse_gen_normalized: f64,
    /// On held-out measurements, each state in standard deviations of the box: the best net was
    /// chosen by it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured_mse: Option<f64>,
    /// Of one step from all over the training domain; not there for a conventional PINN.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub domain_error: Option<DomainErrorMetrics>,
}

impl ValidationMetrics {
    /// These errors of a net, and its error over the domain if there is one.
    #[must_use]
    pub fn new(validation: &Validation, domain_error: Option<DomainErrorMetrics>) -> Self {
        Self {
            mse_gen: validation.mse_gen,
            mse_all_normalized: validation.mse_all_normalized,
            one_step_mse: validation.one_step_mse,
            mse_gen_normalized: validation.mse_gen_normalized,
            measured_mse: validation.measured_mse,
            domain_error,
        }
    }
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

impl std::fmt::Display for OutsideDomain {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "outside the training domain in {} of {} steps", self.outside, self.samples)?;
        for (i, (name, excess)) in self.variables.iter().enumerate() {
            let separator = if i == 0 { ": " } else { ", " };
            write!(
                f,
                "{separator}{name} by up to {:.3} ({} steps)",
                excess.farthest, excess.samples
            )?;
        }
        Ok(())
    }
}

/// What a training took.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrainingMetrics {
    /// What the net was trained on.
    #[serde(default)]
    pub source: TrainingTarget,
    /// Wall time of the whole stage in s, with validation and files.
    pub wall_s: f64,
    /// Wall time of the optimizer alone in s: the last `elapsed_s` of `training.csv`.
    #[serde(default)]
    pub optimizer_s: f64,
    /// Iterations over all phases.
    pub iterations: u64,
    /// Evaluations of the loss and its gradient.
    pub loss_evaluations: u64,
    /// Why it ended.
    pub stop_reason: String,
    /// The loss in the last iteration, where it was looked at on fresh points.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub loss: Option<f64>,
    /// The loss on points that the net was not trained on, then.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fresh_loss: Option<f64>,
    /// The parameters of the plant that were trained with the net.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub parameters: BTreeMap<String, f64>,
}

/// How good the free run is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PredictionMetrics {
    /// Mean squared error at the step marks t = kT, in physical units.
    #[serde(deserialize_with = "number_or_null")]
    pub mse_marks: f64,
    /// Mean squared error over all rows but the initial state, in physical units.
    #[serde(deserialize_with = "number_or_null")]
    pub mse_all: f64,
    /// Whether the net was used outside its training domain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outside_domain: Option<OutsideDomain>,
}

/// How good one closed loop is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ControlMetrics {
    /// The model inside the controller.
    pub model: ModelKind,
    /// RMSE as printed: at the steps.
    #[serde(deserialize_with = "number_or_null")]
    pub rmse: f64,
    /// IAE as printed: at the steps, averaged over outputs.
    #[serde(deserialize_with = "number_or_null")]
    pub iae: f64,
    /// RMSE on the dense trace.
    #[serde(deserialize_with = "number_or_null")]
    pub rmse_dense: f64,
    /// IAE on the dense trace, summed over outputs.
    #[serde(deserialize_with = "number_or_null")]
    pub iae_dense_sum: f64,
    /// Time of the controller in one whole closed loop.
    pub wall_s: WallTimes,
    /// Time of the controller in one step.
    pub step_us: StepTimes,
    /// SQP iterations per step.
    pub sqp_iterations_mean: f64,
    /// The largest KKT residual of a step.
    #[serde(deserialize_with = "number_or_null")]
    pub kkt_max: f64,
    /// The worst violation of a bound by the plant's state, input or output: the largest number,
    /// whatever its unit.
    #[serde(deserialize_with = "number_or_null")]
    pub max_violation: f64,
    /// Which bound that is; not there if none was broken.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_violation_of: Option<ViolationMetrics>,
    /// The bounds that were broken, each with its worst violation.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub violations: Vec<ViolationMetrics>,
    /// How many steps ended with which status.
    pub status: BTreeMap<String, usize>,
    /// Whether the references were reached.
    #[serde(flatten)]
    pub references: ReferenceMetrics,
    /// Whether the net was used outside its training domain; not there for other models.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outside_domain: Option<OutsideDomain>,
    /// How good the estimates were, where the controller was told of estimates.
    #[serde(flatten)]
    pub estimator: Option<EstimatorMetrics>,
}

/// How good the estimates of a closed loop are, and whether the estimator is as sure of itself as
/// it may be.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EstimatorMetrics {
    /// The mean of the normalized innovations squared, over the steps that have one.
    #[serde(deserialize_with = "number_or_null")]
    pub nis_mean: f64,
    /// What it is of a consistent estimator: the mean number of measurements used in these steps.
    #[serde(default = "nan", deserialize_with = "number_or_null")]
    pub nis_expected: f64,
    /// How many steps have one.
    #[serde(default)]
    pub nis_steps: usize,
    /// How many steps have none although there were measurements to use.
    #[serde(default)]
    pub nis_undefined: usize,
    /// The mean of the normalized errors squared: of a consistent estimator, the number of states.
    #[serde(deserialize_with = "number_or_null")]
    pub nees_mean: f64,
    /// How many steps have one: the others have a singular covariance.
    #[serde(default)]
    pub nees_steps: usize,
    /// How many measurements of each quantity the estimator's gate rejected, where it rejected any.
    #[serde(default)]
    pub rejected: BTreeMap<String, usize>,
    /// The root mean square error of each state's estimate at the step marks, in its unit.
    pub estimate_rmse: BTreeMap<String, f64>,
    /// Time of a correction and a prediction together.
    pub estimator_us: StepTimes,
    /// How many corrections ended with which status, and how many predictions with another than
    /// updated.
    pub estimator_status: BTreeMap<String, usize>,
}

impl ControlMetrics {
    /// How many steps there were.
    #[must_use]
    pub fn steps(&self) -> usize {
        self.status.values().sum()
    }

    /// How many of them failed: those that did not converge, but for real-time iterations, which
    /// are not judged, and those that the time budget ended.
    #[must_use]
    pub fn failed_steps(&self) -> usize {
        self.status.iter().filter(|(status, _)| is_failure(status)).map(|(_, steps)| steps).sum()
    }
}

/// Whether a control step with this status, in the words of [`SqpStatus`], has failed.
#[must_use]
pub fn is_failure(status: &str) -> bool {
    let fine = [SqpStatus::Converged, SqpStatus::Prepared, SqpStatus::Deadline];
    fine.iter().all(|fine| fine.to_string() != status)
}

/// Whether the references were reached, each of which holds for a segment of the run. A segment is
/// looked at by its step marks t = kT, up to where the controller prepares the next one.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ReferenceMetrics {
    /// When each segment begins, in s.
    #[serde(default)]
    pub reference_start_s: Vec<f64>,
    /// For each controlled quantity and segment, the mean absolute error over the last ten marks,
    /// in its unit; `None` if the segment is too short for one.
    #[serde(default)]
    pub offset: BTreeMap<String, Vec<Option<f64>>>,
    /// For each segment, the time from its beginning until all controlled quantities stay near
    /// their references, in s; `None` if they do not.
    #[serde(default)]
    pub settle_s: Vec<Option<f64>>,
    /// How near that is for each quantity, in its unit.
    #[serde(default)]
    pub settled_within: BTreeMap<String, f64>,
}

impl ReferenceMetrics {
    /// The largest of all offsets; NaN if no segment is long enough for one.
    #[must_use]
    pub fn largest_offset(&self) -> f64 {
        self.offset.values().flatten().flatten().copied().fold(f64::NAN, f64::max)
    }
}
