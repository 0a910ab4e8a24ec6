#![doc = include_str!("../README.md")]
//! # Tour
//!
//! - [`NmpcBatch`]: one controller, many states and references: [`NmpcBatch::steps`] with inputs,
//!   [`NmpcBatch::gradients`] with derivatives of the inputs, [`NmpcBatch::loops`] with closed loops,
//!   [`NmpcBatch::loop_gradients`] with the gradients of their costs.
//! - [`ModelBatch`]: one model, many states and inputs.

#![forbid(unsafe_code)]

mod delay;
mod loop_gradients;
mod loops;
mod models;
mod rows;
mod share;
mod steps;

pub use loop_gradients::{GradientLoops, LoopCost, LoopGradient};
pub use loops::{LoopTrace, Loops};
pub use models::ModelBatch;
pub use steps::{GradientBatch, NmpcBatch, Situations, StepBatch};
