//! What the runs of the paper left: metrics and tables, by experiment and preset.

use crate::record::file;
use crate::{BenchError, CsvProblem, Metrics, Preset, Provenance};
use std::collections::HashMap;
use std::fs;
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

/// A row of a table, by column.
pub(super) type Row = HashMap<String, String>;

impl Runs {
    /// The runs of these experiments, of those presets that there are.
    pub(super) fn read(dir: &Path, experiments: &[&str]) -> Result<Self, BenchError> {
        let mut found = Vec::new();
        for experiment in experiments {
            for preset in Preset::ALL {
                let dir = dir.join(experiment).join(preset.name());
                if dir.join(file::METRICS).exists() {
                    let metrics = json(&dir.join(file::METRICS))?;
                    let provenance = json(&dir.join(file::PROVENANCE))?;
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

    /// The rows of one of its tables.
    pub(super) fn table(&self, name: &str) -> Result<Vec<Row>, BenchError> {
        let path = self.dir.join(name);
        let damaged = |source: csv::Error| BenchError::Csv {
            path: path.clone(),
            line: source.position().map_or(1, csv::Position::line),
            problem: CsvProblem::Syntax(source),
        };
        let bytes = fs::read(&path).map_err(BenchError::unreadable(&path))?;
        let mut reader = csv::Reader::from_reader(&bytes[..]);
        reader.deserialize().collect::<Result<_, _>>().map_err(damaged)
    }

    /// The rows of `summary.csv` for one metric.
    pub(super) fn summary(&self, metric: &str) -> Result<Vec<Row>, BenchError> {
        let mut rows = self.table(file::SUMMARY)?;
        rows.retain(|row| cell(row, "metric") == metric);
        Ok(rows)
    }
}

/// A cell of a row; empty if there is none.
pub(super) fn cell<'a>(row: &'a Row, column: &str) -> &'a str {
    row.get(column).map_or("", String::as_str)
}

/// A number in a row; NaN if there is none.
pub(super) fn number(row: &Row, column: &str) -> f64 {
    cell(row, column).parse().unwrap_or(f64::NAN)
}

fn json<T: for<'de> serde::Deserialize<'de>>(path: &Path) -> Result<T, BenchError> {
    let bytes = fs::read(path).map_err(BenchError::unreadable(path))?;
    let value = serde_json::from_slice(&bytes);
    value.map_err(|problem| BenchError::Results { path: path.to_owned(), problem })
}
