//! The `[prediction]` section.

use serde::{Deserialize, Serialize};

/// A free run of the trained net against the truth, for the report: the inputs are redrawn every T,
/// uniformly between their bounds. A conventional PINN is evaluated over the same time, beyond its
/// T too; initial state and input have to be its scenario's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PredictionSpec {
    /// Length of the run in s, a whole number of T.
    pub duration_s: f64,
    /// Initial state, in the plant's order and units.
    pub initial_state: Vec<f64>,
    /// Lower ends of the ranges that inputs are drawn from.
    pub input_low: Vec<f64>,
    /// Upper ends of the ranges that inputs are drawn from.
    pub input_high: Vec<f64>,
    /// Number of parts of each T, at whose ends the net is evaluated.
    pub subintervals: usize,
    /// Local error tolerance of the integration that is the truth.
    pub tolerance: f64,
}
