//! `domain-error.csv`: the error of one step of a net at points all over its training domain.

use crate::csv::{CsvFile, CsvText};
use crate::error::RecordError;
use pinc_net::{DomainError, DomainTruth};
use std::path::Path;

const ERROR: &str = "error";

/// Errors of one step: the columns are the states, the inputs and `error`, the last.
#[derive(Clone, Debug, PartialEq)]
pub struct DomainErrorTable {
    /// Names of the states and the inputs.
    pub variables: Vec<String>,
    /// For each point the values of the variables, in their units.
    pub points: Vec<Vec<f64>>,
    /// For each point the largest error of a state, in widths of its range.
    pub errors: Vec<f64>,
}

impl DomainErrorTable {
    /// The errors of `judged` at the points of `truth`.
    #[must_use]
    pub fn of(variables: Vec<String>, truth: &DomainTruth, judged: &DomainError) -> Self {
        let points = truth.points();
        let values = |i| [points.state(i), points.input(i), points.parameters(i)].concat();
        let points = (0..judged.errors.len()).map(values).collect();
        Self { variables, points, errors: judged.errors.clone() }
    }

    /// The table as text.
    #[must_use]
    pub fn to_csv(&self) -> CsvText {
        let names = self.variables.iter().map(String::as_str).chain([ERROR]);
        let mut table = CsvText::new(names);
        for (point, error) in self.points.iter().zip(&self.errors) {
            table.push_numbers(point.iter().chain([error]));
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
        let last = head.header.len() - 1;
        if head.header.get(last) != Some(ERROR) {
            return Err(head.missing(ERROR));
        }
        let variables = head.header.iter().take(last).map(str::to_owned).collect();
        let points = rows.iter().map(|row| head.numbers(row, 0..last));
        let points = points.collect::<Result<_, _>>()?;
        let errors = rows.iter().map(|row| head.number(row, last));
        Ok(Some(Self { variables, points, errors: errors.collect::<Result<_, _>>()? }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_read_back_bit_for_bit() {
        let table = DomainErrorTable {
            // A variable may have the name of the last column.
            variables: ["error", "u"].map(str::to_owned).to_vec(),
            points: vec![vec![0.1 + 0.2, 1e-5], vec![-1.0, 2.0]],
            errors: vec![f64::INFINITY, 1e-300],
        };
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("domain-error.csv");
        assert_eq!(DomainErrorTable::read(&path).unwrap(), None);
        std::fs::write(&path, table.to_csv().as_bytes()).unwrap();
        assert_eq!(DomainErrorTable::read(&path).unwrap(), Some(table));
        std::fs::write(&path, "x,u,off\n1,2,3\n").unwrap();
        let message = DomainErrorTable::read(&path).unwrap_err().to_string();
        assert!(message.contains("no column `error`"), "{message}");
    }
}
