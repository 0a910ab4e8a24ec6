//! The report of a sweep: what its trials came to, cell by cell, and those that failed.
//!
//! A cell is a place in the grid, with one trial per seed and draw. The form of a picture follows
//! from the sweep: a map for two axes, curves for one, bars for cases, histograms for draws.

mod bars;
mod curves;
mod front;
mod histogram;
mod map;
#[cfg(test)]
mod tests;
mod traces;
mod trials;

pub(super) use trials::Trials;

use super::ReportError;
use super::data::Run;
use super::picture::Picture;
use super::sheets::Sheet;
use super::text::{self, MISSING};
use crate::spec::ModelKind;
use trials::{Cell, Spread};

/// A number of the trials that is worth a picture.
#[derive(Clone, Debug)]
struct Metric {
    /// The columns of `sweep.csv`, each with what it is of: a model, or nothing if there is one.
    columns: Vec<(String, &'static str)>,
    /// Stem of a file.
    stem: &'static str,
    title: &'static str,
    /// What an axis calls it.
    label: String,
    /// Whether its logarithm says more.
    log: bool,
}

/// The pictures of a sweep.
pub(super) fn pictures(run: &Run, trials: &Trials) -> Result<Vec<Picture>, ReportError> {
    let mut pictures = Vec::from_iter(traces::picture(run, trials)?);
    if front::is_there(trials) {
        pictures.extend(front::pictures(run, trials));
        return Ok(pictures);
    }
    for metric in metrics(run, trials).into_iter().chain(time(trials)) {
        if trials.has_draws() {
            pictures.extend(histogram::picture(trials, &metric)?);
        } else {
            match trials.axes().len() {
                0 => pictures.extend(bars::picture(trials, &metric)?),
                1 => pictures.extend(curves::picture(trials, &metric)?),
                _ => pictures.extend(map::pictures(trials, &metric)),
            }
        }
    }
    Ok(pictures)
}

/// The metrics that the sweep's table has, and that differ among the trials of one cell if these
/// are draws.
fn metrics(run: &Run, trials: &Trials) -> Vec<Metric> {
    let all = [
        Metric {
            columns: vec![("mse_gen".to_owned(), "")],
            stem: "mse",
            title: "Validation error",
            label: run.label_in_states_unit("validation MSE", "²"),
            log: true,
        },
        Metric {
            columns: vec![("free_run_rmse".to_owned(), "")],
            stem: "free-run-rmse",
            title: "Error of the free run",
            label: run.label_in_states_unit("RMSE of the free run", ""),
            log: true,
        },
        Metric {
            columns: of_models(trials, "iae_dense_sum"),
            stem: "iae",
            title: "Closed loop: integral of the absolute error",
            label: run.label_in_states_unit("IAE, dense trace, sum over outputs", ""),
            log: false,
        },
        Metric {
            columns: of_models(trials, "rmse_dense"),
            stem: "rmse",
            title: "Closed loop: root mean square error",
            label: run.label_in_states_unit("RMSE, dense trace", ""),
            log: false,
        },
    ];
    let varies = |column: &str| {
        let spreads = trials.cells().iter().filter_map(|cell| trials.spread(cell, column));
        spreads.into_iter().any(|spread| spread.max > spread.min)
    };
    let is_worth = |column: &str| trials.has(column) && (!trials.has_draws() || varies(column));
    let present = |metric: Metric| {
        let columns: Vec<_> =
            metric.columns.into_iter().filter(|(column, _)| is_worth(column)).collect();
        (!columns.is_empty()).then_some(Metric { columns, ..metric })
    };
    all.into_iter().filter_map(present).collect()
}

/// The time of the controller, where a sweep has one axis and so shows what it depends on.
fn time(trials: &Trials) -> Option<Metric> {
    let metric = Metric {
        columns: of_models(trials, "wall_s"),
        stem: "time",
        title: "Closed loop: the controller's time",
        label: "controller's time in the whole loop (s)".to_owned(),
        log: true,
    };
    let shown = trials.axes().len() == 1 && !trials.has_draws() && !metric.columns.is_empty();
    shown.then_some(metric)
}

/// The columns of each model's metric `column` that the sweep's table has, and the models' names.
fn of_models(trials: &Trials, column: &str) -> Vec<(String, &'static str)> {
    let columns =
        ModelKind::ALL.map(|model| (format!("{model}_{column}"), model.title())).into_iter();
    columns.filter(|(column, _)| trials.has(column)).collect()
}

/// The sweep in a few sentences.
pub(super) fn paragraph(trials: &Trials) -> String {
    let (all, failed, pending) = trials.counts();
    let cells = trials.cells().len();
    let mut words =
        format!("{} in {}.", counted(all, "trial", "trials"), counted(cells, "cell", "cells"));
    match failed {
        0 => words += " None failed.",
        n => words += &format!(" {} failed; they are listed below.", text::count(n)),
    }
    if pending > 0 {
        words += &format!(
            " {} not been run yet.",
            match pending {
                1 => "One has".to_owned(),
                n => format!("{} have", text::count(n)),
            }
        );
    }
    words
}

fn counted(count: usize, one: &str, many: &str) -> String {
    format!("{} {}", text::count(count), if count == 1 { one } else { many })
}

/// The tables of a sweep: the spread of each metric by cell, and the trials that failed.
pub(super) fn sheets(run: &Run, trials: &Trials) -> Result<Vec<Sheet>, ReportError> {
    let mut sheets = Vec::new();
    if front::is_there(trials) {
        sheets.extend(front::sheets(trials));
        sheets.extend(failures(trials)?);
        return Ok(sheets);
    }
    for metric in metrics(run, trials) {
        for (column, model) in &metric.columns {
            let title = match *model {
                "" => metric.label.clone(),
                model => format!("{} with {model}", metric.label),
            };
            sheets.push(sheet(trials, column, title));
        }
    }
    sheets.extend(failures(trials)?);
    Ok(sheets)
}

fn sheet(trials: &Trials, column: &str, title: String) -> Sheet {
    let mut heads: Vec<String> = trials.columns().iter().map(|c| trials::short(c)).collect();
    if heads.is_empty() {
        heads.push(String::new());
    }
    heads.extend(["median", "quartiles", "extremes", "done", "failed"].map(str::to_owned));
    let rows = trials.cells().iter().map(|cell| {
        let mut row = cell.place.clone();
        if row.is_empty() {
            row.push("all".to_owned());
        }
        let spread = trials.spread(cell, column);
        row.extend(spread_cells(spread.as_ref()));
        row.extend([cell.done(), cell.failed.len()].map(text::count));
        row
    });
    Sheet { title, heads, rows: rows.collect() }
}

fn spread_cells(spread: Option<&Spread>) -> [String; 3] {
    let Some(s) = spread else { return [(); 3].map(|()| MISSING.to_owned()) };
    let number = |value| text::significant(value, 3);
    let range = |low, high| format!("{} to {}", number(low), number(high));
    [number(s.median), range(s.q1, s.q3), range(s.min, s.max)]
}

/// The trials that failed, with their errors.
fn failures(trials: &Trials) -> Result<Option<Sheet>, ReportError> {
    let failures = trials.failures()?;
    if failures.is_empty() {
        return Ok(None);
    }
    let title = "Failed trials".to_owned();
    let heads = ["trial", "what", "error"].map(str::to_owned).to_vec();
    Ok(Some(Sheet { title, heads, rows: failures }))
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
