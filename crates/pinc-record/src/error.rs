//! Errors of a run directory.

use pinc_net::NetError;
use std::io;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// A file or directory of a run that cannot be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RecordError {
    /// A file or directory that cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Unreadable {
        /// The file or directory.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A file or directory that cannot be written.
    #[error("{}: cannot be written: {source}", path.display())]
    Unwritable {
        /// The file or directory.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A file to be written that is read as well.
    #[error("{option} {}: is also {input}, which it would overwrite", path.display())]
    AlsoRead {
        /// What asks for the file.
        option: &'static str,
        /// The file.
        path: PathBuf,
        /// What it is read as.
        input: String,
    },
    /// The run directory belongs to another config.
    #[error(
        "{}: belongs to a run of another config (its config.toml differs); choose another \
        directory \
         with --out, or delete this one",
        dir.display()
    )]
    OtherConfig {
        /// The directory.
        dir: PathBuf,
    },
    /// The directory holds something else than a run.
    #[error(
        "{}: holds files, but no config.toml of a run; choose another directory",
        dir.display()
    )]
    NoRunDirectory {
        /// The directory.
        dir: PathBuf,
    },
    /// Another process works on the run.
    #[error(
        "{}: {} works on this run; wait until it is done, or choose another directory with --out",
        dir.display(),
        holder.map_or("another process".to_owned(), |id| format!("process {id}"))
    )]
    Locked {
        /// The directory.
        dir: PathBuf,
        /// Its id, if it is known.
        holder: Option<u32>,
    },
    /// The directory does not exist or is a file.
    #[error("{}: not a directory, or it does not exist", path.display())]
    NotADirectory {
        /// Its path.
        path: PathBuf,
    },
    /// A checkpoint that training cannot be resumed from.
    #[error("{}: {problem}; without --resume the run starts afresh", path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: CheckpointProblem,
    },
    /// A damaged JSON file.
    #[error("{}:{}: damaged JSON: {source}", path.display(), source.line())]
    Json {
        /// The file.
        path: PathBuf,
        /// What the JSON reader says.
        source: serde_json::Error,
    },
    /// A damaged table.
    #[error("{}:{line}: {problem}", path.display())]
    Table {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: u64,
        /// What is wrong there.
        problem: TableProblem,
    },
}

/// A problem with a table of a run.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum TableProblem {
    /// A row with too few or too many cells, or bytes that are no text.
    #[error("damaged CSV: {0}")]
    Syntax(csv::Error),
    /// A column that is missing.
    #[error("no column `{column}` (found: {})", found.join(", "))]
    MissingColumn {
        /// The column that was expected.
        column: String,
        /// The columns that the table has.
        found: Vec<String>,
    },
    /// A cell that holds something other than a number.
    #[error("column `{column}`: expected a number, found `{text}`")]
    NotANumber {
        /// The column.
        column: String,
        /// The cell.
        text: String,
    },
}

/// A problem with a checkpoint.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CheckpointProblem {
    /// Another kind of file.
    #[error("not a checkpoint of a PINC training")]
    Foreign,
    /// Written by another version of the program.
    #[error("written by another version of pinc (format {0})")]
    Version(u32),
    /// Truncated or changed.
    #[error("damaged: its checksum does not fit")]
    Damaged,
    /// Belongs to another config.
    #[error("belongs to another config or other measurements")]
    OtherConfig,
    /// The training does not accept it.
    #[error("{0}")]
    Training(Box<NetError>),
    /// The training log beside it is missing or damaged.
    #[error("training.csv beside it is missing, damaged or too short")]
    TrainingLog,
}

impl RecordError {
    /// Turns the error of reading `path` into one of this type.
    pub fn unreadable(path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Unreadable { path, source }
    }

    /// Turns the error of writing `path` into one of this type.
    pub fn unwritable(path: &Path) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Unwritable { path, source }
    }
}
