//! Plants that other programs simulate, as black boxes ([`pinc_ode::Flow`]).
//!
//! [`Process`]: a program that answers on its standard output. [`Fmu`]: a file of the Functional
//! Mock-up Interface, whose binary is loaded.

mod fmu;
mod pool;
mod process;

pub use fmu::{Fmu, FmuKind, FmuPlant};
pub use process::Process;
