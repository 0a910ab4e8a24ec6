#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

mod curvature;
mod data;
mod entries;
mod limits;
mod sensitivity;
mod system;

pub use data::{Given, ProblemDerivative};
pub use sensitivity::{Regularity, Sensitivity};
