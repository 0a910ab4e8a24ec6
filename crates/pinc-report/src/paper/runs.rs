//! The results of the paper's runs: metrics and tables, by experiment and preset.

use crate::error::ReportError;
use pinc_config::{Experiment, ModelKind, Preset};
use pinc_record::{
    Metrics, Provenance, RecordError, SummaryRow, SummaryTable, TrialColumn, TrialMetric,
    TrialTable, file, read_text,
};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// The runs in the directory of a list, `<experiment>/<preset>/` for each.
pub(super) struct Runs(Vec<Run>);

/// One run.
pub(super) struct Run {
    pub(super) experiment: String,
    pub(super) preset: Preset,
    pub(super) metrics: Metrics,
    pub(super) provenance: Provenance,
    dir: PathBuf,
}

impl Runs {
    /// The runs of these experiments, of those presets that there are.
    pub(super) fn read(dir: &Path, experiments: &[&str]) -> Result<Self, ReportError> {
        let mut found = Vec::new();
        for experiment in experiments {
            for preset in Preset::ALL {
                let dir = dir.join(experiment).join(preset.name());
                if let Some(metrics) = Metrics::read(&dir)? {
                    let provenance = needed(&dir.join(file::PROVENANCE), Provenance::read(&dir)?)?;
                    let experiment = (*experiment).to_owned();
                    found.push(Run { experiment, preset, metrics, provenance, dir });
                }
            }
        }
        Ok(Self(found))
    }

    /// The runs of an experiment.
    pub(super) fn of_experiment(&self, experiment: &str) -> impl Iterator<Item = &Run> {
        self.0.iter().filter(move |run| run.experiment == experiment)
    }
}

impl Run {
    /// One of its report's pictures, if it has that.
    pub(super) fn picture(&self, stem: &str) -> Option<PathBuf> {
        let path = self.dir.join(file::FIGURES).join(format!("{stem}.svg"));
        path.exists().then_some(path)
    }

    /// What its config says.
    fn config(&self) -> Result<Experiment, ReportError> {
        let path = self.dir.join(file::CONFIG);
        let text = needed(&path, read_text(&path)?)?;
        Ok(Experiment::read_back(&path, &text)?)
    }

    /// The trials of a sweep.
    pub(super) fn trials(&self) -> Result<TrialTable, ReportError> {
        let experiment = self.config()?;
        let sweep = experiment.sweep.as_ref();
        let columns = |sweep| TrialColumn::of_sweep(&experiment, sweep, &ModelKind::ALL);
        let columns = sweep.map(columns);
        let path = self.dir.join(file::SWEEP);
        Ok(needed(&path, TrialTable::read(&path, columns.unwrap_or_default())?)?)
    }

    /// The times of the trials of a sweep.
    pub(super) fn timings(&self) -> Result<TrialTable, ReportError> {
        let path = self.dir.join(file::TIMINGS);
        let columns = TrialColumn::of_timings(&self.config()?, &ModelKind::ALL);
        Ok(needed(&path, TrialTable::read(&path, columns)?)?)
    }

    /// The spread of a metric in the cells of a sweep.
    pub(super) fn summary(&self, metric: TrialMetric) -> Result<Summary, ReportError> {
        let path = self.dir.join(file::SUMMARY);
        let mut table = needed(&path, SummaryTable::read(&path)?)?;
        table.rows = table.of(metric).cloned().collect();
        Ok(Summary { table })
    }
}

/// The spread of one metric in the cells of a sweep.
pub(super) struct Summary {
    table: SummaryTable,
}

impl Summary {
    /// The cells.
    pub(super) fn rows(&self) -> &[SummaryRow] {
        &self.table.rows
    }

    /// Whether the cells differ in a key of the config.
    pub(super) fn has(&self, key: &str) -> bool {
        self.table.cell_columns.iter().any(|column| column == key)
    }

    /// A cell's value of a key of the config; empty if cells do not differ in it.
    pub(super) fn choice<'a>(&self, row: &'a SummaryRow, key: &str) -> &'a str {
        self.table.choice(row, key)
    }

    /// The cell of a case.
    pub(super) fn case(&self, name: &str) -> Option<&SummaryRow> {
        self.rows().iter().find(|row| self.choice(row, pinc_config::CASE) == name)
    }
}

/// What a file holds, or the error that it is missing.
fn needed<T>(path: &Path, content: Option<T>) -> Result<T, RecordError> {
    content.ok_or_else(|| RecordError::unreadable(path)(ErrorKind::NotFound.into()))
}
