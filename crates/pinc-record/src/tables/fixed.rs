//! Tables with the same columns in every run: those of a struct, whose fields are the columns.

use crate::csv::{CsvFile, CsvText, number};
use crate::error::RecordError;
use serde::de::DeserializeOwned;
use serde::{Serialize, Serializer};
use std::path::Path;

/// The table of these rows.
///
/// # Panics
///
/// Never: the fields of a row are numbers and texts.
#[must_use]
pub fn fixed_table<R: Serialize + Default>(rows: &[R]) -> CsvText {
    let plain = "the fields of a row are numbers and texts";
    let mut writer = csv::Writer::from_writer(Vec::new());
    // The header comes with the first row; there may be none.
    writer.serialize(R::default()).expect(plain);
    let text = String::from_utf8(writer.into_inner().expect(plain)).expect(plain);
    let header = text.lines().next().unwrap_or_default();
    let mut table = CsvText::new(header.split(','));
    let mut cells = csv::WriterBuilder::new().has_headers(false).from_writer(Vec::new());
    for row in rows {
        cells.serialize(row).expect(plain);
    }
    table.append(&cells.into_inner().expect(plain));
    table
}

/// The rows of a table; `None` if the file does not exist.
///
/// # Errors
///
/// [`RecordError`], with the line and column of what is wrong.
pub fn read_fixed_table<R: DeserializeOwned>(path: &Path) -> Result<Option<Vec<R>>, RecordError> {
    let Some(file) = CsvFile::read(path)? else { return Ok(None) };
    let row = |row| {
        let parsed = csv::StringRecord::deserialize(row, Some(&file.header));
        parsed.map_err(|error| file.row_error(row, error))
    };
    file.rows.iter().map(row).collect::<Result<_, _>>().map(Some)
}

/// A number in its shortest exact form.
pub(super) fn exact<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(&number(*value))
}

/// The same of a number that may be missing.
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
