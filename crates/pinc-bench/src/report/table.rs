//! A CSV file of a run directory, kept as text until a column is asked for.

use super::ReportError;
use csv::StringRecord;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// A CSV file with a header row.
#[derive(Debug)]
pub(super) struct Table {
    path: PathBuf,
    headers: Vec<String>,
    rows: Vec<StringRecord>,
}

impl Table {
    /// Reads a file; `None` if it does not exist.
    pub(super) fn read(path: &Path) -> Result<Option<Self>, ReportError> {
        let file = match std::fs::File::open(path) {
            Ok(file) => file,
            Err(source) if source.kind() == ErrorKind::NotFound => return Ok(None),
            Err(source) => {
                let path = path.to_owned();
                return Err(ReportError::Read { path, source });
            }
        };
        let damaged = |source: csv::Error| ReportError::Csv {
            path: path.to_owned(),
            line: source.position().map_or(1, csv::Position::line),
            source,
        };
        let mut reader = csv::Reader::from_reader(file);
        let headers = reader.headers().map_err(damaged)?;
        let headers = headers.iter().map(|h| h.trim().to_owned()).collect();
        let rows = reader.records().collect::<Result<_, _>>().map_err(damaged)?;
        Ok(Some(Self { path: path.to_owned(), headers, rows }))
    }

    /// The file's name without its directory, for captions.
    pub(super) fn file_name(&self) -> String {
        let name = self.path.file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    }

    /// The columns' names, in order.
    pub(super) fn headers(&self) -> &[String] {
        &self.headers
    }

    /// The number of rows below the header.
    pub(super) fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there is a column of this name.
    pub(super) fn has(&self, column: &str) -> bool {
        self.headers.iter().any(|h| h == column)
    }

    /// A column of text.
    pub(super) fn texts(&self, column: &str) -> Result<Vec<&str>, ReportError> {
        let index = self.index(column)?;
        Ok(self.rows.iter().map(|row| row[index].trim()).collect())
    }

    /// A column of numbers; an empty cell is NaN.
    pub(super) fn numbers(&self, column: &str) -> Result<Vec<f64>, ReportError> {
        let index = self.index(column)?;
        let cell = |row: &StringRecord| match row[index].trim() {
            "" => Ok(f64::NAN),
            text => text.parse().map_err(|_| ReportError::NotANumber {
                path: self.path.clone(),
                line: row.position().map_or(1, csv::Position::line),
                column: column.to_owned(),
                text: text.to_owned(),
            }),
        };
        self.rows.iter().map(cell).collect()
    }

    /// Two columns as points; `None` if the second column does not exist.
    pub(super) fn points(&self, x: &str, y: &str) -> Result<Option<Vec<(f64, f64)>>, ReportError> {
        if !self.has(y) {
            return Ok(None);
        }
        let (x, y) = (self.numbers(x)?, self.numbers(y)?);
        Ok(Some(x.into_iter().zip(y).collect()))
    }

    fn index(&self, column: &str) -> Result<usize, ReportError> {
        let found = self.headers.iter().position(|h| h == column);
        found.ok_or_else(|| ReportError::MissingColumn {
            path: self.path.clone(),
            column: column.to_owned(),
            found: self.headers.clone(),
        })
    }
}
