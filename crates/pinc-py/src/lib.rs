//! The Python package `pinc`, its part in Rust: models, trainings, controllers and runs as classes
//! and functions of the module `pinc_nmpc._native`.
//!
//! What a user sees of it is said in `python/pinc_nmpc/_native.pyi`, for `doc!` too. Arguments are checked here, before
//! the libraries see them: what is wrong with one is an exception, and nothing panics. The global
//! interpreter lock is released for all that takes long.

include!(concat!(env!("OUT_DIR"), "/docs.rs"));

mod arrays;
mod batch;
mod commands;
mod config;
mod controller;
mod discrete;
mod errors;
mod estimator;
mod gradient;
mod model;
mod plant;
mod qp;
mod results;
mod training;
mod work;

use pyo3::prelude::*;

#[pymodule(name = "_native")]
mod native {
    #[pymodule_export]
    use crate::batch::{GradientBatch, LoopBatch, NmpcBatch, StepBatch, restore_batch};
    #[pymodule_export]
    use crate::commands::{
        certify_into, choose_into, control_into, estimate_into, export_controller, export_net,
        export_plant, findings, identify_into, run_into, shrink_into, tune_into,
    };
    #[pymodule_export]
    use crate::config::{allow_processes, resolved};
    #[pymodule_export]
    use crate::controller::{ControlStep, Nmpc, restore_nmpc};
    #[pymodule_export]
    use crate::estimator::{Correction, Estimator, restore_estimator};
    #[pymodule_export]
    use crate::gradient::{PlanChange, PlanGradient};
    #[pymodule_export]
    use crate::model::Model;
    #[pymodule_export]
    use crate::plant::{IntegratorModel, Plant, restore_integrator, restore_plant};
    #[pymodule_export]
    use crate::qp::solve_dense_qp;
    #[pymodule_export]
    use crate::results::restore_result;
    #[pymodule_export]
    use crate::training::{Trained, TrainingProgress, train};
}
