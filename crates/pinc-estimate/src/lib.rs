#![doc = include_str!("../README.md")]
//! # Tour
//!
//! - [`Augmented`]: a model with an [`Augmentation`]. Its state holds everything that is estimated,
//!   its outputs everything that is measured. [`Compensated`] is the controller's model with the
//!   estimates.
//! - [`Estimator`]: the interface of the estimators [`Ekf`] (with a linear model, the Kalman
//!   filter), [`Ukf`] and, with bounds, [`Mhe`].
//! - [`OutputFeedback`]: sensors and an estimator in a [`ClosedLoop`](pinc_loop::ClosedLoop).
//! - [`SteadyTarget`]: the steady state nearest to a reference under estimated disturbances.
//!
//! A failed step is a status, not an error, because a controller needs an estimate in any case. An
//! [`EstimateError`] means that the parts do not fit together.

#![forbid(unsafe_code)]

mod augmented;
mod compensated;
mod disturbance;
mod disturbed;
mod ekf;
mod error;
mod estimator;
mod extended;
mod feedback;
mod gate;
mod kalman;
mod matrix;
mod mhe;
mod target;
mod ukf;

pub use augmented::Augmented;
pub use compensated::Compensated;
pub use disturbance::{Disturbance, Measured};
pub use disturbed::{Augmentation, InnerArguments};
pub use ekf::Ekf;
pub use error::EstimateError;
pub use estimator::{Correction, Estimator, EstimatorStatus, Tuning};
pub use feedback::{History, OutputFeedback};
pub use gate::Gate;
pub use mhe::Mhe;
pub use target::SteadyTarget;
pub use ukf::Ukf;
