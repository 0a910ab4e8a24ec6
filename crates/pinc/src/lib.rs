//! Physics-informed neural nets as the model inside nonlinear model predictive control (Antonelo et
//! al., "Physics-Informed Neural Nets for Control of Dynamical Systems").
//!
//! This crate re-exports the libraries and holds the program `pinc`. You write an equation
//! x' = f(x, u) once; an integrator or a net trained on that equation becomes a
//! [`Model`](ode::Model); a controller uses any model.
//!
//! | module | what it is for | feature |
//! |---|---|---|
//! | [`ode`] | equations ([`Plant`](ode::Plant)), models, Runge-Kutta and Rosenbrock methods, accurate integration | always |
//! | [`mpc`], [`closed_loop`] | the controller ([`Nmpc`](mpc::Nmpc)); closed loops | always |
//! | [`ad`], [`qp`] | derivatives; quadratic programs | always |
#![cfg_attr(
    feature = "net",
    doc = "| [`net`] | nets: training, validation, the net as a model | `net` |"
)]
#![cfg_attr(
    feature = "estimate",
    doc = "| [`estimate`] | Kalman filters, moving horizon estimation, disturbance models | `estimate` |"
)]
#![cfg_attr(
    feature = "identify",
    doc = "| [`identify`] | parameters and initial states from recorded data | `identify` |"
)]
#![cfg_attr(feature = "text", doc = "| [`expr`] | plants whose equations are text | `text` |")]
#![cfg_attr(feature = "plants", doc = "| [`plants`] | the built-in plants | `plants` |")]
#![cfg_attr(
    feature = "batch",
    doc = "| [`batch`], [`sensitivity`] | control steps, gradients, closed loops and model steps on all cores; derivatives of plans | `batch` |"
)]
#![cfg_attr(feature = "chart", doc = "| [`chart`] | figures as SVG | `chart` |")]
#![cfg_attr(
    feature = "analysis",
    doc = "| [`analysis`] | steady states, stability and zeros of a plant | `analysis` |"
)]
#![cfg_attr(
    feature = "export",
    doc = "| [`export`] | nets and controllers as C, FMU, ONNX and CasADi sources | `export` |"
)]
#![cfg_attr(
    feature = "verify",
    doc = "| [`verify`] | the proven error of one step of a model | `verify` |"
)]
#![cfg_attr(
    feature = "experiments",
    doc = "| [`config`], [`runs`], [`record`], [`report`], [`mod@bench`] | experiments from TOML files, their directories and reports, sweeps | `experiments` |"
)]
//!
//! Without default features the crate holds the controller and the integrators alone:
//! `pinc = { version = "0.1", default-features = false, features = ["net"] }` adds nets.
//!
//! # A controller
//!
//! An input between 0 and 2 N/kg brings a cart with quadratic drag, v' = u - v², to 1 m/s. The model
//! is RK4 with steps of 0.5 s and four substeps in each:
//!
//! ```
//! use pinc::prelude::*;
//!
//! #[derive(Clone, Debug)]
//! struct Cart;
//!
//! impl Plant for Cart {
//!     fn states(&self) -> &[Variable] {
//!         static STATES: [Variable; 1] = [Variable::new("v", "m/s")];
//!         &STATES
//!     }
//!     fn inputs(&self) -> &[Variable] {
//!         static INPUTS: [Variable; 1] = [Variable::new("u", "N/kg")];
//!         &INPUTS
//!     }
//!     fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
//!         dx[0] = u[0] - x[0] * x[0];
//!     }
//! }
//!
//! let model = Rk4::new(Cart, 0.5, 4);
//! let problem = NmpcProblem {
//!     input_bounds: Bounds { low: vec![0.0], high: vec![2.0] },
//!     ..NmpcProblem::new(model.dims(), 5, Weights::uniform(vec![10.0], vec![0.1]))
//! };
//! let mut nmpc = Nmpc::new(problem, Box::new(model), SqpConfig::default())?;
//! let plant = Dopri5::new(Cart, 1e-10);
//! let reference = Reference::new([1.0].repeat(20), 1)?;
//! let mut run = ClosedLoop::new(&mut nmpc, plant, reference, &[0.0])?;
//! let (_, ended) = run.run_recorded();
//! ended?;
//! assert!((run.state()[0] - 1.0).abs() < 1e-3);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
#![cfg_attr(
    feature = "net",
    doc = r#"
# A net as the model

The net is trained on the equation alone; [`Training`](net::Training) has the settings, and
[`PincModel`](net::PincModel) makes the trained net a model for the controller above:

```
use pinc::prelude::*;

# #[derive(Clone, Debug)]
# struct Cart;
# impl Plant for Cart {
#     fn states(&self) -> &[Variable] {
#         static STATES: [Variable; 1] = [Variable::new("v", "m/s")];
#         &STATES
#     }
#     fn inputs(&self) -> &[Variable] {
#         static INPUTS: [Variable; 1] = [Variable::new("u", "N/kg")];
#         &INPUTS
#     }
#     #[inline(always)]
#     fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
#         dx[0] = u[0] - x[0] * x[0];
#     }
# }
// One layer of 8 neurons for steps of 0.5 s; the box of states and inputs it must be good for.
let (net, domain) = (NetConfig::new(0.5, 1, 8), Domain::new([0.0..=2.0], [0.0..=2.0]));
let accurate = Some(1e-3); // m/s after one step
let config = TrainingConfig { target_one_step_rms: accurate, ..TrainingConfig::recommended() };
let trained = Training { config, ..Training::new(net, domain) }.run(&Cart)?;
let mut model = PincModel::new(&trained.net)?;
let mut next = [0.0];
model.step(&[0.3], &[1.0], &[], &mut next);
# Ok::<(), Box<dyn std::error::Error>>(())
```
"#
)]
#![cfg_attr(
    feature = "program",
    doc = r#"
# The program

`pinc --help` lists its commands. [`program`] is all of it as a function, so that a program of
yours can add plants written in Rust:

```no_run
use pinc::{Plants, program};
use std::process::ExitCode;

fn main() -> ExitCode {
    program(&Plants::built_in())
}
```
"#
)]
#![forbid(unsafe_code)]

#[cfg(feature = "program")]
mod choices;
#[cfg(feature = "program")]
mod chosen;
#[cfg(feature = "program")]
mod cli;
#[cfg(feature = "program")]
mod options;
#[cfg(feature = "program")]
mod printed;
#[cfg(feature = "program")]
mod served;
#[cfg(feature = "program")]
mod shrunk;
#[cfg(feature = "program")]
mod summary;
#[cfg(feature = "program")]
mod tuned;

#[cfg(feature = "program")]
pub use cli::program;
pub use pinc_ad as ad;
#[cfg(feature = "analysis")]
pub use pinc_analysis as analysis;
#[cfg(feature = "experiments")]
pub use pinc_bench as bench;
#[cfg(feature = "chart")]
pub use pinc_chart as chart;
#[cfg(feature = "experiments")]
pub use pinc_config as config;
#[cfg(feature = "experiments")]
pub use pinc_config::Plants;
#[cfg(feature = "estimate")]
pub use pinc_estimate as estimate;
#[cfg(feature = "export")]
pub use pinc_export as export;
#[cfg(feature = "text")]
pub use pinc_expr as expr;
#[cfg(feature = "identify")]
pub use pinc_identify as identify;
pub use pinc_loop as closed_loop;
pub use pinc_mpc as mpc;
#[cfg(feature = "net")]
pub use pinc_net as net;
pub use pinc_ode as ode;
#[cfg(feature = "plants")]
pub use pinc_plants as plants;
pub use pinc_qp as qp;
#[cfg(feature = "experiments")]
pub use pinc_record as record;
#[cfg(feature = "experiments")]
pub use pinc_report as report;
#[cfg(feature = "experiments")]
pub use pinc_runs as runs;
#[cfg(feature = "verify")]
pub use pinc_verify as verify;
#[cfg(feature = "batch")]
pub use {pinc_batch as batch, pinc_sensitivity as sensitivity};

/// The example of `README.md`.
#[cfg(all(doctest, feature = "chart"))]
#[doc = include_str!("../README.md")]
struct Readme;

/// The names that most programs need: `use pinc::prelude::*`.
pub mod prelude {
    pub use pinc_ad::Scalar;
    #[cfg(feature = "estimate")]
    pub use pinc_estimate::{Augmentation, Augmented, Ekf, Estimator, Mhe, OutputFeedback, Ukf};
    pub use pinc_loop::ClosedLoop;
    pub use pinc_mpc::{Bounds, Nmpc, NmpcProblem, Reference, SqpConfig, SqpStatus, Weights};
    #[cfg(feature = "net")]
    pub use pinc_net::{Domain, NetConfig, PincModel, PincNet, Training, TrainingConfig};
    pub use pinc_ode::{Dopri5, Model, Plant, Rk4, Rk5, Variable};
}
