//! Why a report cannot be made.

use pinc_config::ConfigError;
use pinc_record::RecordError;
use std::path::PathBuf;
use thiserror::Error;

/// Why no report or page could be made. A missing file is none of these: its section is left out.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ReportError {
    /// A file of the run cannot be read or is damaged.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// The config of the run is damaged.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A directory without runs of the paper.
    #[error(
        "{}: no runs of the paper's experiments; expected <experiment>/<preset>/ as \
         `pinc run configs/paper.toml` writes them",
        dir.display()
    )]
    NoPaperRuns {
        /// The directory.
        dir: PathBuf,
    },
    /// A page whose name leaves none for the directory of its pictures.
    #[error("--out {}: expected a file name with an ending, as results.md", path.display())]
    PageWithoutEnding {
        /// The file.
        path: PathBuf,
    },
}
