//! CSV files that users give: their columns by name, their cells as numbers.

use crate::error::CsvProblem;
use csv::StringRecord;

/// Something wrong, and the line it is in.
pub(super) type At = (u64, CsvProblem);

/// A row and its line.
pub(super) type Row = Result<(u64, StringRecord), At>;

/// The header of a CSV text, and its rows with their lines.
pub(super) fn rows(text: &[u8]) -> Result<(StringRecord, impl Iterator<Item = Row>), At> {
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text);
    let header = reader.headers().map_err(syntax)?.clone();
    let rows = reader.into_records().map(|row| {
        let row = row.map_err(syntax)?;
        Ok((row.position().map_or(0, csv::Position::line), row))
    });
    Ok((header, rows))
}

fn syntax(error: csv::Error) -> At {
    let line = error.position().map_or(1, csv::Position::line);
    (line, CsvProblem::Syntax(error))
}

/// Where each of `names` stands in a header, which has to have these and no others, each once.
pub(super) fn places(header: &StringRecord, names: &[String]) -> Result<Vec<usize>, CsvProblem> {
    for (i, column) in header.iter().enumerate() {
        let known = names.iter().any(|name| name == column);
        if !known || header.iter().take(i).any(|before| before == column) {
            let column = column.to_owned();
            return Err(CsvProblem::UnexpectedColumn { column, expected: names.join(",") });
        }
    }
    let place = |name: &String| {
        let (column, expected) = (name.clone(), names.join(","));
        let missing = || CsvProblem::MissingColumn { column, expected };
        header.iter().position(|column| column == name).ok_or_else(missing)
    };
    names.iter().map(place).collect()
}

/// Numbers in cells: the squares of larger ones are not finite.
const LARGEST: f64 = 1e100;

/// The number in a cell.
pub(super) fn finite(cell: &str, column: &str) -> Result<f64, CsvProblem> {
    match cell.parse::<f64>() {
        Ok(value) if value.abs() <= LARGEST => Ok(value),
        _ => Err(CsvProblem::Cell { column: column.to_owned(), found: cell.to_owned() }),
    }
}

/// The number in a cell that may be empty.
pub(super) fn optional(cell: &str, column: &str) -> Result<Option<f64>, CsvProblem> {
    if cell.is_empty() { Ok(None) } else { finite(cell, column).map(Some) }
}
