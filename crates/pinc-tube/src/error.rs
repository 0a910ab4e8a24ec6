//! Typed errors.

use thiserror::Error;

/// A tube that cannot be made.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum TubeError {
    /// A list of the wrong length.
    #[error("{field} has {found} numbers, but must have {expected}")]
    Length {
        /// The list.
        field: &'static str,
        /// The length it must have.
        expected: usize,
        /// The length it has.
        found: usize,
    },
    /// A number that is out of its range.
    #[error("{field} has {value}, but must be {expected}")]
    Number {
        /// Where the number is.
        field: &'static str,
        /// The number.
        value: f64,
        /// What it must be.
        expected: &'static str,
    },
    /// Random sources without a probability.
    #[error("a standard deviation or a covariance needs a probability")]
    NoProbability,
    /// Intervals of parameters, or outputs with bounds, without a model.
    #[error("uncertain parameters and bounds on outputs need a model")]
    NoModel,
}
