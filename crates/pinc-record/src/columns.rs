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

/// Columns of these quantities without a measurement.
#[must_use]
pub fn unmeasured(measured: &[String]) -> String {
    format!("no row has a number in y_{}, expected a measurement", measured.join(", y_"))
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

#[cfg(test)]
mod tests {
    use super::*;

    fn names(names: &[&str]) -> Vec<String> {
        names.iter().map(|&name| name.to_owned()).collect()
    }

    /// The places are in the order of the names, not of the columns; each name needs its column, and
    /// each column its name.
    #[test]
    fn columns_are_found_by_their_names() {
        let header = StringRecord::from(vec!["t", "u", "h1", "h2"]);
        let found = places(&header, &names(&["h2", "t", "u", "h1"]));
        assert_eq!(found, Ok(vec![3, 0, 1, 2]));
        let found = places(&header, &names(&["t", "u", "h2", "h1", "q"]));
        assert_eq!(found, Err("column `q` is missing; expected t,u,h2,h1,q".to_owned()));
        let found = places(&header, &names(&["t", "h2", "h1"]));
        assert_eq!(found, Err("column `u` is unexpected; expected t,h2,h1".to_owned()));
        assert_eq!(place(&header, "h1", &names(&["h1"])), Ok(2));
    }

    /// Numbers of either sign up to 1e100 are taken, a text or a larger one is said as it stands.
    #[test]
    fn cells_are_numbers_whose_squares_are_finite() {
        for (cell, value) in [("-2.5", -2.5), ("1e100", 1e100), ("-1e100", -1e100), ("0", 0.0)] {
            assert_eq!(finite(cell, "h"), Ok(value));
            assert_eq!(optional(cell, "h"), Ok(Some(value)));
        }
        for cell in ["1.1e100", "-1.1e100", "nan", "inf", "-inf", "two", "1,5"] {
            let said = format!("column `h`: `{cell}` given, expected a finite number up to 1e100");
            assert_eq!(finite(cell, "h"), Err(said.clone()));
            assert_eq!(optional(cell, "h"), Err(said));
        }
        assert_eq!(optional("", "h"), Ok(None));
        assert!(finite("", "h").is_err());
    }

    /// Each message has both numbers in their places.
    #[test]
    fn rows_in_the_wrong_place_are_said_with_their_numbers() {
        let said = not_later(2.0, 3.5);
        assert!(said.starts_with("column `t`: 2 s given, expected more than 3.5 s"), "{said}");
        let said = too_far(7.5);
        assert!(said.starts_with("column `t`: 7.5 s is more than a million steps"), "{said}");
        let (line, said) = too_few_rows(1, 2);
        assert_eq!(line, 1);
        assert_eq!(said, "1 rows of data, expected 2 or more below the header");
    }
}
