//! What can be wrong with a run directory.

use std::path::PathBuf;
use thiserror::Error;

/// Why no report could be made. A missing file is none of these: its section is left out.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ReportError {
    /// The directory does not exist or is a file.
    #[error("{}: not a directory", path.display())]
    NotADirectory {
        /// What was to be reported.
        path: PathBuf,
    },
    /// A file exists but cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A CSV file is damaged: a row with too few cells, or bytes that are no text.
    #[error("{}:{line}: damaged CSV: {source}", path.display())]
    Csv {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: u64,
        /// What the CSV reader says.
        source: csv::Error,
    },
    /// A CSV file lacks a column.
    #[error("{}:1: no column `{column}` (found: {})", path.display(), found.join(", "))]
    MissingColumn {
        /// The file.
        path: PathBuf,
        /// The column that was expected.
        column: String,
        /// The columns that it has.
        found: Vec<String>,
    },
    /// A CSV cell holds something other than a number.
    #[error("{}:{line}: column `{column}`: expected a number, found `{text}`", path.display())]
    NotANumber {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: u64,
        /// The column.
        column: String,
        /// The cell.
        text: String,
    },
    /// A JSON file is damaged.
    #[error("{}:{}: damaged JSON: {source}", path.display(), source.line())]
    Json {
        /// The file.
        path: PathBuf,
        /// What the JSON reader says.
        source: serde_json::Error,
    },
    /// A TOML file is damaged.
    #[error("{}:{line}: damaged TOML: {}", path.display(), source.message())]
    Toml {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: usize,
        /// What the TOML reader says.
        source: Box<toml::de::Error>,
    },
}
