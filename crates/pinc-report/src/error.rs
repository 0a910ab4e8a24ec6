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
    /// A directory of a sweep, where runs are compared.
    #[error(
        "{}: a sweep, whose report compares its trials; expected the directory of a run",
        dir.display()
    )]
    ComparedSweep {
        /// The directory.
        dir: PathBuf,
    },
    /// The results of a command that makes no runs.
    #[error("{}: results of `{command}`, not of a run; see {}", dir.display(), place.display())]
    NotOfARun {
        /// The directory.
        dir: PathBuf,
        /// The command.
        command: &'static str,
        /// The report or table of these results.
        place: PathBuf,
    },
    /// What a command that makes no runs began and did not finish.
    #[error("{}: `{command}` was interrupted; run it again to its end", dir.display())]
    Unfinished {
        /// The directory.
        dir: PathBuf,
        /// The command.
        command: &'static str,
    },
    /// A run without results.
    #[error("{}: the run has no metrics.json; finish it with `pinc run --resume`", dir.display())]
    NoMetrics {
        /// The directory.
        dir: PathBuf,
    },
    /// Two runs with different plants.
    #[error(
        "{}: its plant is {plant}; expected the plant of {}, {expected}",
        dir.display(),
        first.display()
    )]
    OtherPlant {
        /// The directory.
        dir: PathBuf,
        /// Its plant.
        plant: String,
        /// The directory that it is compared with.
        first: PathBuf,
        /// The plant of that.
        expected: String,
    },
    /// A page whose name leaves none for the directory of its pictures.
    #[error("--out {}: expected a file name with an ending, as results.md", path.display())]
    PageWithoutEnding {
        /// The file.
        path: PathBuf,
    },
}
