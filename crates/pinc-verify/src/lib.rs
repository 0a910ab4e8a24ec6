#![doc = include_str!("../README.md")]
//! # Tour
//!
//! A [`StepError`] is one step of a model, a net or a Runge-Kutta method, beside the exact flow of
//! the equation that it stands for. [`StepError::at_points`] encloses the error at points; a
//! [`Search`] brackets the largest error over a whole box of states, inputs and parameters, between
//! the largest found and a proven bound.
//!
//! # How boxes are enclosed
//!
//! 1. The model is evaluated on Taylor models (Makino and Berz): polynomials of the variables with a
//!    bound of what is missing. Functions are replaced by interpolants at Chebyshev nodes, with the
//!    remainder that the Taylor coefficient of the next order gives.
//! 2. The flow is a polynomial of time and variables from Picard iterations. Its defect is enclosed,
//!    and propagated by the logarithmic norm of the Jacobian in a tube which the true solution is
//!    proven not to leave.
//! 3. The two polynomials are subtracted, and the difference is bounded.
//!
//! A box whose bound is not good enough is cut in the variable that drives what is missing.
//!
//! # What a bound relies on
//!
//! The arithmetic rounds to nearest; bounds of the rounding errors are added to the remainders, so
//! that no rounding mode is changed. Functions are computed from additions, multiplications and
//! divisions, with errors that are argued. The model and the equation are those that the program
//! holds, with constants as they are stored, in exact arithmetic: evaluating the model in floating
//! point adds rounding errors, of the order of 1e-15 of the states.

#![forbid(unsafe_code)]

mod basis;
mod branching;
mod chebyshev;
mod elementary;
mod equation;
mod error;
mod estimate;
mod flow;
mod function;
mod growth;
mod interval;
mod kernel;
mod map;
mod parts;
mod points;
mod polynomial;
mod problem;
mod proof;
mod rough;
mod rounding;
mod search;
mod taylor;
mod workers;

pub use error::VerifyError;
pub use estimate::{ErrorEstimate, NODES, REFERENCE_SUBSTEPS, quadrature_node};
pub use interval::Interval;
pub use points::{Largest, PointError};
pub use problem::{MOST_VARIABLES, StepError, StepModel};
pub use proof::SMALL_PROOF;
pub use search::{Bracket, Leaf, Search, SearchSettings};

#[cfg(test)]
mod tests;
