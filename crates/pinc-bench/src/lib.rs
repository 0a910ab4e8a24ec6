//! Experiments with PINC: configs, runs and their results. The `pinc` program is a thin shell around
//! this library.
//!
//! - [`Experiment`]: a config file, resolved and checked ([`spec`] has its parts).
//! - [`run`], [`train`], [`control`], [`predict`], [`check`], [`rebuild_report`]: what the program does.
//! - [`Record`]: the results of a run, in its directory; [`Provenance`]: where they come from.
//!
//! This is the only crate of the project that opens files, writes to the terminal and reads a clock.

pub mod console;
mod error;
mod presets;
mod progress;
mod provenance;
mod record;
mod registry;
pub mod report;
mod runs;
pub mod spec;
mod summary;

pub use error::{BenchError, CheckpointProblem, CsvProblem};
pub use presets::Preset;
pub use progress::Verbosity;
pub use provenance::Provenance;
pub use record::{
    ControlMetrics, Metrics, PredictionMetrics, Record, StepTimes, TrainingMetrics,
    ValidationMetrics, WallTimes,
};
pub use runs::{Finding, Options, Severity, check, control, predict, rebuild_report, run, train};
pub use spec::{Experiment, ModelKind};
pub use summary::summary;
