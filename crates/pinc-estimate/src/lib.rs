#![doc = include_str!("../README.md")]
//! # Tour
//!
//! - [`Augmented`]: a model whose state is what an estimator estimates, and whose outputs are what
//!   is measured; made of a model and an [`Augmentation`]. [`Compensated`] is the model of the
//!   controller that uses the estimates.
//! - [`Estimator`]: the interface of the estimators [`Ekf`] (with a linear model, the Kalman
//!   filter), [`Ukf`] and, with bounds, [`Mhe`].
//! - [`OutputFeedback`]: sensors and an estimator in a [`ClosedLoop`](pinc_loop::ClosedLoop).
//! - [`SteadyTarget`]: what can be held of a reference under estimated disturbances.
//!
//! A status is a value, for a controller needs an estimate however a step ends; an
//! [`EstimateError`] means that the parts do not fit together.

#![forbid(unsafe_code)]

mod augmented;
mod compensated;
mod disturbance;
mod disturbed;
mod ekf;
mod error;
mod estimator;
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
pub use disturbed::Augmentation;
pub use ekf::Ekf;
pub use error::EstimateError;
pub use estimator::{Correction, Estimator, EstimatorStatus, Tuning};
pub use feedback::{History, OutputFeedback, state_covariance};
pub use gate::Gate;
pub use mhe::Mhe;
pub use target::SteadyTarget;
pub use ukf::Ukf;
