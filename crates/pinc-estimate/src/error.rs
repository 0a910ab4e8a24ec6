//! Errors of putting an estimator together.

use crate::Measured;
use pinc_qp::QpError;
use thiserror::Error;

/// An error of this crate: parts that do not fit together. That a step could not be taken as it
/// should is no error but an [`EstimatorStatus`](crate::EstimatorStatus).
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum EstimateError {
    /// A list of the wrong length.
    #[error("{field}: {found} numbers, but {expected} are expected")]
    Length {
        /// What the list is.
        field: &'static str,
        /// The length it must have.
        expected: usize,
        /// The length it has.
        found: usize,
    },
    /// A number in a list that it must not hold, as NaN, or a negative standard deviation.
    #[error("{field}[{index}] is {value}, but must be {expected}")]
    Number {
        /// The list the number is in.
        field: &'static str,
        /// Its place in it.
        index: usize,
        /// What it must be.
        expected: &'static str,
        /// What it is.
        value: f64,
    },
    /// A model whose parameters nobody knows.
    #[error(
        "the model has {count} parameters that the estimator does not know: an `Augmented` model \
         fixes or estimates them"
    )]
    FreeParameters {
        /// How many.
        count: usize,
    },
    /// A state, output, parameter or measured quantity that there is not, or that is named twice.
    #[error("{field} has {found}, but must name each of 0 to {last} at most once")]
    Index {
        /// Which list names it.
        field: &'static str,
        /// What it names.
        found: usize,
        /// The largest that there is.
        last: usize,
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
) -> Result<(), EstimateError> {
    let found = values.len();
    if found != expected {
        return Err(EstimateError::Length { field, expected, found });
    }
    match values.iter().position(|&value| !test(value)) {
        None => Ok(()),
        Some(index) => {
            Err(EstimateError::Number { field, index, expected: wanted, value: values[index] })
        }
    }
}

/// Whether `indices` are below `count` and all different.
pub(crate) fn check_indices(
    field: &'static str,
    indices: &[usize],
    count: usize,
) -> Result<(), EstimateError> {
    let bad = |(i, &index): (usize, &usize)| index >= count || indices[..i].contains(&index);
    match indices.iter().enumerate().find(|&entry| bad(entry)) {
        None => Ok(()),
        Some((_, &found)) => {
            Err(EstimateError::Index { field, found, last: count.saturating_sub(1) })
        }
    }
}
