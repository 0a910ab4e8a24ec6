//! The progress of a training.

use serde::{Deserialize, Serialize};

/// The results of one iteration.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct IterationRecord {
    /// Iterations done, over all phases.
    pub iteration: u64,
    /// Index of the phase.
    pub phase: usize,
    /// Evaluations of loss and gradient so far.
    pub loss_evaluations: u64,
    /// The loss.
    pub loss: f64,
    /// Its term `MSE_y`.
    pub loss_data: f64,
    /// Its term lambda `MSE_F`.
    pub loss_physics: f64,
    /// Its term of the measurements, weight `MSE_D`.
    pub loss_measured: f64,
    /// Norm of its gradient.
    pub gradient_norm: f64,
    /// Collocation points in use.
    pub collocation_points: usize,
    /// The loss on fresh points, if it was computed in this iteration.
    pub fresh_loss: Option<f64>,
}

/// Why a training ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StopReason {
    /// All phases ran their iterations.
    IterationsDone,
    /// The gradient fell below its tolerance in the last phase.
    GradientTolerance,
    /// No further descent was found in the last phase, usually because of rounding.
    NoFurtherDescent,
    /// The net reached the accuracy asked for.
    TargetReached,
}

impl std::fmt::Display for StopReason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.serialize(f)
    }
}

/// The result of [`Trainer::step`](crate::Trainer::step).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Progress {
    /// One iteration was done.
    Iterated(IterationRecord),
    /// The training is over; further steps return the same.
    Finished(StopReason),
}

/// Work done so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Totals {
    /// Iterations, over all phases.
    pub iterations: u64,
    /// Evaluations of loss and gradient.
    pub loss_evaluations: u64,
}
