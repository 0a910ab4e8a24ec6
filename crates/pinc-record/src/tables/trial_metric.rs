//! The results and times of a trial that the tables of a sweep have a column for.

use crate::csv::number;
use crate::metrics::{ControlMetrics, Metrics, OneStepMetrics};
use pinc_config::{Experiment, ModelKind, sweep_models};

/// A result of a trial: a number or a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum TrialMetric {
    /// What the net was trained on.
    Source,
    /// Why the training ended.
    StopReason,
    /// Iterations of the training.
    Iterations,
    /// Evaluations of the loss and its gradient.
    LossEvaluations,
    /// Mean squared error at the steps, in the states' units squared.
    MseGen,
    /// Mean squared error of all rows, normalized.
    MseAllNormalized,
    /// Mean squared error of one step.
    OneStepMse,
    /// Mean squared error of the free run at the step marks.
    FreeRunMseMarks,
    /// Root mean square error of the whole free run.
    FreeRunRmse,
    /// Wall time of the training, in s.
    TrainingWall,
    /// Wall time of the optimizer alone, in s.
    Optimizer,
    /// A number of the closed loop with a model.
    Loop(ModelKind, LoopMetric),
    /// A number of one step of a model.
    Step(ModelKind, StepMetric),
}

/// A number of a closed loop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum LoopMetric {
    /// RMSE at the steps.
    Rmse,
    /// IAE at the steps, averaged over outputs.
    Iae,
    /// RMSE on the dense trace.
    RmseDense,
    /// IAE on the dense trace, summed over outputs.
    IaeDenseSum,
    /// The largest offset from a reference at rest, over quantities and segments; NaN without one.
    OffsetMax,
    /// The worst violation of a bound.
    MaxViolation,
    /// The largest KKT residual.
    KktMax,
    /// SQP iterations per step.
    SqpIterationsMean,
    /// The controller's time in the whole loop, in s: the median of the repetitions.
    Wall,
    /// The controller's time in a step, in us: the median.
    StepTime,
}

/// A number of one step of a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum StepMetric {
    /// Root mean square error, in widths of the domain.
    Rms,
    /// Median error.
    Median,
    /// 99th percentile of the error.
    P99,
    /// Root mean square error of the Jacobians.
    JacobianRms,
    /// Time of a step, in ns.
    Forward,
    /// Time of a step with its Jacobians, in ns.
    ForwardJacobian,
}

impl LoopMetric {
    const RESULTS: [Self; 8] = [
        Self::Rmse,
        Self::Iae,
        Self::RmseDense,
        Self::IaeDenseSum,
        Self::OffsetMax,
        Self::MaxViolation,
        Self::KktMax,
        Self::SqpIterationsMean,
    ];
    const TIMES: [Self; 2] = [Self::Wall, Self::StepTime];

    fn name(self) -> &'static str {
        match self {
            Self::Rmse => "rmse",
            Self::Iae => "iae",
            Self::RmseDense => "rmse_dense",
            Self::IaeDenseSum => "iae_dense_sum",
            Self::OffsetMax => "offset_max",
            Self::MaxViolation => "max_violation",
            Self::KktMax => "kkt_max",
            Self::SqpIterationsMean => "sqp_iterations_mean",
            Self::Wall => "wall_s",
            Self::StepTime => "step_us",
        }
    }

    fn value(self, of: &ControlMetrics) -> f64 {
        match self {
            Self::Rmse => of.rmse,
            Self::Iae => of.iae,
            Self::RmseDense => of.rmse_dense,
            Self::IaeDenseSum => of.iae_dense_sum,
            Self::OffsetMax => of.references.largest_offset(),
            Self::MaxViolation => of.max_violation,
            Self::KktMax => of.kkt_max,
            Self::SqpIterationsMean => of.sqp_iterations_mean,
            Self::Wall => of.wall_s.median,
            Self::StepTime => of.step_us.p50,
        }
    }
}

impl StepMetric {
    const RESULTS: [Self; 4] = [Self::Rms, Self::Median, Self::P99, Self::JacobianRms];
    const TIMES: [Self; 2] = [Self::Forward, Self::ForwardJacobian];

    fn name(self) -> &'static str {
        match self {
            Self::Rms => "one_step_rms",
            Self::Median => "one_step_median",
            Self::P99 => "one_step_p99",
            Self::JacobianRms => "jacobian_rms",
            Self::Forward => "forward_ns",
            Self::ForwardJacobian => "forward_jacobian_ns",
        }
    }

    fn value(self, of: &OneStepMetrics) -> f64 {
        match self {
            Self::Rms => of.errors.rms,
            Self::Median => of.errors.median,
            Self::P99 => of.errors.p99,
            Self::JacobianRms => of.errors.jacobian_rms,
            Self::Forward => of.forward_ns,
            Self::ForwardJacobian => of.forward_jacobian_ns,
        }
    }
}

impl TrialMetric {
    /// The metrics of the stages that an experiment has, times left out.
    #[must_use]
    pub fn results(experiment: &Experiment) -> Vec<Self> {
        Self::results_with(experiment, &sweep_models(experiment, &[]))
    }

    /// The same with loops of these models.
    pub(super) fn results_with(experiment: &Experiment, models: &[ModelKind]) -> Vec<Self> {
        let mut all = Vec::new();
        if experiment.training.is_some() {
            all.extend([Self::Source, Self::StopReason, Self::Iterations, Self::LossEvaluations]);
            all.extend([Self::MseGen, Self::MseAllNormalized, Self::OneStepMse]);
            if experiment.prediction.is_some() {
                all.extend([Self::FreeRunMseMarks, Self::FreeRunRmse]);
            }
        }
        for &model in models {
            all.extend(LoopMetric::RESULTS.map(|metric| Self::Loop(model, metric)));
            if experiment.one_step.is_some() {
                all.extend(StepMetric::RESULTS.map(|metric| Self::Step(model, metric)));
            }
        }
        all
    }

    /// The number that the search of an experiment minimizes; none if there is no such search, or
    /// no such number.
    #[must_use]
    pub fn searched(experiment: &Experiment) -> Option<Self> {
        let name = &experiment.sweep.as_ref()?.search.as_ref()?.minimize;
        let mut numbers = Self::results(experiment).into_iter().filter(|metric| metric.is_number());
        numbers.find(|metric| metric.name() == *name)
    }

    /// Whether it is a number rather than a name.
    #[must_use]
    pub fn is_number(self) -> bool {
        !matches!(self, Self::Source | Self::StopReason)
    }

    /// The times of the stages that an experiment has, with loops of these models.
    pub(super) fn times_with(experiment: &Experiment, models: &[ModelKind]) -> Vec<Self> {
        let mut all = Vec::new();
        if experiment.training.is_some() {
            all.extend([Self::TrainingWall, Self::Optimizer]);
        }
        for &model in models {
            all.extend(LoopMetric::TIMES.map(|metric| Self::Loop(model, metric)));
            if experiment.one_step.is_some() {
                all.extend(StepMetric::TIMES.map(|metric| Self::Step(model, metric)));
            }
        }
        all
    }

    /// The name of its column.
    #[must_use]
    pub fn name(self) -> String {
        match self {
            Self::Source => "source".to_owned(),
            Self::StopReason => "stop_reason".to_owned(),
            Self::Iterations => "iterations".to_owned(),
            Self::LossEvaluations => "loss_evaluations".to_owned(),
            Self::MseGen => "mse_gen".to_owned(),
            Self::MseAllNormalized => "mse_all_normalized".to_owned(),
            Self::OneStepMse => "one_step_mse".to_owned(),
            Self::FreeRunMseMarks => "free_run_mse_marks".to_owned(),
            Self::FreeRunRmse => "free_run_rmse".to_owned(),
            Self::TrainingWall => "training_wall_s".to_owned(),
            Self::Optimizer => "optimizer_s".to_owned(),
            Self::Loop(model, metric) => format!("{model}_{}", metric.name()),
            Self::Step(model, metric) => format!("{model}_{}", metric.name()),
        }
    }

    /// What a trial with these metrics has in the column, if it got so far.
    #[must_use]
    pub fn cell(self, metrics: &Metrics) -> Option<String> {
        let training = metrics.training.as_ref();
        let validation = metrics.validation.as_ref();
        let prediction = metrics.prediction.as_ref();
        let value = match self {
            Self::Source => return Some(training?.source.to_string()),
            Self::StopReason => return Some(training?.stop_reason.clone()),
            Self::Iterations => return Some(training?.iterations.to_string()),
            Self::LossEvaluations => return Some(training?.loss_evaluations.to_string()),
            Self::MseGen => validation?.mse_gen,
            Self::MseAllNormalized => validation?.mse_all_normalized,
            Self::OneStepMse => validation?.one_step_mse,
            Self::FreeRunMseMarks => prediction?.mse_marks,
            Self::FreeRunRmse => prediction?.mse_all.sqrt(),
            Self::TrainingWall => training?.wall_s,
            Self::Optimizer => training?.optimizer_s,
            Self::Loop(model, metric) => metric.value(metrics.loop_with(model)?),
            Self::Step(model, metric) => metric.value(metrics.step_of(model)?),
        };
        Some(number(value))
    }
}
