//! Errors of an integration or a signal.

use crate::Integrator;
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
        /// The state there: the last finite one, unless the integration began with none.
        state: Vec<f64>,
    },
    /// The equation has no value, for a reason that the plant knows.
    #[error("the equation has no value beyond t = {t} s (state {state:?}): {reason}")]
    Undefined {
        /// Time within the interval integrated, in s.
        t: f64,
        /// The last state reached.
        state: Vec<f64>,
        /// What the plant says: see [`Plant::explain`](crate::Plant::explain).
        reason: String,
    },
    /// The steps that the tolerance asks for are too small to get through the interval.
    #[error("the step size fell to {step} s at t = {t} s: the equation is too stiff or has a jump")]
    StepTooSmall {
        /// Time within the interval integrated, in s.
        t: f64,
        /// The step size, in s.
        step: f64,
    },
    /// The program that a plant is cannot say.
    #[error("the plant's own program: {reason}")]
    External {
        /// What it says, or what is wrong with what it says.
        reason: String,
    },
    /// An integrator that cannot be made of a plant.
    #[error("the integrator `{integrator}` cannot be made of the plant: {reason}")]
    NoModel {
        /// The integrator.
        integrator: Integrator,
        /// Why not.
        reason: String,
    },
    /// Times and values that are not a piecewise-constant signal.
    #[error(
        "a signal needs start times that begin at 0 and increase, and values of one length: {reason}"
    )]
    PiecewiseConstant {
        /// What is wrong with it.
        reason: &'static str,
    },
}
