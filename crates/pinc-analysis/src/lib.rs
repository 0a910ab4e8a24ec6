#![doc = include_str!("../README.md")]
//! # Tour
//!
//! - [`SteadyStateSearch`]: finds f(x, u) = 0 with some states at given values and the other states
//!   and the inputs within bounds.
//! - [`StateSpace`]: the linearized plant, its eigenvalues, static gain and transmission zeros.
//!   [`TimeScales`] interprets the eigenvalues; [`common_plane`] finds the plane that holds all
//!   steady states.
//! - [`StabilityFunction`]: which steps are stable. [`OneStepSamples`]: the error of one step.
//! - [`Survey`]: poles, jumps and kinks of the equation in and around a box. [`crossings`] finds
//!   where its terms vanish.
//!
//! Results are numbers and enums; pinc-check interprets them for a config. All functions take the
//! plant as [`pinc_ode::DynRhs`], with fixed parameters.

#![forbid(unsafe_code)]

mod crossing;
mod detectability;
mod knee;
mod least_squares;
mod modes;
mod plane;
mod region;
mod stability;
mod state_space;
mod steady_state;
mod substeps;
mod survey;
mod zeros;

pub use crossing::{Crossing, Crossings, Term, Terms, Value, crossings};
pub use detectability::{UnseenMode, unseen_along, unseen_modes};
pub use knee::beyond_knee;
pub use modes::{Growth, TimeScales};
pub use plane::{Plane, common_plane, common_ratio};
pub use region::{OperatingPoint, Region};
pub use stability::StabilityFunction;
pub use state_space::{Complex, StateSpace, StaticGain, TransmissionZeros};
pub use steady_state::{HeldPoint, SteadyStateSearch};
pub use substeps::OneStepSamples;
pub use survey::{Irregularity, IrregularityKind, Survey};
