//! Errors of the numbers that a caller gives.

use thiserror::Error;

/// A list of numbers that does not fit what it is for.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum ArgumentError {
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
}

impl ArgumentError {
    /// Checks the length of a list.
    ///
    /// # Errors
    ///
    /// [`ArgumentError::Length`].
    pub fn check_length(field: &'static str, found: usize, expected: usize) -> Result<(), Self> {
        if found == expected { Ok(()) } else { Err(Self::Length { field, expected, found }) }
    }

    /// Checks that all numbers pass a test, which `expected` says in words.
    ///
    /// # Errors
    ///
    /// [`ArgumentError::Number`].
    pub fn check_numbers(
        field: &'static str,
        numbers: &[f64],
        expected: &'static str,
        is_good: impl Fn(f64) -> bool,
    ) -> Result<(), Self> {
        match numbers.iter().position(|&number| !is_good(number)) {
            Some(index) => Err(Self::Number { field, index, expected, value: numbers[index] }),
            None => Ok(()),
        }
    }

    /// Checks that each of `places` is below `count`, and there once.
    ///
    /// # Errors
    ///
    /// [`ArgumentError::Index`].
    pub fn check_places(field: &'static str, places: &[usize], count: usize) -> Result<(), Self> {
        let bad = |(i, place): &(usize, &usize)| **place >= count || places[..*i].contains(place);
        match places.iter().enumerate().find(bad) {
            Some((_, &found)) => Err(Self::Index { field, found, last: count.saturating_sub(1) }),
            None => Ok(()),
        }
    }
}
