//! What a training reports.

use serde::{Deserialize, Serialize};

/// What one iteration came to.
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
    /// No further descent was found in the last phase: rounding allows none.
    NoFurtherDescent,
    /// The net is as accurate as wanted.
    TargetReached,
}

impl std::fmt::Display for StopReason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::IterationsDone => "iterations-done",
            Self::GradientTolerance => "gradient-tolerance",
            Self::NoFurtherDescent => "no-further-descent",
            Self::TargetReached => "target-reached",
        })
    }
}

/// What [`Trainer::step`](crate::Trainer::step) came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Progress {
    /// An iteration.
    Iterated(IterationRecord),
    /// The end; further steps say the same.
    Finished(StopReason),
}

/// Work done so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Totals {
    /// Iterations of optimizers.
    pub iterations: u64,
    /// Evaluations of loss and gradient.
    pub loss_evaluations: u64,
}
