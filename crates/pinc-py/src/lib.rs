//! The Python package `pinc`, its part in Rust: models, trainings, controllers and runs as classes
//! and functions of the module `pinc._native`.
//!
//! What a user sees of it is said in `python/pinc/_native.pyi`. Arguments are checked here, before
//! the libraries see them: what is wrong with one is an exception, and nothing panics. The global
//! interpreter lock is released for all that takes long.

mod arrays;
mod batch;
mod config;
mod controller;
mod errors;
mod gradient;
mod model;
mod run;
mod training;

use pyo3::prelude::*;

#[pymodule(name = "_native")]
mod native {
    #[pymodule_export]
    use crate::batch::{GradientBatch, LoopBatch, NmpcBatch, StepBatch};
    #[pymodule_export]
    use crate::controller::{ControlStep, Nmpc};
    #[pymodule_export]
    use crate::gradient::{PlanChange, PlanGradient};
    #[pymodule_export]
    use crate::model::Model;
    #[pymodule_export]
    use crate::run::run_into;
    #[pymodule_export]
    use crate::training::{Trained, TrainingProgress, train};
}
