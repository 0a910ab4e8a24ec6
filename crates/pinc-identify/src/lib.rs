#![doc = include_str!("../README.md")]
//! # Tour
//!
//! - [`Problem`]: what is measured ([`Channel`]), what is unknown ([`Unknown`], [`InitialState`]),
//!   and where the fit starts; [`Recording`]: the data.
//! - [`identify`]: fits by single shooting or, if needed, by multiple shooting;
//!   [`identify_from_starts`] fits from many starts and takes the best.
//! - [`weighed_by_residuals`]: repeats a fit until each channel counts by its residuals.
//! - [`simulate_held_out`]: tests the fit on data that it has not seen.
//! - [`Identified`]: values with 95 % intervals, correlations, residuals, and a [`Diagnosis`]: which
//!   parameters the data do not determine, and what looks wrong.
//!
//! An [`IdentifyError`] means that the parts do not fit together. A poor fit is not an error; the
//! diagnosis reports it.

#![forbid(unsafe_code)]

mod analysis;
mod diagnosis;
mod error;
mod fit;
mod held_out;
mod identify;
mod influence;
mod linear;
mod method;
mod noise;
mod points;
mod problem;
mod progress;
mod result;
mod shooting;
mod starts;
mod student;
mod trajectory;
mod triangle;
mod whiteness;

pub use diagnosis::{Diagnosis, Side};
pub use error::IdentifyError;
pub use fit::FitStatus;
pub use held_out::{fitted_steps, simulate_held_out};
pub use identify::identify;
pub use method::{Method, Why};
pub use noise::weighed_by_residuals;
pub use pinc_estimate::Measured;
pub use problem::{Channel, Criterion, InitialState, Prior, Problem, Recording, Unknown};
pub use result::{ChannelFit, Estimate, Identified, InputCorrelation};
pub use starts::{Start, Starts, identify_from_starts};
pub use trajectory::Work;
