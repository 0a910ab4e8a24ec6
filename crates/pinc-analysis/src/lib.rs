#![doc = include_str!("../README.md")]
//! # Tour
//!
//! - [`SteadyStateSearch`]: where f(x, u) = 0, with some of the states held at given values and the
//!   others and the inputs within bounds.
//! - [`StateSpace`]: the plant linearized, with its eigenvalues, static gain and transmission
//!   zeros;
//!   [`TimeScales`] says what the eigenvalues mean; [`common_plane`] finds what all steady states
//!   share.
//! - [`StabilityFunction`]: which steps are stable; [`OneStepSamples`]: how large the error of a step
//!   is.
//! - [`Survey`]: where the equation has poles, jumps and kinks, in and around a box; [`crossings`]
//!   finds where terms of it vanish.
//!
//! Results are numbers and enums; what they mean for a config is said elsewhere. All take the plant
//! as
//! [`pinc_ode::DynRhs`]. Parameters of a plant that vary from call to call are not supported.

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
