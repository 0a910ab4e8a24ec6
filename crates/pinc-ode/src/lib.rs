#![doc = include_str!("../README.md")]
//! # Tour
//!
//! - [`Plant`]: an ordinary differential equation x' = f(x, u, p) with outputs y = h(x, u, p),
//!   written once over [`pinc_ad::Scalar`]. [`DynRhs`] and [`DynPlant`] are plants with their type
//!   erased.
//! - [`Loaded`]: a plant with given parameters and loads.
//! - [`Model`]: a discrete-time model x\[k+1\] = F(x\[k\], u\[k\], p) with its Jacobians, all that a
//!   controller sees of a model. [`Rk4`], [`Rk5`] and the Rosenbrock method for stiff plants
//!   ([`Integrator`]) make a model of a plant; a trained net is another model.
//! - [`AccurateIntegrator`]: gives the reference solutions for comparisons, by [`Dopri5`] or, on
//!   stiff plants, by an implicit method.
//! - [`PiecewiseConstant`], [`Trajectory`], [`metrics`]: inputs and references over time, sampled
//!   solutions, and measures of their errors.

#![forbid(unsafe_code)]

mod accurate;
mod argument;
mod banded;
mod black_box;
mod dopri5;
mod dyn_plant;
mod error;
mod feedthrough;
mod integrator;
mod loaded;
mod memory;
pub mod metrics;
mod model;
mod output;
mod piecewise_constant;
mod plant;
mod points;
mod recent;
mod runge_kutta;
mod seulex;
mod simulator;
mod sparse;
mod tangent;
mod trajectory;
mod variable;
mod with_outputs;

pub use accurate::AccurateIntegrator;
pub use argument::ArgumentError;
pub use banded::Banded;
pub use black_box::{BlackBox, Flow, FlowModel};
pub use dopri5::Dopri5;
pub use dyn_plant::{
    AnyVectorRhs, DynPlant, DynRhs, Signature, VECTOR_DIRECTIONS, VectorDual, VectorRhs,
};
pub use error::OdeError;
pub use integrator::{Integrator, Scheme};
pub use loaded::Loaded;
pub use memory::Memory;
pub use model::{
    Dims, Gradients, Linearization, LinearizationBuffer, Model, OutputLinearization,
    OutputLinearizationBuffer, Stages,
};
pub use piecewise_constant::PiecewiseConstant;
pub use plant::{Over, Plant};
pub use recent::Recent;
pub use runge_kutta::{Classical, DormandPrince, Method, Rk4, Rk5, RungeKutta};
pub use simulator::Simulator;
pub use sparse::{
    Curvature, CurvedFunction, SparseFunction, SparsePlant, SparsityPattern, Tableau,
    sparse_rosenbrock, sparse_runge_kutta,
};
pub use tangent::Tangent;
pub use trajectory::Trajectory;
pub use variable::Variable;
pub use with_outputs::WithOutputs;
