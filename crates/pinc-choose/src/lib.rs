#![doc = include_str!("../README.md")]
//! # Tour
//!
//! Integrators by their substeps and nets by their size are [`Candidate`]s. A [`Search`] says which
//! is tried next, the best guesses first, and judges what came of it by the [`Standard`] of the
//! most exact integrator, or of a plant without an equation itself: by the IAE, the violations of bounds, and the time of a control step.
//! The caller tries candidates through [`Loops`]. [`Advice`] gives the result in words, and
//! [`Advice::config`] as a config.

#![forbid(unsafe_code)]

mod advice;
mod candidate;
mod judge;
mod ladder;
mod recommended;
mod search;

pub use advice::Advice;
pub use candidate::{Candidate, Shape};
pub use judge::{Score, Standard, Tried};
pub use search::{Loops, Purpose, Search, SearchResult};
