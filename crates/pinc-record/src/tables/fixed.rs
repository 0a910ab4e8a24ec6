//! Tables with the same columns in every run: the fields of a struct.

use crate::csv::{CsvHead, CsvReader, CsvText, CsvWriter, number};
use crate::error::RecordError;
use csv::StringRecord;
use serde::de::DeserializeOwned;
use serde::{Serialize, Serializer};
use std::fs::File;
use std::marker::PhantomData;
use std::path::Path;

/// Why a row can be written.
const PLAIN: &str = "the fields of a row are numbers and texts";

/// The table of these rows.
///
/// # Panics
///
/// Never: the fields of a row are numbers and texts.
#[must_use]
pub fn fixed_table<R: Serialize + Default>(rows: &[R]) -> CsvText {
    let mut table = CsvText::new(columns::<R>());
    table.append(&lines(rows));
    table
}

/// The names of the columns.
pub(super) fn columns<R: Serialize + Default>() -> Vec<String> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    // The header comes with the first row; there may be none.
    writer.serialize(R::default()).expect(PLAIN);
    let text = String::from_utf8(writer.into_inner().expect(PLAIN)).expect(PLAIN);
    text.lines().next().unwrap_or_default().split(',').map(str::to_owned).collect()
}

/// The lines of these rows.
pub(super) fn lines<R: Serialize>(rows: &[R]) -> Vec<u8> {
    let mut cells = csv::WriterBuilder::new().has_headers(false).from_writer(Vec::new());
    for row in rows {
        cells.serialize(row).expect(PLAIN);
    }
    cells.into_inner().expect(PLAIN)
}

/// Such a table being written row by row; it is at its place once it is finished.
#[derive(Debug)]
pub struct FixedWriter<R> {
    file: CsvWriter,
    rows: PhantomData<R>,
}

impl<R: Serialize + Default> FixedWriter<R> {
    /// Begins the file `path`.
    ///
    /// # Errors
    ///
    /// [`RecordError::Unwritable`], as of the other methods.
    pub fn create(path: &Path) -> Result<Self, RecordError> {
        Ok(Self { file: CsvWriter::create(path, columns::<R>())?, rows: PhantomData })
    }

    /// Adds a row.
    ///
    /// # Errors
    ///
    /// [`RecordError::Unwritable`].
    pub fn push(&mut self, row: &R) -> Result<(), RecordError> {
        self.file.append(&lines(std::slice::from_ref(row)))
    }

    /// Puts the file at its place.
    ///
    /// # Errors
    ///
    /// [`RecordError::Unwritable`].
    pub fn finish(self) -> Result<(), RecordError> {
        self.file.finish()
    }
}

/// The rows of such a table, read one by one.
#[derive(Debug)]
pub struct FixedReader<R> {
    file: CsvReader<File>,
    rows: PhantomData<R>,
}

impl<R: DeserializeOwned> FixedReader<R> {
    /// Begins to read the file `path`; `None` if it does not exist.
    ///
    /// # Errors
    ///
    /// [`RecordError`], with the line of what is wrong.
    pub fn open(path: &Path) -> Result<Option<Self>, RecordError> {
        let file = CsvReader::open(path)?;
        Ok(file.map(|file| Self { file, rows: PhantomData }))
    }
}

/// The rows, each with the line and column of what is wrong.
impl<R: DeserializeOwned> Iterator for FixedReader<R> {
    type Item = Result<R, RecordError>;

    fn next(&mut self) -> Option<Self::Item> {
        let row = self.file.next_row()?;
        Some(row.and_then(|row| parse(&self.file.head, &row)))
    }
}

pub(super) fn parse<R: DeserializeOwned>(
    head: &CsvHead,
    row: &StringRecord,
) -> Result<R, RecordError> {
    row.deserialize(Some(&head.header)).map_err(|error| head.row_error(row, error))
}

/// The rows of a table; `None` if the file does not exist.
///
/// # Errors
///
/// [`RecordError`], with the line and column of what is wrong.
pub fn read_fixed_table<R: DeserializeOwned>(path: &Path) -> Result<Option<Vec<R>>, RecordError> {
    FixedReader::open(path)?.map(Iterator::collect).transpose()
}

/// A number in its shortest exact form.
pub(super) fn exact<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&number(*value))
}

/// A number in its shortest exact form, or empty if it is missing.
pub(super) fn exact_or_empty<S: Serializer>(
    value: &Option<f64>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&value.map_or_else(String::new, number))
}

/// What is not known.
pub(super) fn nan() -> f64 {
    f64::NAN
}
