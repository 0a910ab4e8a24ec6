//! The `[one_step]` section.

use serde::{Deserialize, Serialize};

/// One step of each of the controller's models by itself: how wrong it is over `[domain]`, and how
/// long it takes, alone and with Jacobians.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OneStepSpec {
    /// Number of points that fill the domain.
    pub points: usize,
    /// Local error tolerance of the integration that is the truth.
    pub tolerance: f64,
    /// Time in s that each measurement of a time takes.
    pub measure_s: f64,
}
