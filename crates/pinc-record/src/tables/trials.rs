//! `sweep.csv` and `timings.csv`: one row per trial of a sweep.

use crate::csv::{CsvFile, CsvText, number};
use crate::error::RecordError;
use crate::metrics::{ControlMetrics, Metrics, OneStepMetrics};
use crate::sweep_dir::{Ending, Finished};
use pinc_config::{Experiment, ModelKind, SweepSpec, Trial, columns};
use std::path::Path;

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
    const RESULTS: [Self; 7] = [
        Self::Rmse,
        Self::Iae,
        Self::RmseDense,
        Self::IaeDenseSum,
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
        let mut all = Vec::new();
        if experiment.training.is_some() {
            all.extend([Self::Source, Self::StopReason, Self::Iterations, Self::LossEvaluations]);
            all.extend([Self::MseGen, Self::MseAllNormalized, Self::OneStepMse]);
            if experiment.prediction.is_some() {
                all.extend([Self::FreeRunMseMarks, Self::FreeRunRmse]);
            }
        }
        for model in models(experiment) {
            all.extend(LoopMetric::RESULTS.map(|metric| Self::Loop(model, metric)));
            if experiment.one_step.is_some() {
                all.extend(StepMetric::RESULTS.map(|metric| Self::Step(model, metric)));
            }
        }
        all
    }

    /// The times of the stages that an experiment has.
    #[must_use]
    pub fn times(experiment: &Experiment) -> Vec<Self> {
        let mut all = Vec::new();
        if experiment.training.is_some() {
            all.extend([Self::TrainingWall, Self::Optimizer]);
        }
        for model in models(experiment) {
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

fn models(experiment: &Experiment) -> impl Iterator<Item = ModelKind> {
    experiment.control.iter().flat_map(|control| control.models.iter().copied())
}

/// How far a trial is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrialStatus {
    /// It ended as it should.
    Done,
    /// It ended with an error.
    Failed,
    /// It has not been run.
    Pending,
}

impl TrialStatus {
    /// Its name in the column of statuses.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Done => "done",
            Self::Failed => "failed",
            Self::Pending => "pending",
        }
    }

    /// The status with this name; [`TrialStatus::Failed`] if there is none.
    #[must_use]
    pub fn of(name: &str) -> Self {
        let all = [Self::Done, Self::Pending];
        all.into_iter().find(|status| status.name() == name).unwrap_or(Self::Failed)
    }
}

/// A column of a table of trials.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TrialColumn {
    /// The trial's hash.
    Trial,
    /// What tells trials apart: a key of the config, or `case`, `drawn`, `draw`, `seed`.
    Choice(String),
    /// A result.
    Metric(TrialMetric),
    /// How it ended: `done`, `failed` or `pending`.
    Status,
    /// The error that it ended with.
    Error,
}

impl TrialColumn {
    /// The columns of `sweep.csv`.
    #[must_use]
    pub fn of_sweep(experiment: &Experiment, sweep: &SweepSpec) -> Vec<Self> {
        let choices = columns(sweep).into_iter().map(Self::Choice);
        let metrics = TrialMetric::results(experiment).into_iter().map(Self::Metric);
        let all = std::iter::once(Self::Trial).chain(choices).chain(metrics);
        all.chain([Self::Status, Self::Error]).collect()
    }

    /// The columns of `timings.csv`.
    #[must_use]
    pub fn of_timings(experiment: &Experiment) -> Vec<Self> {
        let metrics = TrialMetric::times(experiment).into_iter().map(Self::Metric);
        std::iter::once(Self::Trial).chain(metrics).collect()
    }

    /// The column's name.
    #[must_use]
    pub fn name(&self) -> String {
        match self {
            Self::Trial => "trial".to_owned(),
            Self::Choice(key) => key.clone(),
            Self::Metric(metric) => metric.name(),
            Self::Status => "status".to_owned(),
            Self::Error => "error".to_owned(),
        }
    }

    /// The cell of a trial that may be over.
    fn cell(&self, trial: &Trial, choices: &[String], finished: Option<&Finished>) -> String {
        let ending = finished.map(|finished| &finished.ending);
        match self {
            Self::Trial => trial.id.clone(),
            Self::Choice(key) => {
                let place = choices.iter().position(|choice| choice == key);
                place.map_or_else(String::new, |place| trial.cells[place].clone())
            }
            Self::Metric(metric) => {
                let metrics = finished.and_then(|finished| finished.metrics.as_ref());
                metrics.and_then(|metrics| metric.cell(metrics)).unwrap_or_default()
            }
            Self::Status => match ending {
                None => TrialStatus::Pending.name().to_owned(),
                Some(Ending::Done) => TrialStatus::Done.name().to_owned(),
                Some(Ending::Failed { .. }) => TrialStatus::Failed.name().to_owned(),
            },
            Self::Error => match ending {
                Some(Ending::Failed { error }) => error.clone(),
                _ => String::new(),
            },
        }
    }
}

/// A table of trials, one row for each, in the order of the config.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TrialTable {
    columns: Vec<TrialColumn>,
    /// As many cells as columns.
    rows: Vec<Vec<String>>,
}

impl TrialTable {
    /// The table with these columns of trials, each of which may be over.
    #[must_use]
    pub fn new(
        columns: Vec<TrialColumn>,
        sweep: &SweepSpec,
        trials: &[Trial],
        finished: &[Option<Finished>],
    ) -> Self {
        let choices = pinc_config::columns(sweep);
        let row = |(trial, finished): (&Trial, &Option<Finished>)| {
            columns.iter().map(|c| c.cell(trial, &choices, finished.as_ref())).collect()
        };
        let rows = trials.iter().zip(finished).map(row).collect();
        Self { columns, rows }
    }

    /// The table as a CSV file.
    #[must_use]
    pub fn to_csv(&self) -> CsvText {
        let mut table = CsvText::new(self.columns.iter().map(TrialColumn::name));
        for row in &self.rows {
            table.push(row);
        }
        table
    }

    /// Reads the table; `None` if the file does not exist. A metric that the file lacks is left
    /// out; all other columns have to be there.
    ///
    /// # Errors
    ///
    /// [`RecordError`], with the line and column of what is wrong.
    pub fn read(path: &Path, columns: Vec<TrialColumn>) -> Result<Option<Self>, RecordError> {
        let Some(file) = CsvFile::read(path)? else { return Ok(None) };
        let mut found = Vec::new();
        for column in columns {
            match (&column, file.position(&column.name())) {
                (_, Some(place)) => found.push((place, column)),
                (TrialColumn::Metric(_), None) => {}
                (_, None) => return Err(file.missing(&column.name())),
            }
        }
        let mut rows = Vec::new();
        for row in &file.rows {
            for (place, column) in &found {
                use TrialMetric::{Source, StopReason};
                let is_number =
                    matches!(column, TrialColumn::Metric(m) if !matches!(m, Source | StopReason));
                if is_number {
                    file.number(row, *place)?;
                }
            }
            let cells = found.iter().map(|(place, _)| row.get(*place).unwrap_or_default());
            rows.push(cells.map(str::to_owned).collect());
        }
        Ok(Some(Self { columns: found.into_iter().map(|(_, column)| column).collect(), rows }))
    }

    /// The number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there are no rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Whether the table has a column.
    #[must_use]
    pub fn has(&self, column: &TrialColumn) -> bool {
        self.columns.contains(column)
    }

    /// A cell; empty if the table lacks the column or the row.
    #[must_use]
    pub fn cell(&self, row: usize, column: &TrialColumn) -> &str {
        let place = self.columns.iter().position(|known| known == column);
        let cell = place.and_then(|place| self.rows.get(row)?.get(place));
        cell.map_or("", String::as_str)
    }

    /// The number in a cell; NaN if it is empty or there is none.
    #[must_use]
    pub fn number(&self, row: usize, metric: TrialMetric) -> f64 {
        self.cell(row, &TrialColumn::Metric(metric)).parse().unwrap_or(f64::NAN)
    }
}
