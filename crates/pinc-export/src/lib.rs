#![doc = include_str!("../README.md")]
//! # Tour
//!
//! - [`net_to_c`]: a net as C99 without dependencies.
//! - [`net_to_casadi`], [`net_to_onnx`]: a net for CasADi, and as an ONNX file.
//! - [`controller_to_c`]: a whole controller, with a net or an integrator as its model, and its
//!   estimator.
//! - [`net_to_fmu`], [`controller_to_fmu`], [`plant_to_fmu`]: the content of FMUs, which
//!   [`archive`] packs.
//!
//! These return the content of files ([`GeneratedFile`]); the caller writes them. [`lanes_to_c`] is the
//! text of functions for other generated files.

#![forbid(unsafe_code)]

mod casadi;
mod controller;
mod equation;
mod error;
mod error_c;
mod feedback_c;
mod fmi2;
mod fmi3;
mod fmu;
mod fmu_variables;
mod golden;
mod guard_c;
mod lanes_c;
mod mpc_c;
mod name;
mod net_c;
mod onnx;
mod open;
mod origin;
mod outputs_c;
mod protobuf;
mod runge_kutta_c;
mod selftest;
mod start_c;
mod template;
mod tube_c;
mod zip;

pub use casadi::net_to_casadi;
pub use controller::{Controller, ModelSource};
pub use error::ExportError;
pub use feedback_c::{Estimation, Filter};
pub use fmu::{FmiVersion, controller_to_fmu, net_to_fmu, plant_to_fmu};
pub use guard_c::{ErrorGuard, ErrorResponse};
pub use lanes_c::lanes_to_c;
pub use mpc_c::controller_to_c;
pub use name::Name;
pub use net_c::net_to_c;
pub use onnx::{Precision, net_to_onnx};
pub use origin::Origin;
pub use runge_kutta_c::RungeKuttaModel;
pub use tube_c::ExportedTube;
pub use zip::archive;

/// A file to be written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GeneratedFile {
    /// Its path below the directory of the export, with slashes.
    pub path: String,
    /// Its content.
    pub bytes: Vec<u8>,
}

impl GeneratedFile {
    /// A file of text.
    pub(crate) fn text(path: String, text: String) -> Self {
        Self { path, bytes: text.into_bytes() }
    }
}
