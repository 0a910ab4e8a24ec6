//! Errors of a control problem or a closed loop.

use crate::Tracked;
use pinc_ode::{ArgumentError, OdeError};
use pinc_qp::QpError;
use thiserror::Error;

/// An error of this crate. It means that something was put together wrongly, or that a simulated plant could
/// not be integrated; that an optimization did not converge is no error but a [`SqpStatus`](crate::SqpStatus).
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum MpcError {
    /// A list that does not fit what it is for.
    #[error(transparent)]
    Argument(#[from] ArgumentError),
    /// A whole number outside its range, as a horizon.
    #[error("{field} is {found}, but must be from {low} to {high}")]
    Range {
        /// What the number is.
        field: &'static str,
        /// The least it may be.
        low: usize,
        /// The most it may be.
        high: usize,
        /// What it is.
        found: usize,
    },
    /// Data of each stage, but not of as many stages as there are.
    #[error("{field} is given for {found} stages, but there are {expected}")]
    Stages {
        /// What is given.
        field: &'static str,
        /// How many stages there are.
        expected: usize,
        /// For how many it is given.
        found: usize,
    },
    /// An input that is said to have been applied, but is beyond its bounds.
    #[error("u_applied[{index}] is {value}, but must be within its bounds, {low} to {high}")]
    Applied {
        /// Its place among the inputs.
        index: usize,
        /// What it is.
        value: f64,
        /// Its bounds.
        low: f64,
        /// Its bounds.
        high: f64,
    },
    /// Scenarios where none can be.
    #[error("scenarios do not go with {0}")]
    WithScenarios(&'static str),
    /// A quantity that is tracked twice.
    #[error("tracked names {tracked} twice")]
    TrackedTwice {
        /// The quantity.
        tracked: Tracked,
    },
    /// Models of one horizon that are of different sizes.
    #[error(
        "the models of the horizon differ in their numbers of states, inputs, parameters or outputs"
    )]
    DifferentModels,
    /// A real-time iteration with a stage cost that leaves its Hessian to the optimization.
    #[error("a real-time iteration cannot have a stage cost without a Hessian of its own")]
    CurvedInRealTime,
    /// A tube where none can be.
    #[error("a tube does not go with {0}")]
    WithTube(&'static str),
    /// A plan that ends where it begins, where none can be.
    #[error("a periodic plan does not go with {0}")]
    WithOrbit(&'static str),
    /// Derivatives of a plan with whole inputs, or one that was not optimized, which have none.
    #[error("a plan with whole inputs, or of a net, has no derivatives")]
    SearchedDerivatives,
    /// Derivatives of a plan on a scenario tree.
    #[error("a plan for scenarios has no derivatives")]
    ScenarioDerivatives,
    /// A method that cannot solve the problem's quadratic programs.
    #[error(transparent)]
    Qp(#[from] QpError),
    /// A setting outside its range.
    #[error("{field} is {value}, but must be {expected}")]
    Setting {
        /// Its name.
        field: &'static str,
        /// What it must be.
        expected: &'static str,
        /// What it is.
        value: f64,
    },
    /// A lower bound above its upper bound.
    #[error("the bounds of {field}[{index}] are crossed: low {low} > high {high}")]
    CrossedBounds {
        /// What is bounded.
        field: &'static str,
        /// Its place in the list.
        index: usize,
        /// The lower bound.
        low: f64,
        /// The upper bound.
        high: f64,
    },
    /// A weight that is no symmetric matrix.
    #[error(
        "{field}[{row}][{column}] and {field}[{column}][{row}] differ, but it must be symmetric"
    )]
    NotSymmetric {
        /// What the matrix is.
        field: &'static str,
        /// The row of the entry.
        row: usize,
        /// Its column.
        column: usize,
    },
    /// A weight with a negative eigenvalue.
    #[error("{field} must be positive semidefinite")]
    NotSemidefinite {
        /// What the matrix is.
        field: &'static str,
    },
    /// The plant could not be integrated over a control step.
    #[error("the plant could not be integrated in control step {step}: {source}")]
    Plant {
        /// The control step.
        step: usize,
        /// What the integrator says.
        source: OdeError,
    },
}

/// Whether `values` has `expected` entries.
pub(crate) fn check_length(
    field: &'static str,
    values: &[f64],
    expected: usize,
) -> Result<(), MpcError> {
    Ok(ArgumentError::check_length(field, values.len(), expected)?)
}

/// Whether every value passes `test`, which `expected` says in words.
pub(crate) fn check_numbers(
    field: &'static str,
    values: &[f64],
    expected: &'static str,
    test: impl Fn(f64) -> bool,
) -> Result<(), MpcError> {
    Ok(ArgumentError::check_numbers(field, values, expected, test)?)
}

/// Whether the setting is `good`, which `expected` says in words.
pub(crate) fn check_setting(
    field: &'static str,
    value: f64,
    expected: &'static str,
    good: bool,
) -> Result<(), MpcError> {
    if good { Ok(()) } else { Err(MpcError::Setting { field, expected, value }) }
}

/// Whether `values` has `expected` entries, all finite.
///
/// # Errors
///
/// [`MpcError::Argument`], if not.
pub fn check_finite(field: &'static str, values: &[f64], expected: usize) -> Result<(), MpcError> {
    check_length(field, values, expected)?;
    check_numbers(field, values, "finite", f64::is_finite)
}

/// Whether `low <= found <= high`.
pub(crate) fn check_range(
    field: &'static str,
    found: usize,
    low: usize,
    high: usize,
) -> Result<(), MpcError> {
    if (low..=high).contains(&found) {
        Ok(())
    } else {
        Err(MpcError::Range { field, low, high, found })
    }
}
