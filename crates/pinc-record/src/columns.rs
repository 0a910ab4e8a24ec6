//! CSV files that users give: their columns by name, their cells as numbers.

use ::csv::StringRecord;
pub use pinc_config::{CsvProblem as At, CsvRow as Row, csv_rows as rows};

/// Where each of `names` stands in a header, which has to have these and no others.
///
/// # Errors
///
/// The column that is missing or unexpected.
pub fn places(header: &StringRecord, names: &[String]) -> Result<Vec<usize>, String> {
    if let Some(column) = header.iter().find(|column| names.iter().all(|name| name != column)) {
        return Err(format!("column `{column}` is unexpected; expected {}", names.join(",")));
    }
    names.iter().map(|name| place(header, name, names)).collect()
}

/// Where the column `name` stands in a header, which has to have all of `expected`.
///
/// # Errors
///
/// The column, if it is missing.
pub fn place(header: &StringRecord, name: &str, expected: &[String]) -> Result<usize, String> {
    header
        .iter()
        .position(|column| column == name)
        .ok_or_else(|| format!("column `{name}` is missing; expected {}", expected.join(",")))
}

/// Numbers in cells: the squares of larger ones are not finite.
const LARGEST: f64 = 1e100;

/// The number in a cell.
///
/// # Errors
///
/// What is there instead.
pub fn finite(cell: &str, column: &str) -> Result<f64, String> {
    match cell.parse::<f64>() {
        Ok(value) if value.abs() <= LARGEST => Ok(value),
        _ => Err(not_finite(cell, column)),
    }
}

/// A cell that is no finite number, or too large a one.
#[must_use]
pub fn not_finite(cell: &str, column: &str) -> String {
    format!("column `{column}`: `{cell}` given, expected a finite number up to 1e100")
}

/// Times that do not increase.
#[must_use]
pub fn not_later(t: f64, previous: f64) -> String {
    format!("column `t`: {t} s given, expected more than {previous} s, the scenario's row before")
}

/// A gap that would take too many steps to cross.
#[must_use]
pub fn too_far(t: f64) -> String {
    format!("column `t`: {t} s is more than a million steps of T after the scenario's row before")
}

/// A file with too few rows.
#[must_use]
pub fn too_few_rows(rows: usize, least: usize) -> At {
    (1, format!("{rows} rows of data, expected {least} or more below the header"))
}

/// The number in a cell that may be empty.
///
/// # Errors
///
/// What is there instead.
pub fn optional(cell: &str, column: &str) -> Result<Option<f64>, String> {
    if cell.is_empty() { Ok(None) } else { finite(cell, column).map(Some) }
}
