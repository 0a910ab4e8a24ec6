//! Rigorous enclosures: what is proven of the error of one step of a model.
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
//!
//! ```
//! use pinc_expr::PlantEquations;
//! use pinc_ode::Tableau;
//! use pinc_plants::VanDerPol;
//! use pinc_verify::{Search, SearchSettings, StepError, StepModel};
//!
//! // RK4 with one step of 0.1 s, for states in [-1, 1] and inputs in [-1, 1].
//! let equations = PlantEquations::traced(VanDerPol::default());
//! let model = StepModel::RungeKutta(Tableau::CLASSICAL, 1);
//! let error = StepError::new(&equations, &[], 1, model, 0.1)?;
//! let mut search = Search::new(&error, &[[-1.0, 1.0]; 3], SearchSettings::default(), 1)?;
//! while !search.is_over() {
//!     search.round(&error, 1);
//! }
//! let bracket = search.bracket();
//! assert!(bracket.is_complete && bracket.proven[0] <= 1.1 * bracket.found[0].error);
//! # Ok::<(), pinc_verify::VerifyError>(())
//! ```

mod basis;
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
mod points;
mod polynomial;
mod problem;
mod rough;
mod rounding;
mod search;
mod taylor;
mod workers;

pub use error::VerifyError;
pub use estimate::{ErrorEstimate, NODES};
pub use interval::Interval;
pub use points::{Largest, PointError};
pub use problem::{MOST_VARIABLES, StepError, StepModel};
pub use search::{Bracket, Leaf, Search, SearchSettings};

#[cfg(test)]
mod tests;
