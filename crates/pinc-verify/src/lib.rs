#![doc = include_str!("../README.md")]
//! # Tour
//!
//! A [`StepError`] compares one step of a model (a net or a Runge-Kutta method) with the exact flow
//! of its equation. [`StepError::at_points`] encloses the error at points. A [`Search`] brackets the
//! largest error over a whole box of states, inputs and parameters: between the largest error found
//! and a proven bound.
//!
//! # How boxes are enclosed
//!
//! 1. The model is evaluated on Taylor models (Makino and Berz): polynomials of the variables with
//!    bounded remainders. Interpolants at Chebyshev nodes replace functions; the Taylor coefficient
//!    of the next order bounds their remainder.
//! 2. Picard iterations give the flow as a polynomial of time and variables. Its defect is enclosed
//!    and propagated by the logarithmic norm of the Jacobian, in a tube that provably contains the
//!    true solution.
//! 3. The difference of the two polynomials is bounded.
//!
//! If the bound of a box is too wide, the box is cut in the variable that contributes most to the
//! remainders.
//!
//! # What a bound relies on
//!
//! The arithmetic rounds to nearest, and bounds of the rounding errors are added to the remainders;
//! no rounding mode is changed. Functions are computed from additions, multiplications and
//! divisions, with derived error bounds. The bound holds for the model and the equation in exact
//! arithmetic, with constants as the program stores them. Evaluating the model in floating point
//! adds rounding errors of about 1e-15 of the states.

#![forbid(unsafe_code)]

mod basis;
mod branching;
mod chained_error;
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
mod quantiles;
mod reference;
mod rough;
mod rounding;
mod search;
mod taylor;
mod workers;

pub use chained_error::ChainedError;
pub use error::VerifyError;
pub use estimate::{ErrorEstimate, NODES, quadrature_node};
pub use interval::Interval;
pub use points::{Largest, PointError};
pub use problem::{MOST_VARIABLES, StepError, StepModel};
pub use proof::SMALL_PROOF;
pub use quantiles::quantile_bound;
pub use reference::reference;
pub use search::{Bracket, Leaf, Search, SearchSettings};

#[cfg(test)]
mod tests;
