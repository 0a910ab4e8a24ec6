//! `steps.csv`: one row per control step.

use super::fixed::exact;
use crate::metrics::is_failure;
use pinc_mpc::SqpStatus;
use serde::{Deserialize, Serialize};

/// One step of a controller.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StepRow {
    /// Number of the step, from 0.
    pub step: usize,
    /// How the optimization ended, as [`SqpStatus`] is displayed.
    pub status: String,
    /// How many quadratic programs were solved, and iterations of the barrier method taken.
    pub sqp_iterations: usize,
    /// The largest KKT residual.
    #[serde(serialize_with = "exact")]
    pub kkt: f64,
    /// The controller's time, in us: the median of the repetitions of the loop.
    #[serde(serialize_with = "exact")]
    pub solve_us: f64,
    /// The hard constraint that could not be met; empty if there is none.
    #[serde(default)]
    pub violated: String,
    /// At how many stages the model was linearized.
    #[serde(default)]
    pub linearized: usize,
    /// How many matrices were factored for these programs.
    #[serde(default)]
    pub factorizations: usize,
    /// How many constraints became active or ceased to be, in all.
    #[serde(default)]
    pub active_changes: usize,
}

impl StepRow {
    /// Whether the optimization converged, or a net's plan was checked in its place.
    #[must_use]
    pub fn converged(&self) -> bool {
        use SqpStatus::{Converged, Kept, Replaced};
        [Converged, Kept, Replaced].iter().any(|status| self.status == status.to_string())
    }

    /// Whether the step failed: it neither converged, nor is it one of a real-time iteration, which
    /// is not judged, nor did the time budget end it.
    #[must_use]
    pub fn failed(&self) -> bool {
        is_failure(&self.status)
    }
}
