//! Errors in a problem of identification or its data.

use pinc_ode::Dims;
use thiserror::Error;

/// An error of this crate: parts that do not fit together, or data of which nothing can be
/// identified. That a fit is poor is no error but a [`Diagnosis`](crate::Diagnosis).
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum IdentifyError {
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
    /// A number that cannot be used, as NaN or a standard deviation that is not positive.
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
    /// A state, output or parameter that there is not, or that is named twice.
    #[error("{field} has {found}, but must name each of 0 to {last} at most once")]
    Index {
        /// Which list names it.
        field: &'static str,
        /// What it names.
        found: usize,
        /// The largest that there is.
        last: usize,
    },
    /// A start that is not within its bounds.
    #[error("the start of {name}, {initial}, must lie within its bounds, {low} to {high}")]
    OutsideBounds {
        /// The parameter.
        name: String,
        /// Where its estimate is to start.
        initial: f64,
        /// The least that it can be.
        low: f64,
        /// The most that it can be.
        high: f64,
    },
    /// Several starts are asked for, and a parameter has no range to draw them from.
    #[error(
        "{name} needs a lower and an upper bound, between which the {starts} starts of the fit lie"
    )]
    NoBounds {
        /// The parameter.
        name: String,
        /// How many starts.
        starts: usize,
    },
    /// Neither parameters nor initial states are unknown.
    #[error("nothing is unknown: name a parameter, or leave the initial state free")]
    NothingUnknown,
    /// There is no recording, or none of two rows.
    #[error("recording {recording}: {rows} rows, but at least 2 are needed")]
    TooShort {
        /// Which one.
        recording: usize,
        /// How many rows it has.
        rows: usize,
    },
    /// Fewer measured values than unknowns.
    #[error(
        "{measurements} measured values cannot determine {unknowns} unknowns with an interval: \
         more than {unknowns} are needed"
    )]
    TooFewMeasurements {
        /// The values that are not missing.
        measurements: usize,
        /// Parameters and initial states.
        unknowns: usize,
    },
    /// The model cannot be evaluated anywhere near the start.
    #[error(
        "the model has no finite value along recording {recording} with the parameters and the \
         initial state that the fit starts from"
    )]
    NotFinite {
        /// The first one.
        recording: usize,
    },
}

pub(crate) fn length(
    field: &'static str,
    found: usize,
    expected: usize,
) -> Result<(), IdentifyError> {
    if found == expected { Ok(()) } else { Err(IdentifyError::Length { field, expected, found }) }
}

pub(crate) fn numbers(
    field: &'static str,
    numbers: &[f64],
    expected: &'static str,
    is_good: impl Fn(f64) -> bool,
) -> Result<(), IdentifyError> {
    match numbers.iter().position(|&number| !is_good(number)) {
        Some(index) => Err(IdentifyError::Number { field, index, expected, value: numbers[index] }),
        None => Ok(()),
    }
}

/// Each of `places` is below `count`, and there once.
pub(crate) fn places(
    field: &'static str,
    places: &[usize],
    count: usize,
) -> Result<(), IdentifyError> {
    let bad = |(i, place): (usize, &usize)| *place >= count || places[..i].contains(place);
    match places.iter().enumerate().position(|(i, place)| bad((i, place))) {
        Some(i) => {
            Err(IdentifyError::Index { field, found: places[i], last: count.saturating_sub(1) })
        }
        None => Ok(()),
    }
}

/// The numbers of a recording for a model of dimensions `dims`.
pub(crate) fn rows(
    recording: usize,
    dims: Dims,
    (u, y, channels): (&[f64], &[f64], usize),
) -> Result<usize, IdentifyError> {
    let rows = y.len() / channels;
    length("y", y.len(), rows * channels)?;
    length("u", u.len(), rows * dims.nu)?;
    numbers("u", u, "finite", f64::is_finite)?;
    numbers("y", y, "finite, or NaN where it is missing", |y| !y.is_infinite())?;
    if rows < 2 { Err(IdentifyError::TooShort { recording, rows }) } else { Ok(rows) }
}
