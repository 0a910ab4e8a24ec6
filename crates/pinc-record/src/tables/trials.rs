//! `sweep.csv` and `timings.csv`: one row per trial of a sweep.

use super::trial_metric::TrialMetric;
use crate::csv::{CsvFile, CsvText};
use crate::error::RecordError;
use crate::search::Eligibility;
use crate::sweep_dir::{Ending, Finished};
use pinc_config::{Experiment, ModelKind, SweepSpec, Trial, columns};
use std::path::Path;

/// How far a trial is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrialStatus {
    /// It ended as it should.
    Done,
    /// It ended with an error.
    Failed,
    /// It has not been run.
    Pending,
    /// It is not run, since others of a search are better.
    Dropped,
}

impl TrialStatus {
    /// Its name in the column of statuses.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Done => "done",
            Self::Failed => "failed",
            Self::Pending => "pending",
            Self::Dropped => "dropped",
        }
    }

    /// The status with this name; [`TrialStatus::Failed`] if there is none.
    #[must_use]
    pub fn of(name: &str) -> Self {
        let all = [Self::Done, Self::Pending, Self::Dropped];
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
    /// How it ended: `done`, `failed`, `pending` or `dropped`.
    Status,
    /// The error that it ended with.
    Error,
}

impl TrialColumn {
    /// The columns of `sweep.csv` if these are the models in the loops of the trials: see
    /// [`sweep_models`](pinc_config::sweep_models). All kinds of models read any table.
    #[must_use]
    pub fn of_sweep(experiment: &Experiment, sweep: &SweepSpec, models: &[ModelKind]) -> Vec<Self> {
        let choices = columns(sweep).into_iter().map(Self::Choice);
        let metrics = TrialMetric::results_with(experiment, models).into_iter().map(Self::Metric);
        let all = std::iter::once(Self::Trial).chain(choices).chain(metrics);
        all.chain([Self::Status, Self::Error]).collect()
    }

    /// The columns of `timings.csv`, likewise.
    #[must_use]
    pub fn of_timings(experiment: &Experiment, models: &[ModelKind]) -> Vec<Self> {
        let metrics = TrialMetric::times_with(experiment, models).into_iter().map(Self::Metric);
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
    fn cell(
        &self,
        trial: &Trial,
        choices: &[String],
        finished: Option<&Finished>,
        eligibility: Eligibility,
    ) -> String {
        let ending = finished.map(|finished| &finished.ending);
        match self {
            Self::Trial => trial.id.clone(),
            Self::Choice(key) => {
                let place = choices.iter().position(|choice| choice == key);
                place.map_or_else(String::new, |place| trial.cells[place].clone())
            }
            Self::Metric(metric) => {
                let cell = finished.and_then(|finished| metric.cell(&finished.metrics));
                cell.unwrap_or_default()
            }
            Self::Status => match ending {
                None if eligibility == Eligibility::Dropped => {
                    TrialStatus::Dropped.name().to_owned()
                }
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
    /// The table with these columns of trials, each of which may be over, and which stand like
    /// this.
    #[must_use]
    pub fn new(
        columns: Vec<TrialColumn>,
        sweep: &SweepSpec,
        trials: &[Trial],
        finished: &[Option<Finished>],
        eligibility: &[Eligibility],
    ) -> Self {
        let choices = pinc_config::columns(sweep);
        let row =
            |((trial, finished), eligibility): ((&Trial, &Option<Finished>), &Eligibility)| {
                let finished = finished.as_ref();
                columns.iter().map(|c| c.cell(trial, &choices, finished, *eligibility)).collect()
            };
        let rows = trials.iter().zip(finished).zip(eligibility).map(row).collect();
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
        let Some(CsvFile { head: file, rows: read }) = CsvFile::read(path)? else {
            return Ok(None);
        };
        let mut found = Vec::new();
        for column in columns {
            match (&column, file.position(&column.name())) {
                (_, Some(place)) => found.push((place, column)),
                (TrialColumn::Metric(_), None) => {}
                (_, None) => return Err(file.missing(&column.name())),
            }
        }
        let mut rows = Vec::new();
        for row in &read {
            for (place, column) in &found {
                let is_number = matches!(column, TrialColumn::Metric(m) if m.is_number());
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

#[cfg(test)]
mod tests {
    use super::*;
    use pinc_config::{Plants, sweep_models, trials};

    /// The loops of the config are with RK4 alone.
    #[test]
    fn models_that_only_some_cases_have_are_columns_too() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/smoke/one-tank.toml");
        let case = |model| {
            format!("{{ name = \"{model}\", set = {{ \"control.models\" = [\"{model}\"] }} }}")
        };
        let cases = ["rk5", "rk4", "pinc"].map(case).join(", ");
        let sets = ["control.models=[\"rk4\"]".to_owned(), format!("sweep.cases=[{cases}]")];
        let experiment = Experiment::load(Path::new(path), &sets, &Plants::built_in()).unwrap();
        let models = sweep_models(&experiment, &trials(&experiment).unwrap());
        assert_eq!(models, [ModelKind::RK4, ModelKind::RK5, ModelKind::Pinc]);

        let sweep = experiment.sweep.as_ref().unwrap();
        let written = TrialColumn::of_sweep(&experiment, sweep, &models);
        let read = TrialColumn::of_sweep(&experiment, sweep, &ModelKind::ALL);
        assert!(written.iter().all(|column| read.contains(column)));
        let timings = TrialColumn::of_timings(&experiment, &models);
        let names: Vec<String> = written.iter().chain(&timings).map(TrialColumn::name).collect();
        for model in models {
            for metric in ["iae_dense_sum", "step_us"] {
                assert!(names.contains(&format!("{model}_{metric}")), "{model} {metric}");
            }
        }
    }

    /// Each trial has its row with its hash, its values, its numbers and how it stands; a table that
    /// an older version wrote may lack a metric, but none of the rest.
    #[test]
    fn a_table_of_trials_says_how_each_stands() {
        use crate::metric::{IAE_DENSE_SUM, MAX_VIOLATION};
        let experiment = crate::search::tests::experiment(&[]);
        let trials = trials(&experiment).unwrap();
        let sweep = experiment.sweep.as_ref().unwrap();
        let columns = TrialColumn::of_sweep(&experiment, sweep, &[ModelKind::RK4]);
        let finished = |ending| {
            let iae = crate::search::tests::finished(2.5);
            Some(Finished { ending, ..iae })
        };
        let failed = Ending::Failed { error: "it fell, twice".to_owned() };
        let results = [finished(Ending::Done), finished(failed), None, None];
        let standing =
            [Eligibility::Open, Eligibility::Open, Eligibility::Waiting, Eligibility::Dropped];
        let four = &trials[..4];
        let table = TrialTable::new(columns.clone(), sweep, four, &results, &standing);
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("sweep.csv");
        std::fs::write(&path, table.to_csv().as_bytes()).unwrap();
        let read = TrialTable::read(&path, columns.clone()).unwrap().unwrap();
        assert_eq!(read, table);
        let statuses = ["done", "failed", "pending", "dropped"];
        let metric = IAE_DENSE_SUM.with(ModelKind::RK4);
        for (i, status) in statuses.into_iter().enumerate() {
            assert_eq!(read.cell(i, &TrialColumn::Status), status);
            assert_eq!(TrialStatus::of(status).name(), status);
            assert_eq!(read.cell(i, &TrialColumn::Trial), trials[i].id);
            let key = TrialColumn::Choice("control.r.0".to_owned());
            let place = pinc_config::columns(sweep).iter().position(|name| name == "control.r.0");
            assert_eq!(read.cell(i, &key), trials[i].cells[place.unwrap()]);
            let error = if status == "failed" { "it fell, twice" } else { "" };
            assert_eq!(read.cell(i, &TrialColumn::Error), error);
            // What a failed trial got to is there too.
            assert_eq!(read.number(i, metric).is_nan(), results[i].is_none());
        }
        assert!((read.number(0, metric) - 2.5).abs() < 1e-15);
        assert_eq!(TrialStatus::of("anything"), TrialStatus::Failed);

        let column = TrialColumn::Metric(metric);
        let other = TrialColumn::Metric(MAX_VIOLATION.with(ModelKind::RK4));
        let write = |head: &str, row: &str| {
            std::fs::write(&path, format!("{head}\n{row}\n")).unwrap();
            TrialTable::read(&path, vec![TrialColumn::Trial, other.clone(), column.clone()])
        };
        let older = write("rk4_iae_dense_sum,trial", "4.5,abc").unwrap().unwrap();
        assert!(!older.has(&other) && older.has(&column));
        assert_eq!((older.len(), older.cell(0, &TrialColumn::Trial)), (1, "abc"));
        assert!((older.number(0, metric) - 4.5).abs() < 1e-15);
        let said = write("rk4_iae_dense_sum,name", "4.5,abc").unwrap_err().to_string();
        assert!(said.contains("sweep.csv:1: no column `trial`"), "{said}");
        let said = write("trial,rk4_iae_dense_sum", "abc,many").unwrap_err().to_string();
        assert!(said.contains("sweep.csv:2: column `rk4_iae_dense_sum`"), "{said}");
    }
}
