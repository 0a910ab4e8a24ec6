//! The tables of runs and sweeps, each with the names of its columns.

mod control;
mod fixed;
mod prediction;
mod steps;
mod summary;
mod training;
mod trials;

pub use control::{ControlRow, ControlTrace};
pub use fixed::{fixed_table, read_fixed_table};
pub use prediction::{PredictionRow, PredictionTable};
pub use steps::StepRow;
pub use summary::{SummaryRow, SummaryTable};
pub use training::TrainingRow;
pub use trials::{LoopMetric, StepMetric, TrialColumn, TrialMetric, TrialStatus, TrialTable};
