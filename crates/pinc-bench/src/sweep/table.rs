//! The tables of a sweep, as CSV.
//!
//! `sweep.csv` and `summary.csv` follow from the config alone: they are the same, bit for bit, however the
//! work was interrupted, spread and merged. Times are not, and have a table of their own.

use super::store::{Ending, Finished};
use super::trial::{Trial, cell_columns, columns};
use crate::Metrics;
use crate::record::{ControlMetrics, OneStepMetrics, number};
use crate::spec::{Experiment, ModelKind, SweepSpec};
use crate::sweep::spread::Spread;

/// Finds a metric, as a cell of a table.
type Look = dyn Fn(&Metrics) -> Option<String>;

/// A metric of a trial: its column, and how it is found.
struct Metric {
    column: String,
    value: Box<Look>,
}

impl Metric {
    fn new(column: &str, value: impl Fn(&Metrics) -> Option<String> + 'static) -> Self {
        Self { column: column.to_owned(), value: Box::new(value) }
    }

    fn number(column: &str, value: impl Fn(&Metrics) -> Option<f64> + 'static) -> Self {
        Self::new(column, move |metrics| value(metrics).map(number))
    }

    fn of_loop(
        model: ModelKind,
        column: &str,
        value: impl Fn(&ControlMetrics) -> f64 + 'static,
    ) -> Self {
        Self::number(&format!("{model}_{column}"), move |metrics| {
            metrics.control.iter().find(|run| run.model == model).map(&value)
        })
    }

    fn of_step(
        model: ModelKind,
        column: &str,
        value: impl Fn(&OneStepMetrics) -> f64 + 'static,
    ) -> Self {
        Self::number(&format!("{model}_{column}"), move |metrics| {
            metrics.one_step.iter().find(|step| step.model == model).map(&value)
        })
    }
}

/// The metrics of the stages that an experiment has, times left out.
fn metrics(experiment: &Experiment) -> Vec<Metric> {
    let mut all = Vec::new();
    if experiment.training.is_some() {
        all.push(Metric::new("source", |m| Some(m.training.as_ref()?.source.to_string())));
        all.push(Metric::new("stop_reason", |m| Some(m.training.as_ref()?.stop_reason.clone())));
        all.push(Metric::new("iterations", |m| Some(m.training.as_ref()?.iterations.to_string())));
        all.push(Metric::new("loss_evaluations", |m| {
            Some(m.training.as_ref()?.loss_evaluations.to_string())
        }));
        all.push(Metric::number("mse_gen", |m| Some(m.validation.as_ref()?.mse_gen)));
        all.push(Metric::number("mse_all_normalized", |m| {
            Some(m.validation.as_ref()?.mse_all_normalized)
        }));
        all.push(Metric::number("one_step_mse", |m| Some(m.validation.as_ref()?.one_step_mse)));
        if experiment.prediction.is_some() {
            all.push(Metric::number("free_run_mse_marks", |m| {
                Some(m.prediction.as_ref()?.mse_marks)
            }));
            all.push(Metric::number("free_run_rmse", |m| {
                Some(m.prediction.as_ref()?.mse_all.sqrt())
            }));
        }
    }
    for &model in experiment.control.iter().flat_map(|control| &control.models) {
        all.push(Metric::of_loop(model, "rmse", |run| run.rmse));
        all.push(Metric::of_loop(model, "iae", |run| run.iae));
        all.push(Metric::of_loop(model, "rmse_dense", |run| run.rmse_dense));
        all.push(Metric::of_loop(model, "iae_dense_sum", |run| run.iae_dense_sum));
        all.push(Metric::of_loop(model, "max_violation", |run| run.max_violation));
        all.push(Metric::of_loop(model, "kkt_max", |run| run.kkt_max));
        all.push(Metric::of_loop(model, "sqp_iterations_mean", |run| run.sqp_iterations_mean));
        if experiment.one_step.is_some() {
            all.push(Metric::of_step(model, "one_step_rms", |step| step.errors.rms));
            all.push(Metric::of_step(model, "one_step_median", |step| step.errors.median));
            all.push(Metric::of_step(model, "one_step_p99", |step| step.errors.p99));
            all.push(Metric::of_step(model, "jacobian_rms", |step| step.errors.jacobian_rms));
        }
    }
    all
}

/// The times of the stages that an experiment has.
fn times(experiment: &Experiment) -> Vec<Metric> {
    let mut all = Vec::new();
    if experiment.training.is_some() {
        all.push(Metric::number("training_wall_s", |m| Some(m.training.as_ref()?.wall_s)));
        all.push(Metric::number("optimizer_s", |m| Some(m.training.as_ref()?.optimizer_s)));
    }
    for &model in experiment.control.iter().flat_map(|control| &control.models) {
        all.push(Metric::of_loop(model, "wall_s", |run| run.wall_s.median));
        all.push(Metric::of_loop(model, "step_us", |run| run.step_us.p50));
        if experiment.one_step.is_some() {
            all.push(Metric::of_step(model, "forward_ns", |step| step.forward_ns));
            all.push(Metric::of_step(model, "forward_jacobian_ns", |s| s.forward_jacobian_ns));
        }
    }
    all
}

/// A sweep with what its trials came to so far.
pub(super) struct Results<'a> {
    pub(super) experiment: &'a Experiment,
    pub(super) sweep: &'a SweepSpec,
    pub(super) trials: &'a [Trial],
    /// Of each trial, if it is over.
    pub(super) finished: &'a [Option<Finished>],
}

impl Results<'_> {
    /// `sweep.csv`: one row per trial, in the order of the config.
    pub(super) fn trials(&self) -> Vec<u8> {
        let metrics = metrics(self.experiment);
        let mut header = vec!["trial".to_owned()];
        header.extend(columns(self.sweep));
        header.extend(metrics.iter().map(|metric| metric.column.clone()));
        header.extend(["status", "error"].map(str::to_owned));
        let row = |(trial, finished): (&Trial, &Option<Finished>)| {
            let mut row = vec![trial.id.clone()];
            row.extend(trial.cells.iter().cloned());
            row.extend(values(&metrics, finished));
            row.extend(status(finished));
            row
        };
        csv(&header, self.trials.iter().zip(self.finished).map(row))
    }

    /// `timings.csv`: the same rows with the times, which no two runs have in common.
    pub(super) fn timings(&self) -> Vec<u8> {
        let times = times(self.experiment);
        let mut header = vec!["trial".to_owned()];
        header.extend(times.iter().map(|time| time.column.clone()));
        let row = |(trial, finished): (&Trial, &Option<Finished>)| {
            let mut row = vec![trial.id.clone()];
            row.extend(values(&times, finished));
            row
        };
        csv(&header, self.trials.iter().zip(self.finished).map(row))
    }

    /// `summary.csv`: one row per cell and metric, with the spread over seeds and draws.
    pub(super) fn summary(&self) -> Vec<u8> {
        let cell = cell_columns(self.sweep);
        let metrics = metrics(self.experiment);
        let mut header = cell.clone();
        header.extend(["metric", "trials", "failed", "pending"].map(str::to_owned));
        header.extend(Spread::COLUMNS.map(str::to_owned));
        let mut rows = Vec::new();
        for (place, group) in self.cells(cell.len()) {
            let finished: Vec<_> = group.iter().map(|&i| &self.finished[i]).collect();
            let count = |what: fn(&Option<Finished>) -> bool| {
                finished.iter().filter(|finished| what(finished)).count().to_string()
            };
            let failed = count(|f| f.as_ref().is_some_and(|f| f.ending != Ending::Done));
            let pending = count(Option::is_none);
            for metric in &metrics {
                let done = finished.iter().filter_map(|finished| done(finished));
                let values = done.filter_map(|m| (metric.value)(m)?.parse().ok()).collect();
                // Words have no spread.
                let Some(spread) = Spread::of(values) else { continue };
                let mut row = place.to_vec();
                row.extend([
                    metric.column.clone(),
                    group.len().to_string(),
                    failed.clone(),
                    pending.clone(),
                ]);
                row.extend(spread.cells());
                rows.push(row);
            }
        }
        csv(&header, rows)
    }

    /// The cells in the order of their first trials, each with its trials.
    fn cells(&self, columns: usize) -> Vec<(&[String], Vec<usize>)> {
        let mut cells: Vec<(&[String], Vec<usize>)> = Vec::new();
        for (i, trial) in self.trials.iter().enumerate() {
            let place = &trial.cells[..columns];
            match cells.iter_mut().find(|(cell, _)| *cell == place) {
                Some((_, group)) => group.push(i),
                None => cells.push((place, vec![i])),
            }
        }
        cells
    }
}

/// The metrics of a trial that ended as it should.
fn done(finished: &Option<Finished>) -> Option<&Metrics> {
    let finished = finished.as_ref().filter(|finished| finished.ending == Ending::Done)?;
    finished.metrics.as_ref()
}

fn values(metrics: &[Metric], finished: &Option<Finished>) -> Vec<String> {
    let found = finished.as_ref().and_then(|finished| finished.metrics.as_ref());
    let value = |metric: &Metric| found.and_then(|found| (metric.value)(found));
    metrics.iter().map(|metric| value(metric).unwrap_or_default()).collect()
}

/// The cells `status` and `error`.
fn status(finished: &Option<Finished>) -> [String; 2] {
    match finished.as_ref().map(|finished| &finished.ending) {
        None => ["pending".to_owned(), String::new()],
        Some(Ending::Done) => ["done".to_owned(), String::new()],
        Some(Ending::Failed { error }) => ["failed".to_owned(), error.clone()],
    }
}

fn csv(header: &[String], rows: impl IntoIterator<Item = Vec<String>>) -> Vec<u8> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let records = std::iter::once(header.to_vec()).chain(rows);
    let written = records.into_iter().try_for_each(|record| writer.write_record(&record));
    written.expect("rows as long as the header, in memory");
    writer.into_inner().expect("writing to memory does not fail")
}
