//! `pinc compare`: runs side by side, with tables of their numbers and their traces in one picture.

mod differences;
mod pictures;
mod tables;

use crate::data::{OfModel, Run};
use crate::error::ReportError;
use crate::html;
use crate::number_tables::NumberTable;
use crate::picture::{Drawn, drawn};
use pinc_chart::text::{self, escape};
use pinc_record::{ControlMetrics, Metrics, RunDir, file};
use std::path::{Path, PathBuf};

/// Runs side by side.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Comparison {
    /// The tables as plain text.
    pub text: String,
    /// An HTML page with the tables and with pictures of the traces, to be opened without anything
    /// else.
    pub html: String,
}

/// A run with the name by which the comparison calls it.
#[derive(Debug)]
struct Compared {
    name: String,
    dir: PathBuf,
    run: Run,
    metrics: Metrics,
}

impl Compared {
    /// What the comparison calls something of one of the run's models, which may be one of several.
    fn named<T>(&self, of: &OfModel<T>, all: &[OfModel<T>]) -> String {
        match all {
            [_] => self.name.clone(),
            _ => format!("{}, {}", self.name, self.run.model_name(of.model)),
        }
    }

    /// The run's closed loops with their names.
    fn loops(&self) -> impl Iterator<Item = (String, &ControlMetrics)> {
        let name = move |of: &ControlMetrics| match &self.metrics.control[..] {
            [_] => self.name.clone(),
            _ => format!("{}, {}", self.name, self.run.model_name(Some(of.model))),
        };
        self.metrics.control.iter().map(move |of| (name(of), of))
    }
}

/// Compares the runs in these directories with the first of them.
///
/// # Errors
///
/// [`ReportError`] if a directory holds no run, a sweep, or a run without results; if the plants
/// differ; or if a file cannot be read or is damaged.
pub fn compare(dirs: &[PathBuf]) -> Result<Comparison, ReportError> {
    let runs = read(dirs)?;
    let tables = tables::all(&runs);
    let drawn = drawn(pictures::all(&runs));
    let (loops, others): (Vec<&Drawn>, Vec<&Drawn>) =
        drawn.iter().partition(|of| pictures::is_of_loops(&of.picture));
    let names: Vec<String> = runs.iter().map(|of| of.name.clone()).collect();
    let title = format!("{} · PINC comparison", names.join(", "));
    let section = |of: &&Drawn| {
        let picture = &of.picture;
        html::section(of, (&picture.stem, &picture.title, &picture.caption))
    };
    let sections = |of: &[&Drawn]| of.iter().map(section).collect::<String>();
    let numbers = html::numbers("metrics", "Numbers", &tables);
    let body = [header(&runs), sections(&loops), numbers, sections(&others)].concat();
    let html = html::document(&title, &body, &drawn);
    Ok(Comparison { text: tables.iter().map(plain).collect::<Vec<_>>().join("\n"), html })
}

fn read(dirs: &[PathBuf]) -> Result<Vec<Compared>, ReportError> {
    let names = names(dirs);
    let mut runs: Vec<Compared> = Vec::new();
    for (dir, name) in dirs.iter().zip(names) {
        let compared = one(dir, name)?;
        if let Some(first) = runs.first() {
            same_plant(first, &compared)?;
        }
        runs.push(compared);
    }
    Ok(runs)
}

fn one(dir: &Path, name: String) -> Result<Compared, ReportError> {
    RunDir::expect(dir)?;
    let mut run = Run::read(dir)?;
    if run.experiment.sweep.is_some() {
        return Err(ReportError::ComparedSweep { dir: dir.to_owned() });
    }
    let metrics = run.metrics.clone();
    let metrics = metrics.ok_or_else(|| ReportError::NoMetrics { dir: dir.to_owned() })?;
    let is_run = metrics.training.is_some() || !metrics.control.is_empty();
    if run.identification.is_some() && !is_run {
        let (command, place) = ("pinc identify", dir.join(file::REPORT));
        return Err(ReportError::NotOfARun { dir: dir.to_owned(), command, place });
    }
    run.control.loops.retain(|of| !of.table.rows.is_empty());
    Ok(Compared { name, dir: dir.to_owned(), run, metrics })
}

/// Runs are of the same plant if its name and its variables with their units are the same; its
/// parameters may differ.
fn same_plant(first: &Compared, other: &Compared) -> Result<(), ReportError> {
    let plant = |of: &Compared| {
        let unit = |name: &String| match of.metrics.variables.get(name).map(String::as_str) {
            None | Some("") => name.clone(),
            Some(unit) => format!("{name} ({unit})"),
        };
        let all = |names: &[String]| names.iter().map(unit).collect::<Vec<_>>().join(", ");
        let (states, inputs) = (all(&of.metrics.states), all(&of.metrics.inputs));
        format!("{} with states {states}, inputs {inputs}", of.run.experiment.plant.name())
    };
    let (plant, expected) = (plant(other), plant(first));
    if plant == expected {
        return Ok(());
    }
    let (dir, first) = (other.dir.clone(), first.dir.clone());
    Err(ReportError::OtherPlant { dir, plant, first, expected })
}

/// As many of the last parts of each path as tell all apart.
fn names(dirs: &[PathBuf]) -> Vec<String> {
    let parts = |dir: &PathBuf| -> Vec<String> {
        dir.components().map(|part| part.as_os_str().to_string_lossy().into_owned()).collect()
    };
    let all: Vec<Vec<String>> = dirs.iter().map(parts).collect();
    let longest = all.iter().map(Vec::len).max().unwrap_or(0);
    let last = |count: usize| -> Vec<String> {
        all.iter().map(|parts| parts[parts.len().saturating_sub(count)..].join("/")).collect()
    };
    let differ = |names: &[String]| (1..names.len()).all(|i| !names[..i].contains(&names[i]));
    let short = (1..=longest).map(last).find(|names| differ(names));
    // The same directory twice.
    short.unwrap_or_else(|| (1..).zip(last(1)).map(|(i, name)| format!("{i}: {name}")).collect())
}

fn header(runs: &[Compared]) -> String {
    let names: Vec<String> = runs.iter().map(|of| escape(&of.name)).collect();
    let plant = escape(runs[0].run.experiment.plant.name());
    format!(
        "<header>\n<h1>{}</h1>\n<p class=\"about\">plant <b>{plant}</b></p>\n\
         <p class=\"summary\">Differences are to <b>{}</b>.</p>\n</header>\n",
        text::listed(&names),
        names[0],
    )
}

/// A table in columns of plain text.
fn plain(table: &NumberTable) -> String {
    let rows: Vec<&Vec<String>> = std::iter::once(&table.heads).chain(&table.rows).collect();
    let count = rows.iter().map(|row| row.len()).max().unwrap_or(0);
    let wide = |text: &str| text.chars().count();
    let width = |i: usize| rows.iter().filter_map(|row| Some(wide(row.get(i)?))).max().unwrap_or(0);
    let widths: Vec<usize> = (0..count).map(width).collect();
    let mut out = format!("{}\n", table.title);
    for row in rows.iter().filter(|row| !row.is_empty()) {
        let mut line = String::new();
        for (i, (cell, width)) in row.iter().zip(&widths).enumerate() {
            let room = " ".repeat(width - wide(cell));
            line += &if i == 0 { format!("  {cell}{room}") } else { format!("  {room}{cell}") };
        }
        out += line.trim_end();
        out.push('\n');
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_as_short_as_they_can_be() {
        let of = |dirs: &[&str]| names(&dirs.iter().map(PathBuf::from).collect::<Vec<_>>());
        assert_eq!(of(&["runs/a", "runs/b/"]), ["a", "b"]);
        assert_eq!(of(&["runs/a/ours", "runs/b/ours"]), ["a/ours", "b/ours"]);
        assert_eq!(of(&["ours", "runs/b/ours"]), ["ours", "b/ours"]);
        assert_eq!(of(&["a", "a"]), ["1: a", "2: a"]);
    }

    #[test]
    fn plain_tables_are_in_columns() {
        let row = |cells: [&str; 2]| cells.map(str::to_owned).to_vec();
        let table = NumberTable {
            title: "T".to_owned(),
            heads: row(["", "µs"]),
            rows: vec![row(["long", "1"]), row(["s", "10"])],
        };
        assert_eq!(plain(&table), "T\n        µs\n  long   1\n  s     10\n");
    }
}
