//! Errors of a net, its training and its file.

use pinc_ode::OdeError;
use std::error::Error as StdError;
use std::fmt::Display;
use thiserror::Error;

/// The error of a library below, whose type is not part of this crate's interface.
type Source = Box<dyn StdError + Send + Sync>;

/// An error of a net or its training.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum NetError {
    /// A setting that makes no sense.
    #[error("{key}: {found} given, expected {expected}")]
    Setting {
        /// The setting's key, as in a config file.
        key: &'static str,
        /// What was given.
        found: String,
        /// What was expected.
        expected: &'static str,
    },
    /// A vector of the wrong length.
    #[error("{key}: {found} numbers given, expected {expected}, one per {per}")]
    Dimension {
        /// The setting's key, as in a config file.
        key: &'static str,
        /// The length given.
        found: usize,
        /// The length expected.
        expected: usize,
        /// What there is one of each for.
        per: &'static str,
    },
    /// A parameter that the plant and the domain do not agree on.
    #[error("parameter `{name}` {problem}")]
    Parameter {
        /// Its name.
        name: String,
        /// What does not agree.
        problem: &'static str,
    },
    /// A conventional PINN y(t) where a model for control belongs.
    #[error(
        "a conventional PINN stands for one initial state and one input: it cannot be a model for \
         control"
    )]
    OneScenario,
    /// A length of a step that a net does not know.
    #[error("the net has no state after {t} s: it is for {known}")]
    Time {
        /// The length, in s.
        t: f64,
        /// What it knows.
        known: String,
    },
    /// A NaN or an infinity where a number belongs.
    #[error("{term} became NaN or infinite at iteration {iteration}; the last good net is kept")]
    NotFinite {
        /// What it was: a term of the loss, or the gradient.
        term: &'static str,
        /// The iteration at which it happened, counted over all phases.
        iteration: u64,
    },
    /// The equation has no finite value in the training domain.
    #[error(
        "the derivative of state {state} is not finite at x = {x:?}, u = {u:?} in the domain\
        {}{}", if reason.is_empty() { "" } else { ": " }, reason
    )]
    Plant {
        /// Name of the state.
        state: String,
        /// The state vector.
        x: Vec<f64>,
        /// The input vector.
        u: Vec<f64>,
        /// Why, in the plant's words; empty if it does not know.
        reason: String,
    },
    /// The truth to validate with could not be integrated.
    #[error("the validation scenarios cannot be integrated: {0}")]
    Validation(#[from] OdeError),
    /// A checkpoint of another training.
    #[error("the checkpoint does not belong to this training: {what} differs")]
    Checkpoint {
        /// What does not agree.
        what: &'static str,
    },
    /// The worker threads could not be started.
    #[error("cannot start the worker threads: {0}")]
    Threads(#[source] Source),
}

/// Checks a setting.
pub(crate) fn check(
    is_good: bool,
    key: &'static str,
    found: impl Display,
    expected: &'static str,
) -> Result<(), NetError> {
    match is_good {
        true => Ok(()),
        false => Err(NetError::Setting { key, found: found.to_string(), expected }),
    }
}

/// Checks that a setting is a positive number.
pub(crate) fn check_positive(key: &'static str, value: f64) -> Result<(), NetError> {
    check(value > 0.0 && value.is_finite(), key, value, "a positive number")
}

/// Checks that a setting is no zero.
pub(crate) fn check_count(key: &'static str, value: usize) -> Result<(), NetError> {
    check(value > 0, key, value, "at least 1")
}

/// Checks that there are as many numbers as there have to be.
pub(crate) fn check_length(
    key: &'static str,
    found: usize,
    expected: usize,
    per: &'static str,
) -> Result<(), NetError> {
    match found == expected {
        true => Ok(()),
        false => Err(NetError::Dimension { key, found, expected, per }),
    }
}

/// Checks that there are as many numbers as there have to be, and that they are finite.
pub(crate) fn check_numbers(
    key: &'static str,
    values: &[f64],
    expected: usize,
    per: &'static str,
) -> Result<(), NetError> {
    check_length(key, values.len(), expected, per)?;
    let bad = values.iter().find(|v| !v.is_finite());
    bad.map_or(Ok(()), |bad| check(false, key, bad, "finite numbers"))
}

/// An error in a model file.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ModelError {
    /// Not a safetensors file, or a damaged one.
    #[error("not a readable safetensors file: {0}")]
    Container(#[source] Source),
    /// A safetensors file, but not of a PINC model.
    #[error("not a PINC model: metadata `{key}` is {found}, expected {expected}")]
    Foreign {
        /// The metadata key.
        key: &'static str,
        /// What it is.
        found: String,
        /// What it should be.
        expected: &'static str,
    },
    /// The description of the model is not as it should be.
    #[error("metadata `model`: {0}")]
    Description(#[source] Source),
    /// A tensor that is missing, of another type or shape, or not finite.
    #[error("tensor `{name}`: {found}, expected {expected}")]
    Tensor {
        /// The tensor's name.
        name: String,
        /// What it is.
        found: String,
        /// What it should be.
        expected: String,
    },
    /// Numbers in the description that contradict each other.
    #[error("metadata `model`: `{field}` {problem}")]
    Inconsistent {
        /// The field.
        field: &'static str,
        /// What is wrong with it.
        problem: &'static str,
    },
}
