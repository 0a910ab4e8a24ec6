#![doc = include_str!("../README.md")]
//! # Tour
//!
//! - [`Layers`]: the table, and the origin of each value; [`assign`] puts a value under a key path.
//! - [`ConfigError`], [`Problem`]: what is wrong, and where.
//! - [`explain`]: from an error of deserialization to a [`Problem`]; [`nearest`]: what was meant.

#![forbid(unsafe_code)]

mod explain;
mod finite;
mod layers;
mod lines;
mod order;
mod overrides;
mod preset;
mod problem;

pub use explain::explain;
pub use finite::first_not_finite;
pub use layers::{Layers, assign, differences_of};
pub use preset::Presets;
pub use problem::{ConfigError, Origin, Problem, SetProblem, nearest};
