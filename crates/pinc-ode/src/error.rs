//! What can go wrong with an integration or a signal.

use thiserror::Error;

/// An error of this crate.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum OdeError {
    /// The state or its derivative became NaN or infinite.
    #[error("the solution is no longer finite at t = {t} s (state {state:?})")]
    NotFinite {
        /// Time within the interval integrated, in s.
        t: f64,
        /// The last finite state.
        state: Vec<f64>,
    },
    /// The step that the tolerance asks for is too small to move time.
    #[error("the step size fell to {step} s at t = {t} s: the equation is too stiff or has a jump")]
    StepTooSmall {
        /// Time within the interval integrated, in s.
        t: f64,
        /// The step size, in s.
        step: f64,
    },
    /// A piecewise-constant signal that is none.
    #[error(
        "a signal needs start times that begin at 0 and increase, with values of one length each: {reason}"
    )]
    Signal {
        /// What is wrong with it.
        reason: &'static str,
    },
}
