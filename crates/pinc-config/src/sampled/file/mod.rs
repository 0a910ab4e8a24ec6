//! CSV files of schedules.

#[cfg(test)]
mod tests;

use super::{Checked, Grid, Signal};
use crate::validate::limits;
use csv::StringRecord;
use pinc_toml::{Problem, nearest};
use std::collections::BTreeMap;
use std::path::Path;
use toml::{Table, Value};

/// A CSV file: the column `t`, in s, and others by name.
pub(super) struct File {
    is_linear: bool,
    times: Vec<f64>,
    pub(super) columns: BTreeMap<String, Vec<f64>>,
}

impl File {
    pub(super) fn read(path: &str, given: &Table, grid: Grid) -> Checked<Self> {
        let known = ["file", "interpolation"].map(str::to_owned);
        if let Some(other) = given.keys().find(|key| !known.contains(key)) {
            let nearest = nearest(other, &known);
            return Err((
                format!("{path}.{other}"),
                Problem::Unknown { known: known.to_vec(), nearest },
            ));
        }
        let Some(word) = given.get("interpolation").and_then(Value::as_str) else {
            let problem = Problem::Missing("\"linear\" or \"zero-order\"");
            return Err((format!("{path}.interpolation"), problem));
        };
        let is_linear = match word {
            "linear" => true,
            "zero-order" => false,
            other => {
                let known = ["linear", "zero-order"].map(str::to_owned).to_vec();
                return Err((format!("{path}.interpolation"), Problem::word(other, &known)));
            }
        };
        let name = given.get("file").and_then(Value::as_str).unwrap_or_default();
        let fail = |line: u64, expected: &str, found: String| {
            let found = if line == 0 { found } else { format!("{name}, line {line}: {found}") };
            (format!("{path}.file"), Problem::Value { found, expected: expected.to_owned() })
        };
        let text = std::fs::read(Path::new(name)).map_err(|error| {
            fail(0, "a CSV file, relative to the working directory", format!("{name} ({error})"))
        })?;
        let (header, rows) = rows(&text)
            .map_err(|(line, found)| fail(line, "a header and rows of numbers", found))?;
        let time = header.iter().position(|column| column == "t");
        let time = time.ok_or_else(|| {
            fail(
                1,
                "a column `t`, in s",
                format!("the columns {}", header.iter().collect::<Vec<_>>().join(", ")),
            )
        })?;
        let times: Vec<f64> = rows.iter().map(|(_, row)| row[time]).collect();
        let line = |row: usize| rows[row].0;
        if times.first().is_none_or(|first| *first > 0.0) {
            return Err(fail(1, "a first row for t = 0", "no value at t = 0".to_owned()));
        }
        if let Some(row) = (1..times.len()).find(|&row| times[row] <= times[row - 1]) {
            let expected = format!("more than {}, the row before", times[row - 1]);
            return Err(fail(line(row), &expected, format!("t = {}", times[row])));
        }
        let end = grid.time(grid.steps);
        if is_linear && times[times.len() - 1] < end * (1.0 - 1e-9) {
            let expected = format!("rows to the end of the run, t = {end}");
            let last = times.len() - 1;
            return Err(fail(line(last), &expected, format!("t = {}", times[last])));
        }
        if !is_linear {
            for (row, &t) in times.iter().enumerate().filter(|(_, t)| **t > 0.0) {
                grid.on_a_step(t)
                    .map_err(|expected| fail(line(row), &expected, format!("t = {t}")))?;
            }
        }
        let column = |i: usize| rows.iter().map(|(_, row)| row[i]).collect();
        let columns = header.iter().enumerate().filter(|(i, _)| *i != time);
        let columns = columns.map(|(i, name)| (name.to_owned(), column(i))).collect();
        Ok(Self { is_linear, times, columns })
    }

    /// A column.
    pub(super) fn signal(&self, path: &str, name: &str) -> Checked<Signal> {
        let Some(values) = self.columns.get(name) else {
            let known: Vec<String> = self.columns.keys().cloned().collect();
            let expected = format!("a file with the column `{name}`");
            let found = format!("the columns {}", known.join(", "));
            return Err((path.to_owned(), Problem::Value { found, expected }));
        };
        let (times, values) = (self.times.clone(), values.clone());
        Ok(Signal::Column { times, values, is_linear: self.is_linear })
    }
}

/// The rows of a file with their lines.
type Rows = Vec<(u64, Vec<f64>)>;

/// The line of a row in a CSV text: the reader may count the end of the line before to the row.
fn line(text: &[u8], position: Option<&csv::Position>) -> u64 {
    let Some(position) = position else { return 1 };
    let from = usize::try_from(position.byte()).map_or(&[][..], |at| text.get(at..).unwrap_or(&[]));
    let ends = from.iter().take_while(|byte| matches!(byte, b'\r' | b'\n'));
    position.line() + ends.filter(|byte| **byte == b'\n').count() as u64
}

/// Something wrong in a CSV text, after its line.
pub type CsvProblem = (u64, String);

/// A row of a CSV text, after its line.
pub type CsvRow = Result<(u64, StringRecord), CsvProblem>;

/// The header of a CSV text, and its rows.
///
/// # Errors
///
/// What is wrong with the header.
pub fn csv_rows(text: &[u8]) -> Result<(StringRecord, impl Iterator<Item = CsvRow>), CsvProblem> {
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text);
    let syntax =
        |error: csv::Error| (line(text, error.position()), format!("not a CSV file: {error}"));
    let header = reader.headers().map_err(syntax)?.clone();
    if let Some(other) =
        [";", "\t"].iter().find(|other| header.len() == 1 && header[0].contains(**other))
    {
        return Err((1, format!("columns separated by {other:?}, not by commas")));
    }
    if let Some(twice) = (1..header.len()).find(|&i| header.iter().take(i).any(|c| *c == header[i]))
    {
        return Err((1, format!("column `{}` more than once", &header[twice])));
    }
    let rows = reader.into_records().map(move |row| {
        let row = row.map_err(syntax)?;
        Ok((line(text, row.position()), row))
    });
    Ok((header, rows))
}

/// The header and the rows of numbers of a CSV text; or the line and what is there.
fn rows(text: &[u8]) -> Result<(StringRecord, Rows), CsvProblem> {
    let (header, given) = csv_rows(text)?;
    let mut rows = Vec::new();
    for row in given {
        let (line, row) = row?;
        let number = |(cell, column): (&str, &str)| match cell.parse::<f64>() {
            Ok(number) if number.is_finite() => Ok(number),
            _ => Err((line, format!("`{cell}` in the column `{column}`"))),
        };
        let numbers = row.iter().zip(&header).map(number).collect::<Result<_, _>>()?;
        rows.push((line, numbers));
        if rows.len() > limits::STEPS {
            return Err((line, format!("more than {} rows", limits::STEPS)));
        }
    }
    Ok((header, rows))
}
