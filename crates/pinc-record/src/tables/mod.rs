//! The tables of runs and sweeps, each with the names of its columns.

mod control;
mod domain_error;
mod estimates;
mod fixed;
mod prediction;
mod residuals;
mod state_pairs;
mod steps;
mod summary;
mod training;
mod trial_metric;
mod trials;

pub use control::{ControlColumns, ControlReader, ControlRow, ControlWriter};
pub use domain_error::DomainErrorTable;
pub use estimates::{EstimateRow, EstimateTable};
pub use fixed::{FixedReader, FixedWriter, fixed_table, read_fixed_table};
pub use prediction::{PredictionRow, PredictionTable};
pub use residuals::{ResidualRow, ResidualTable};
pub use state_pairs::{Pair, PairRow, StatePairs};
pub use steps::StepRow;
pub use summary::{SummaryRow, SummaryTable};
pub use training::TrainingRow;
pub use trial_metric::{TrialMetric, UnknownMetric};
pub use trials::{TrialColumn, TrialStatus, TrialTable};
