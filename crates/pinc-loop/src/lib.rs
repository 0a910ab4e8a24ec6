#![doc = include_str!("../README.md")]
//! # Tour
//!
//! - [`ClosedLoop`]: the controller and the plant step by step, each [`Control`] with its
//!   [`StepRecord`]; [`LoopRecord`] keeps the whole trace.
//! - [`Observer`]: sensors and an estimator between the two.
//! - [`Segment`] and [`Violation`]: how the loop ends each part of a reference, and which bounds the
//!   plant broke.

#![forbid(unsafe_code)]

mod closed_loop;
mod loop_errors;
mod loop_record;
mod observer;
mod segment;
mod violation;

pub use closed_loop::{ClosedLoop, Control, StepRecord};
pub use loop_record::LoopRecord;
pub use observer::{Observer, PlantNow};
pub use segment::Segment;
pub use violation::Violation;
