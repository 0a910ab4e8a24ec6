#![doc = include_str!("../README.md")]
//! # Tour
//!
//! A [`PincNet`] maps (t, y(0), u) to y(t) for t in \[0, T\] (Eq. `net_pred` of the paper). The net
//! of a family of plants takes the plant's parameters as further inputs. Training minimizes the
//! residual y' - f(y, u) of a [`pinc_ode::Plant`] at collocation points. A [`PincModel`] offers the
//! net to a controller as a [`pinc_ode::Model`], chained over any horizon.
//!
//! - [`Training`] describes a training and runs it; a [`Trainer`] is one in progress, which can be
//!   watched, interrupted and resumed.
//! - [`Mlp::forward`], [`PincNet::state`] and [`reference_loss`] define the computation over any
//!   scalar. [`BatchLoss`] does it fast, with SIMD lanes and threads; tests compare the two.
//! - [`TrainingTarget`]: a net may also be distilled from an accurate integration. Its file and its
//!   use are the same.
//! - [`optim`]: the optimizers. [`ValidationSet`]: judges a net on other scenarios.

#![forbid(unsafe_code)]

mod ansatz;
mod config;
mod domain;
mod domain_error;
mod error;
mod file;
mod folded;
mod kernel;
mod labels;
mod loss;
mod measurements;
mod mlp;
mod model;
mod net;
mod normalizer;
pub mod optim;
mod progress;
mod sampling;
mod trainer;
mod training;
mod validation;
mod workers;

pub use ansatz::Ansatz;
pub use config::{GrowthConfig, Phase, SelectNet, TrainingConfig, TrainingTarget};
pub use domain::{Domain, ParameterRange};
pub use domain_error::{DomainError, DomainTruth, RmsError, WorstStep};
pub use error::{ModelError, NetError};
pub use folded::{FoldedNet, PlainLayer};
pub use kernel::BatchLoss;
pub use loss::{
    InitialScale, LossTerms, LossWeights, ResidualScale, reference_loss, reference_measured,
    reference_residuals,
};
pub use measurements::{Measurements, Recorded};
pub use mlp::Mlp;
pub use model::PincModel;
pub use net::{NetConfig, PincNet, Scenario};
pub use normalizer::Normalizer;
pub use pinc_ad::simd::Isa;
pub use progress::{IterationRecord, Progress, StopReason, Totals};
pub use sampling::{Points, Sampler, initial_conditions};
pub use trainer::{Checkpoint, Trainer};
pub use training::{Trained, Training};
pub use validation::{Validation, ValidationConfig, ValidationSet};
pub use workers::Workers;
