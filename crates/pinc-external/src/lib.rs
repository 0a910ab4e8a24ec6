#![doc = include_str!("../README.md")]
//! # Tour
//!
//! [`Process`]: a program that answers on its standard output. [`Fmu`]: a file of the Functional
//! Mock-up Interface, whose binary is loaded.

mod fmu;
mod pool;
mod process;

pub use fmu::{Fmu, FmuError, FmuKind, FmuPlant};
pub use process::Process;
