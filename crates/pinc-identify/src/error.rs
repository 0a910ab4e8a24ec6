//! Errors in a problem of identification or its data.

use pinc_ode::{ArgumentError, Dims};
use thiserror::Error;

/// An error of this crate: parts that do not fit together, or data of which nothing can be
/// identified. That a fit is poor is no error but a [`Diagnosis`](crate::Diagnosis).
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum IdentifyError {
    /// An argument that does not fit.
    #[error(transparent)]
    Argument(#[from] ArgumentError),
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
    #[error("recording {}: {rows} rows, but at least 2 are needed", .recording + 1)]
    TooShort {
        /// Which one, from 0; in the text, as in files, from 1.
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
    /// A recording that is held out has no rows but those that its initial state is fitted to.
    #[error(
        "no row is left to judge the fit by behind the first {rows} with a measured value, to \
         which the initial state is fitted"
    )]
    NothingHeldOut {
        /// How many rows it is fitted to.
        rows: usize,
    },
    /// The model cannot be evaluated anywhere near the start.
    #[error(
        "the model has no finite value along recording {} with the parameters and the initial \
         state that the fit starts from",
        .recording + 1
    )]
    NotFinite {
        /// The first one, from 0; in the text from 1.
        recording: usize,
    },
    /// A fit that was asked to stop.
    #[error("interrupted")]
    Interrupted,
}

/// The numbers of a recording for a model of dimensions `dims`.
pub(crate) fn rows(
    recording: usize,
    dims: Dims,
    (u, y, channels): (&[f64], &[f64], usize),
) -> Result<usize, IdentifyError> {
    let rows = y.len() / channels;
    ArgumentError::check_length("y", y.len(), rows * channels)?;
    ArgumentError::check_length("u", u.len(), rows * dims.nu)?;
    ArgumentError::check_numbers("u", u, "finite", f64::is_finite)?;
    ArgumentError::check_numbers("y", y, "finite, or NaN where it is missing", |y| {
        !y.is_infinite()
    })?;
    if rows < 2 { Err(IdentifyError::TooShort { recording, rows }) } else { Ok(rows) }
}
