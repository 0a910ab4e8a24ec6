//! The report of a sweep: the results of its trials, cell by cell, and those that failed.
//!
//! A cell is a place in the grid, with one trial per seed and draw. The form of a picture follows
//! from the sweep: a map for two axes, curves for one, bars for cases, histograms for draws, boxes
//! for cases with draws.

mod accuracy_cost;
mod bars;
mod boxes;
mod curves;
mod histogram;
mod map;
mod metric;
mod search;
#[cfg(test)]
mod tests;
mod traces;

use crate::data::Run;
use crate::error::ReportError;
use crate::number_tables::NumberTable;
use crate::picture::Picture;
use crate::trials::{self, Cell, Spread, Trials};
use metric::{Metric, Selection};
use pinc_chart::text::{self, MISSING};
use pinc_record::{SweepMetrics, TrialMetric};

/// The pictures of a sweep.
pub(crate) fn pictures(run: &Run, trials: &Trials) -> Result<Vec<Picture>, ReportError> {
    let mut pictures = Vec::from_iter(traces::picture(run, trials)?);
    if let Some(found) = search::of(&run.experiment) {
        pictures.extend(search::picture(trials, found));
        return Ok(pictures);
    }
    if accuracy_cost::is_there(trials) {
        pictures.extend(accuracy_cost::pictures(run, trials));
        return Ok(pictures);
    }
    for metric in Selection::of(run, trials).varying {
        if trials.are_of_cases() {
            pictures.extend(boxes::picture(trials, &metric));
        } else if trials.has_draws() {
            pictures.extend(histogram::picture(trials, &metric));
        } else {
            match trials.axes().len() {
                0 => pictures.extend(bars::picture(trials, &metric)),
                1 => pictures.extend(curves::picture(trials, &metric)),
                _ => pictures.extend(map::pictures(trials, &metric)),
            }
        }
    }
    Ok(pictures)
}

/// The sweep in a few sentences.
pub(crate) fn paragraph(run: &Run, trials: &Trials) -> String {
    let (all, failed, pending) = trials.counts();
    let cells = trials.cells().len();
    let mut summary =
        format!("{} in {}.", counted(all, "trial", "trials"), counted(cells, "cell", "cells"));
    match failed {
        0 => summary += " None failed.",
        n => summary += &format!(" {} failed; they are listed below.", text::count(n)),
    }
    if pending > 0 {
        summary += &format!(
            " {} not been run yet.",
            match pending {
                1 => "One has".to_owned(),
                n => format!("{} have", text::count(n)),
            }
        );
    }
    let sweep = run.metrics.as_ref().and_then(|metrics| metrics.sweep.as_ref());
    for note in sweep.map(SweepMetrics::loop_notes).unwrap_or_default() {
        summary += &format!(" {note}");
    }
    if search::of(&run.experiment).is_none() && !accuracy_cost::is_there(trials) {
        summary += &Selection::of(run, trials).sentence();
    }
    summary
}

fn counted(count: usize, one: &str, many: &str) -> String {
    format!("{} {}", text::count(count), if count == 1 { one } else { many })
}

/// The tables of a sweep: the spread of each metric by cell, and the trials that failed.
pub(crate) fn number_tables(run: &Run, trials: &Trials) -> Vec<NumberTable> {
    let mut tables = Vec::new();
    if let Some(found) = search::of(&run.experiment) {
        tables.push(search::number_table(trials, found));
        tables.extend(failures(trials));
        return tables;
    }
    if accuracy_cost::is_there(trials) {
        tables.extend(accuracy_cost::number_tables(trials));
        tables.extend(failures(trials));
        return tables;
    }
    for metric in Selection::of(run, trials).varying {
        match trials.are_alone() {
            true => tables.push(table_of_values(trials, &metric)),
            false => tables.extend(tables_of_spreads(trials, &metric)),
        }
    }
    tables.extend(failures(trials));
    tables
}

/// A metric of sole trials: a column for each model.
fn table_of_values(trials: &Trials, metric: &Metric) -> NumberTable {
    let digits = metric.digits(trials);
    let mut heads = places(trials);
    let name = |model: &&'static str| if model.is_empty() { "value" } else { model }.to_owned();
    heads.extend(metric.columns.iter().map(|(_, model)| name(model)));
    let value = |cell: &Cell, column: TrialMetric| match metric.spread(trials, cell, column) {
        Some(spread) => text::significant(spread.median, digits),
        None => MISSING.to_owned(),
    };
    let rows = trials.cells().iter().map(|cell| {
        let mut row = place(cell);
        row.extend(metric.columns.iter().map(|(column, _)| value(cell, *column)));
        row
    });
    NumberTable::new(&metric.label, heads, rows)
}

/// How a metric varies in each cell, a table for each model.
fn tables_of_spreads(trials: &Trials, metric: &Metric) -> Vec<NumberTable> {
    let digits = metric.digits(trials);
    let table = |(column, model): &(TrialMetric, &'static str)| {
        let mut heads = places(trials);
        heads.extend(["median", "quartiles", "extremes"].map(str::to_owned));
        let spreads: Vec<Option<Spread>> =
            trials.cells().iter().map(|cell| metric.spread(trials, cell, *column)).collect();
        // Where the metric is 0 for some trials alone, as a violation is, their number matters.
        let has_zeros = |spread: &Spread| spread.counts[1] < spread.counts[0];
        let zeros = spreads.iter().flatten().any(has_zeros);
        heads.extend(zeros.then(|| "not 0".to_owned()));
        heads.extend(["done", "failed"].map(str::to_owned));
        let rows = trials.cells().iter().zip(&spreads).map(|(cell, spread)| {
            let mut row = place(cell);
            row.extend(spread_cells(spread.as_ref(), digits));
            let nonzero = spread.map_or_else(|| MISSING.to_owned(), |s| text::count(s.counts[1]));
            row.extend(zeros.then_some(nonzero));
            row.extend([cell.done(), cell.failed.len()].map(text::count));
            row
        });
        let title = match *model {
            "" => metric.label.clone(),
            model => format!("{} with {model}", metric.label),
        };
        NumberTable::new(title, heads, rows)
    };
    metric.columns.iter().map(table).collect()
}

/// The heads of the columns that say which cell a row is.
fn places(trials: &Trials) -> Vec<String> {
    match trials.columns() {
        [] => vec![String::new()],
        columns => columns.iter().map(|column| trials::short(column)).collect(),
    }
}

/// The first columns of a cell's row.
fn place(cell: &Cell) -> Vec<String> {
    match cell.place.as_slice() {
        [] => vec!["all".to_owned()],
        place => place.iter().map(|value| trials::shown(value)).collect(),
    }
}

fn spread_cells(spread: Option<&Spread>, digits: usize) -> [String; 3] {
    let Some(s) = spread else { return [(); 3].map(|()| MISSING.to_owned()) };
    let number = |value| text::significant(value, digits);
    let range = |low, high| format!("{} to {}", number(low), number(high));
    [number(s.median), range(s.q1, s.q3), range(s.min, s.max)]
}

/// The trials that failed, with their errors.
fn failures(trials: &Trials) -> Option<NumberTable> {
    NumberTable::of_any("Failed trials", ["trial", "what", "error"], trials.failures())
}

/// What stands below a picture of the cells: their sizes, in terms of medians and spreads
/// (`several`) if there are such, and where the numbers are from.
fn caption(trials: &Trials, metric: &Metric, several: impl FnOnce(&str) -> String) -> String {
    let sizes = sizes(trials.cells());
    let shown = if trials.are_alone() { sizes } else { several(&sizes) };
    format!("{shown}. From {}.", trials.file_of(metric.columns[0].0))
}

/// What the caption of a picture of cells says of their sizes.
fn sizes(cells: &[Cell]) -> String {
    let done = cells.iter().map(Cell::done);
    let (least, most) = (done.clone().min().unwrap_or(0), done.max().unwrap_or(0));
    match least == most {
        true => format!("{} in each cell", counted(most, "trial", "trials")),
        false => format!("{least} to {most} trials in a cell"),
    }
}
