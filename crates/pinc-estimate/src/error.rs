//! Errors of putting an estimator together.

use crate::Measured;
use pinc_ode::ArgumentError;
use pinc_qp::QpError;
use thiserror::Error;

/// An error of this crate: parts that do not fit together. That a step could not be taken as it
/// should is no error but an [`EstimatorStatus`](crate::EstimatorStatus).
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum EstimateError {
    /// An argument that does not fit.
    #[error(transparent)]
    Argument(#[from] ArgumentError),
    /// A parameter that is both known and estimated.
    #[error("parameter {index} is both known and estimated")]
    KnownAndEstimated {
        /// Its index.
        index: usize,
    },
    /// Nothing is measured.
    #[error("nothing is measured: an estimator needs at least one measured quantity")]
    NothingMeasured,
    /// A quantity that is measured twice.
    #[error("{measured} is measured twice")]
    MeasuredTwice {
        /// The quantity.
        measured: Measured,
    },
    /// More disturbances than measurements.
    #[error(
        "{disturbances} disturbances cannot be told apart by {measured} measured quantities: there \
         may be at most one disturbance per measured quantity"
    )]
    TooManyDisturbances {
        /// The number of disturbances.
        disturbances: usize,
        /// The number of measured quantities.
        measured: usize,
    },
    /// A gate without a width.
    #[error("gate is {found}, but must be positive and finite")]
    Gate {
        /// Its width.
        found: f64,
    },
    /// A window that is too short or too long.
    #[error("the window is {found} steps long, but must be from 1 to {most}")]
    Window {
        /// Its length.
        found: usize,
        /// The longest that there may be.
        most: usize,
    },
    /// A method that cannot solve the estimator's quadratic programs.
    #[error(transparent)]
    Qp(#[from] QpError),
}

/// Whether `values` has `expected` entries that all pass `test`, which `wanted` says in words.
pub(crate) fn check(
    field: &'static str,
    values: &[f64],
    expected: usize,
    wanted: &'static str,
    test: impl Fn(f64) -> bool,
) -> Result<(), ArgumentError> {
    ArgumentError::check_length(field, values.len(), expected)?;
    ArgumentError::check_numbers(field, values, wanted, test)
}
