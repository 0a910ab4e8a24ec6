#![doc = include_str!("../README.md")]
//! # Tour
//!
//! An equation is written once, over [`Scalar`], and evaluated as
//!
//! - `f64`: its value;
//! - [`Dual`]: its value and directional derivatives (forward mode);
//! - [`Lanes`]: several points at once, in a form that the compiler turns into SIMD instructions;
//!   [`simd`] has the vectors of this machine;
//! - [`Var`]: its value, recorded on a [`Tape`] for the gradient (reverse mode).
//!
//! The kinds nest. `Dual<Var>` is what a physics-informed net needs: forward in time for dy/dt,
//! inside reverse in the weights for the gradient of a loss that contains dy/dt.
//!
//! The crate depends on nothing.

mod directions;
mod drivers;
mod dual;
mod finite;
mod implicit;
mod lanes;
mod scalar;
pub mod simd;
mod tape;

pub use directions::Directions;
pub use drivers::{derivative, gradient, jacobian};
pub use dual::{Derivative, Dual};
pub use finite::{GradientMismatch, central_difference, check_gradient};
pub use implicit::{ImplicitEquations, NewtonRoot, NewtonSystem, correct, newton, solve_implicit};
pub use lanes::Lanes;
pub use scalar::Scalar;
pub use tape::{Tape, Var};
