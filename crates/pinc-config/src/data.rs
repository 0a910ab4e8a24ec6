//! The `[data]` section.

use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Measurements of the plant, which the net is fitted to beside the equation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DataSpec {
    /// CSV files to train on, of trajectories or of single steps; like all paths of the program,
    /// seen from the working directory.
    pub files: Vec<PathBuf>,
    /// CSV files that are not trained on: the best net is chosen by its error on them.
    pub held_out: Vec<PathBuf>,
    /// The weight of the measurements' mean squared error in the loss.
    pub weight: f64,
    /// Parameters of the plant that are unknown: they are trained with the net, from their values
    /// in `[plant]` on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parameters: Vec<String>,
}
