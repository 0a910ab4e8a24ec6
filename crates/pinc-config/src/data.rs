//! The `[data]` section.

use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Measurements of the plant, which the net is fitted to beside the equation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DataSpec {
    /// CSV files to train on, of trajectories or of single steps. Paths are relative to the working directory.
    pub files: Vec<PathBuf>,
    /// CSV files that are not trained on: the net with the smallest error on them is chosen.
    pub held_out: Vec<PathBuf>,
    /// Weight of the mean squared error of the measurements in the loss.
    pub weight: f64,
    /// Names of unknown parameters of the plant, trained with the net from their values in `[plant]` on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parameters: Vec<String>,
}
