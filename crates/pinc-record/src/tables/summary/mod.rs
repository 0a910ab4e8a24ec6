//! `summary.csv`: one row per cell and metric of a sweep, with the spread over its trials.

use super::fixed::{columns, exact, lines, parse};
use super::trial_metric::TrialMetric;
use crate::csv::{CsvFile, CsvText};
use crate::error::RecordError;
use crate::metrics::Metrics;
use crate::spread::Spread;
use crate::sweep_dir::{Ending, Finished};
use pinc_config::{self as config, DRAW, Experiment, SweepSpec, Trial, cell_columns, sweep_models};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::Path;

/// The spread of each metric in each cell of a sweep: the trials that differ in seeds and draws
/// only.
#[derive(Clone, Debug, PartialEq)]
pub struct SummaryTable {
    /// The columns that tell the cells apart: keys of the config, or `case` and `drawn`.
    pub cell_columns: Vec<String>,
    /// The rows: the cells in the order of their first trials, the metrics of each.
    pub rows: Vec<SummaryRow>,
}

/// A metric in a cell; the fields after `cell` are columns.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SummaryRow {
    /// The cell's values of the columns that tell cells apart.
    #[serde(skip)]
    pub cell: Vec<String>,
    /// The name of the metric and of its column in `sweep.csv`.
    pub metric: String,
    /// How many trials the cell has.
    pub trials: usize,
    /// How many of these failed.
    pub failed: usize,
    /// How many have not been run.
    pub pending: usize,
    /// How many finite values there are; of a metric of nets, one for each net.
    pub values: usize,
    /// How many of these are not 0, as those of loops that broke a bound.
    pub nonzero: usize,
    /// The least value.
    #[serde(serialize_with = "exact")]
    pub min: f64,
    /// The lower quartile.
    #[serde(serialize_with = "exact")]
    pub q1: f64,
    /// The median.
    #[serde(serialize_with = "exact")]
    pub median: f64,
    /// The upper quartile.
    #[serde(serialize_with = "exact")]
    pub q3: f64,
    /// The greatest value.
    #[serde(serialize_with = "exact")]
    pub max: f64,
    /// The lower end of the median's interval: with several seeds for each draw, of the median
    /// over the draws' medians.
    #[serde(serialize_with = "exact")]
    pub median_low: f64,
    /// The upper end of the median's interval.
    #[serde(serialize_with = "exact")]
    pub median_high: f64,
    /// The probability of the median being in its interval.
    #[serde(serialize_with = "exact")]
    pub confidence: f64,
}

impl SummaryTable {
    /// The summary of the trials, each of which may be over.
    #[must_use]
    pub fn new(
        experiment: &Experiment,
        sweep: &SweepSpec,
        trials: &[Trial],
        finished: &[Option<Finished>],
    ) -> Self {
        let cell_columns = cell_columns(sweep);
        let draw = config::columns(sweep).iter().position(|column| column == DRAW);
        let metrics = TrialMetric::results_with(experiment, &sweep_models(experiment, trials));
        let mut rows = Vec::new();
        for (cell, group) in cells(trials, cell_columns.len()) {
            let drawn = |i: usize| draw.map_or("", |place| trials[i].cells[place].as_str());
            let group: Vec<_> =
                group.into_iter().map(|i| (drawn(i), finished[i].as_ref())).collect();
            let nets = distinct_nets(&metrics, &group);
            let of = |metric: &TrialMetric| match metric.is_of_net() {
                true => row(cell, *metric, &group, &nets),
                false => row(cell, *metric, &group, &done(&group)),
            };
            rows.extend(metrics.iter().filter_map(of));
        }
        Self { cell_columns, rows }
    }

    /// The table as a CSV file.
    #[must_use]
    pub fn to_csv(&self) -> CsvText {
        let mut table =
            CsvText::new(self.cell_columns.iter().cloned().chain(columns::<SummaryRow>()));
        let rows: Vec<_> = self.rows.iter().map(|row| (&row.cell, row)).collect();
        table.append(&lines(&rows));
        table
    }

    /// Reads the table; `None` if the file does not exist.
    ///
    /// # Errors
    ///
    /// [`RecordError`], with the line and column of what is wrong.
    pub fn read(path: &Path) -> Result<Option<Self>, RecordError> {
        let Some(CsvFile { head, rows }) = CsvFile::read(path)? else { return Ok(None) };
        let cells = head.place("metric")?;
        let cells_of =
            |row: &csv::StringRecord| row.iter().take(cells).map(str::to_owned).collect();
        let row = |row| Ok(SummaryRow { cell: cells_of(row), ..parse(&head, row)? });
        let rows = rows.iter().map(row).collect::<Result<_, RecordError>>()?;
        Ok(Some(Self { cell_columns: cells_of(&head.header), rows }))
    }

    /// The rows of a metric.
    pub fn of(&self, metric: TrialMetric) -> impl Iterator<Item = &SummaryRow> {
        let name = metric.name();
        self.rows.iter().filter(move |row| row.metric == name)
    }

    /// The value of one of the columns that tell cells apart; empty if there is no such column.
    #[must_use]
    pub fn choice<'a>(&self, row: &'a SummaryRow, column: &str) -> &'a str {
        let place = self.cell_columns.iter().position(|known| known == column);
        place.and_then(|place| row.cell.get(place)).map_or("", String::as_str)
    }
}

/// The cells in the order of their first trials, each with its trials.
fn cells(trials: &[Trial], columns: usize) -> Vec<(&[String], Vec<usize>)> {
    let mut cells: Vec<(&[String], Vec<usize>)> = Vec::new();
    let mut known = HashMap::new();
    for (i, trial) in trials.iter().enumerate() {
        let place = &trial.cells[..columns];
        let cell = *known.entry(place).or_insert_with(|| {
            cells.push((place, Vec::new()));
            cells.len() - 1
        });
        cells[cell].1.push(i);
    }
    cells
}

/// The row of a metric in a cell with these trials; names have no spread, and so no row.
fn row(
    cell: &[String],
    metric: TrialMetric,
    group: &[Of<'_, Option<&Finished>>],
    counted: &[Of<'_, &Metrics>],
) -> Option<SummaryRow> {
    let value = |(draw, of)| Some((draw, metric.cell(of)?.parse().ok()?));
    let values: Vec<(&str, f64)> = counted.iter().copied().filter_map(value).collect();
    let spread = Spread::of(values.iter().map(|(_, value)| *value).collect())?;
    let (median_low, median_high, confidence) =
        Spread::of(independent(&values))?.interval_of_median();
    let over = group.iter().filter_map(|(_, finished)| *finished);
    Some(SummaryRow {
        cell: cell.to_vec(),
        metric: metric.name(),
        trials: group.len(),
        failed: over.filter(|finished| finished.ending != Ending::Done).count(),
        pending: group.iter().filter(|(_, finished)| finished.is_none()).count(),
        values: spread.count(),
        nonzero: spread.nonzero(),
        min: spread.quantile(0.0),
        q1: spread.quantile(0.25),
        median: spread.quantile(0.5),
        q3: spread.quantile(0.75),
        max: spread.quantile(1.0),
        median_low,
        median_high,
        confidence,
    })
}

/// What belongs to a trial, after its draw.
type Of<'a, T> = (&'a str, T);

/// Values that an interval may count as independent, of values with their draws: one for each draw,
/// the median over its seeds, which have the draw's plant in common; all values without draws, and
/// where all are of one.
fn independent(values: &[(&str, f64)]) -> Vec<f64> {
    let mut draws: BTreeMap<&str, Vec<f64>> = BTreeMap::new();
    for (draw, value) in values {
        draws.entry(draw).or_default().push(*value);
    }
    match draws.len() {
        0 | 1 => values.iter().map(|(_, value)| *value).collect(),
        _ => draws.into_values().filter_map(|of| Some(Spread::of(of)?.quantile(0.5))).collect(),
    }
}

/// The metrics of the trials that ended as they should.
fn done<'a>(group: &[Of<'a, Option<&'a Finished>>]) -> Vec<Of<'a, &'a Metrics>> {
    let finished = group.iter().filter_map(|(draw, finished)| Some((*draw, (*finished)?)));
    let done = finished.filter(|(_, finished)| finished.ending == Ending::Done);
    done.map(|(draw, finished)| (draw, &finished.metrics)).collect()
}

/// The same, one for each net: trials that differ in their loops only share it, and are not several
/// values of it.
fn distinct_nets<'a>(
    metrics: &[TrialMetric],
    group: &[Of<'a, Option<&'a Finished>>],
) -> Vec<Of<'a, &'a Metrics>> {
    let of_net = || metrics.iter().filter(|metric| metric.is_of_net());
    let mut known = HashSet::new();
    let mut all = done(group);
    all.retain(|(_, trial)| known.insert(of_net().map(|of| of.cell(trial)).collect::<Vec<_>>()));
    all
}

#[cfg(test)]
mod tests;
