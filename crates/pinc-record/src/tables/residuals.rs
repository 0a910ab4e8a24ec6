//! `residuals.csv`: recorded data beside the fit of `pinc identify`.

use crate::csv::{CsvFile, CsvText, number};
use crate::error::RecordError;
use std::path::Path;

const FILE: &str = "file";
const TIME: &str = "t";

/// Data and fit: the columns are `file`, the number of the data file from 1, `t`, and for each
/// measured output `y_<name>`, `fit_<name>` and `residual_<name>`, measured minus fitted.
#[derive(Clone, Debug, PartialEq)]
pub struct ResidualTable {
    /// The measured quantities.
    pub measured: Vec<String>,
    /// The rows, by file and time.
    pub rows: Vec<ResidualRow>,
}

/// The data of one time.
#[derive(Clone, Debug, PartialEq)]
pub struct ResidualRow {
    /// The number of the file, from 1.
    pub file: usize,
    /// Time in s.
    pub t: f64,
    /// The measured values; NaN where missing.
    pub measured: Vec<f64>,
    /// The model's outputs.
    pub fitted: Vec<f64>,
}

impl ResidualTable {
    /// The table as a CSV file; a value that was not measured is an empty cell.
    #[must_use]
    pub fn to_csv(&self) -> CsvText {
        let mut columns = vec![FILE.to_owned(), TIME.to_owned()];
        for form in ["y_", "fit_", "residual_"] {
            columns.extend(self.measured.iter().map(|name| format!("{form}{name}")));
        }
        let mut table = CsvText::new(columns);
        let cell = |value: f64| if value.is_nan() { String::new() } else { number(value) };
        for row in &self.rows {
            let residuals = row.measured.iter().zip(&row.fitted).map(|(y, fit)| y - fit);
            let values = row.measured.iter().chain(&row.fitted).copied().chain(residuals);
            let cells = [row.file.to_string(), number(row.t)];
            table.push(cells.into_iter().chain(values.map(cell)));
        }
        table
    }

    /// Reads the table; `None` if the file does not exist.
    ///
    /// # Errors
    ///
    /// [`RecordError`], with the line and column of what is wrong.
    pub fn read(path: &Path) -> Result<Option<Self>, RecordError> {
        let Some(CsvFile { head, rows }) = CsvFile::read(path)? else { return Ok(None) };
        let names = head.header.iter().filter_map(|name| name.strip_prefix("fit_"));
        let measured: Vec<String> = names.map(str::to_owned).collect();
        let (t, of_file) = (head.place(TIME)?, head.place(FILE)?);
        let y = head.places(&measured, |name| format!("y_{name}"))?;
        let fit = head.places(&measured, |name| format!("fit_{name}"))?;
        let row = |row| {
            Ok(ResidualRow {
                file: head.whole(row, of_file)?,
                t: head.number(row, t)?,
                measured: head.numbers(row, y.iter().copied())?,
                fitted: head.numbers(row, fit.iter().copied())?,
            })
        };
        let rows = rows.iter().map(row).collect::<Result<_, RecordError>>()?;
        Ok(Some(Self { measured, rows }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn residuals_read_back_bit_for_bit() {
        let row =
            |file, y| ResidualRow { file, t: 0.1 + 0.2, measured: vec![y], fitted: vec![0.3] };
        let rows = vec![row(1, 1.0 / 3.0), row(2, f64::NAN)];
        let table = ResidualTable { measured: vec!["h".to_owned()], rows };
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("residuals.csv");
        assert!(ResidualTable::read(&path).unwrap().is_none());
        std::fs::write(&path, table.to_csv().as_bytes()).unwrap();
        let read = ResidualTable::read(&path).unwrap().unwrap();
        assert_eq!(read.rows[0], table.rows[0]);
        assert_eq!((read.rows[1].file, read.rows[1].measured[0].is_nan()), (2, true));
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.starts_with("file,t,y_h,fit_h,residual_h\n1,"), "{text}");
        assert!(text.ends_with("2,0.30000000000000004,,0.3,\n"), "{text}");
    }
}
