//! Tables as CSV: written in memory or to a file row by row, read with the line of what is wrong.

use crate::error::{RecordError, TableProblem};
use crate::files::AtomicFile;
use ::csv::{Reader, ReaderBuilder, StringRecord, Trim};
use std::fmt::Write;
use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

/// A CSV file being made, in memory.
#[derive(Clone, Debug)]
pub struct CsvText {
    text: String,
}

impl CsvText {
    /// A table with these columns.
    #[must_use]
    pub fn new<T: AsRef<str>>(columns: impl IntoIterator<Item = T>) -> Self {
        let mut table = Self { text: String::new() };
        table.push(columns);
        table
    }

    /// Adds a row.
    pub fn push<T: AsRef<str>>(&mut self, cells: impl IntoIterator<Item = T>) {
        for (i, cell) in cells.into_iter().enumerate() {
            if i > 0 {
                self.text.push(',');
            }
            self.text += &quoted(cell.as_ref());
        }
        self.text.push('\n');
    }

    /// Adds a row of numbers.
    pub fn push_numbers<'a>(&mut self, values: impl IntoIterator<Item = &'a f64>) {
        for (i, value) in values.into_iter().enumerate() {
            if i > 0 {
                self.text.push(',');
            }
            // Writing to a String does not fail.
            let _ = write!(self.text, "{value:?}");
        }
        self.text.push('\n');
    }

    /// Adds rows that are text already.
    pub(crate) fn append(&mut self, rows: &[u8]) {
        self.text += &String::from_utf8_lossy(rows);
    }

    /// The text of the file.
    #[must_use]
    pub fn as_bytes(&self) -> &[u8] {
        self.text.as_bytes()
    }
}

/// A CSV file being written row by row; it is at its place once it is finished.
#[derive(Debug)]
pub(crate) struct CsvWriter {
    file: AtomicFile,
    row: CsvText,
}

impl CsvWriter {
    /// Begins the file `path` with these columns.
    pub(crate) fn create<T: AsRef<str>>(
        path: &Path,
        columns: impl IntoIterator<Item = T>,
    ) -> Result<Self, RecordError> {
        let row = CsvText::new(columns);
        let mut file = AtomicFile::create(path)?;
        file.write(row.as_bytes())?;
        Ok(Self { file, row })
    }

    /// Adds a row of numbers.
    pub(crate) fn push_numbers<'a>(
        &mut self,
        values: impl IntoIterator<Item = &'a f64>,
    ) -> Result<(), RecordError> {
        self.row.text.clear();
        self.row.push_numbers(values);
        self.file.write(self.row.as_bytes())
    }

    /// Adds rows that are text already.
    pub(crate) fn append(&mut self, rows: &[u8]) -> Result<(), RecordError> {
        self.file.write(rows)
    }

    /// Puts the file at its place.
    pub(crate) fn finish(self) -> Result<(), RecordError> {
        self.file.finish()
    }
}

/// A cell as it has to be written: names may hold commas and quotes.
fn quoted(cell: &str) -> std::borrow::Cow<'_, str> {
    if cell.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", cell.replace('"', "\"\"")).into()
    } else {
        cell.into()
    }
}

/// The shortest text that reads back as the same number.
#[must_use]
pub fn number(value: f64) -> String {
    format!("{value:?}")
}

/// A number with so many decimals; one that they would leave with less than two digits, or with many,
/// with an exponent.
#[must_use]
pub fn decimals(value: f64, count: usize) -> String {
    let least = 10_f64.powi(1 - i32::try_from(count).unwrap_or(i32::MAX));
    if value == 0.0 || (least..1e9).contains(&value.abs()) || !value.is_finite() {
        format!("{value:.count$}")
    } else {
        format!("{value:.count$e}")
    }
}

/// A CSV file that was read: its header, and its rows as text.
#[derive(Debug)]
pub(crate) struct CsvFile {
    pub(crate) head: CsvHead,
    pub(crate) rows: Vec<StringRecord>,
}

impl CsvFile {
    /// Reads a file; `None` if it does not exist.
    pub(crate) fn read(path: &Path) -> Result<Option<Self>, RecordError> {
        CsvReader::open(path)?.map(Self::of).transpose()
    }

    fn of<R: Read>(reader: CsvReader<R>) -> Result<Self, RecordError> {
        let CsvReader { head, reader } = reader;
        let rows = reader.into_records().map(|row| row.map_err(|source| head.damaged(source)));
        let rows = rows.collect::<Result<_, _>>()?;
        Ok(Self { head, rows })
    }
}

/// A CSV file being read row by row.
#[derive(Debug)]
pub(crate) struct CsvReader<R> {
    pub(crate) head: CsvHead,
    reader: Reader<R>,
}

impl CsvReader<File> {
    /// Begins to read a file; `None` if it does not exist.
    pub(crate) fn open(path: &Path) -> Result<Option<Self>, RecordError> {
        match File::open(path) {
            Ok(file) => Self::new(path, file).map(Some),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            Err(error) => Err(RecordError::unreadable(path)(error)),
        }
    }
}

impl<R: Read> CsvReader<R> {
    fn new(path: &Path, from: R) -> Result<Self, RecordError> {
        let mut reader = ReaderBuilder::new().trim(Trim::All).from_reader(from);
        let mut head = CsvHead { path: path.to_owned(), header: StringRecord::new() };
        head.header = reader.headers().map_err(|source| head.damaged(source))?.clone();
        Ok(Self { head, reader })
    }

    /// The next row; `None` at the end.
    pub(crate) fn next_row(&mut self) -> Option<Result<StringRecord, RecordError>> {
        let mut row = StringRecord::new();
        match self.reader.read_record(&mut row) {
            Ok(true) => Some(Ok(row)),
            Ok(false) => None,
            Err(source) => Some(Err(self.head.damaged(source))),
        }
    }
}

/// The header of a CSV file, by which cells are found.
#[derive(Debug)]
pub(crate) struct CsvHead {
    path: PathBuf,
    pub(crate) header: StringRecord,
}

impl CsvHead {
    fn damaged(&self, source: ::csv::Error) -> RecordError {
        let path = self.path.clone();
        let line = source.position().map_or(1, ::csv::Position::line);
        if source.is_io_error() {
            return RecordError::Unreadable { path, source: source.into() };
        }
        RecordError::Table { path, line, problem: TableProblem::Syntax(source) }
    }

    /// The place of a column, if the file has it.
    pub(crate) fn position(&self, column: &str) -> Option<usize> {
        self.header.iter().position(|name| name == column)
    }

    /// The place of a column that the file has to have.
    pub(crate) fn place(&self, column: &str) -> Result<usize, RecordError> {
        self.position(column).ok_or_else(|| self.missing(column))
    }

    /// The places of the columns that `form` makes of some names.
    pub(crate) fn places(
        &self,
        names: &[String],
        form: impl Fn(&str) -> String,
    ) -> Result<Vec<usize>, RecordError> {
        names.iter().map(|name| self.place(&form(name))).collect()
    }

    /// The error that a column is missing.
    pub(crate) fn missing(&self, column: &str) -> RecordError {
        let found = self.header.iter().map(str::to_owned).collect();
        let problem = TableProblem::MissingColumn { column: column.to_owned(), found };
        RecordError::Table { path: self.path.clone(), line: 1, problem }
    }

    /// The error that a cell holds no number.
    pub(crate) fn not_a_number(&self, row: &StringRecord, place: usize) -> RecordError {
        let column = self.header.get(place).unwrap_or_default().to_owned();
        let text = row.get(place).unwrap_or_default().to_owned();
        let line = row.position().map_or(1, ::csv::Position::line);
        let problem = TableProblem::NotANumber { column, text };
        RecordError::Table { path: self.path.clone(), line, problem }
    }

    /// The number in a cell; an empty cell is NaN.
    pub(crate) fn number(&self, row: &StringRecord, place: usize) -> Result<f64, RecordError> {
        match row.get(place).unwrap_or_default() {
            "" => Ok(f64::NAN),
            text => text.parse().map_err(|_| self.not_a_number(row, place)),
        }
    }

    /// The whole number in a cell.
    pub(crate) fn whole(&self, row: &StringRecord, place: usize) -> Result<usize, RecordError> {
        let text = row.get(place).unwrap_or_default();
        text.parse().map_err(|_| self.not_a_number(row, place))
    }

    /// The numbers in some cells.
    pub(crate) fn numbers(
        &self,
        row: &StringRecord,
        places: impl IntoIterator<Item = usize>,
    ) -> Result<Vec<f64>, RecordError> {
        places.into_iter().map(|place| self.number(row, place)).collect()
    }

    /// The error of a row that serde cannot turn into a struct whose fields are the columns.
    pub(crate) fn row_error(&self, row: &StringRecord, error: ::csv::Error) -> RecordError {
        let ::csv::ErrorKind::Deserialize { err, .. } = error.kind() else {
            let line = row.position().map_or(1, ::csv::Position::line);
            let problem = TableProblem::Syntax(error);
            return RecordError::Table { path: self.path.clone(), line, problem };
        };
        let field = err.field().and_then(|field| usize::try_from(field).ok());
        let message = err.kind().to_string();
        // serde's message for a field without a column.
        let missing = message.strip_prefix("missing field `").and_then(|m| m.strip_suffix('`'));
        match missing {
            Some(column) => self.missing(column),
            None => self.not_a_number(row, field.unwrap_or_default()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_and_large_numbers_keep_their_digits() {
        for (value, text) in [
            (113.572_94, "113.5729"),
            (0.0123, "0.0123"),
            (0.0, "0.0000"),
            (9.5e-4, "9.5000e-4"),
            (-4.4361e-10, "-4.4361e-10"),
            (1e18, "1.0000e18"),
            (f64::NAN, "NaN"),
        ] {
            assert_eq!(decimals(value, 4), text);
        }
    }

    #[test]
    fn cells_with_commas_and_quotes_read_back_as_they_were() {
        let mut table = CsvText::new(["name", "value, of it"]);
        table.push(["a \"b\", c", "1"]);
        table.push(["", "-0.0"]);
        let text = String::from_utf8(table.as_bytes().to_vec()).unwrap();
        let reader = CsvReader::new("t.csv".as_ref(), text.as_bytes()).unwrap();
        let CsvFile { head, rows } = CsvFile::of(reader).unwrap();
        assert_eq!(&head.header, &vec!["name", "value, of it"]);
        assert_eq!(&rows[0], &vec!["a \"b\", c", "1"]);
        assert_eq!(head.number(&rows[1], 1).unwrap().to_bits(), (-0.0f64).to_bits());
        assert!(head.number(&rows[1], 0).unwrap().is_nan());
    }
}
