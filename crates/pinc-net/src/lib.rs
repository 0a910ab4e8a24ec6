//! Physics-informed nets for control: the model, its training from the equation alone, and its file.
//!
//! A [`PincNet`] maps (t, y(0), u) to y(t) for t in \[0, T\] (Eq. `net_pred` of the paper). It is trained
//! on the residual y' - f(y, u) of a [`pinc_ode::Plant`] at collocation points, chained over any
//! horizon, and offered to a controller as a [`pinc_ode::Model`] ([`PincModel`]).
//!
//! - [`Mlp::forward`], [`PincNet::state`] and [`reference_loss`] say what is computed, over any scalar;
//! - [`BatchLoss`] computes it fast (SIMD lanes, threads); tests hold the two together;
//! - a net may also be distilled from an accurate integration ([`TrainingTarget`]): same file, same controller;
//! - [`optim`] minimizes, [`Trainer`] runs the schedule, [`ValidationSet`] judges.
//!
//! ```
//! use pinc_net::optim::{OptimizerConfig, SelfScaledBroydenConfig};
//! use pinc_net::*;
//! use pinc_plants::VanDerPol;
//!
//! let plant = VanDerPol::default();
//! let domain = Domain {
//!     state_low: vec![-3.0, -4.35],
//!     state_high: vec![3.0, 4.35],
//!     input_low: vec![-1.0],
//!     input_high: vec![1.0],
//! };
//! let net = NetConfig {
//!     sample_time_s: 0.5,
//!     hidden_layers: 2,
//!     neurons: 10,
//!     ansatz: Ansatz::HardLinear,
//!     time_only: None,
//! };
//! let optimizer = OptimizerConfig::SelfScaledBroyden(SelfScaledBroydenConfig {
//!     initial_step: 0.1,
//!     gradient_tolerance: 1e-14,
//! });
//! let training = TrainingConfig {
//!     source: TrainingTarget::Physics,
//!     sampler: Sampler::Sobol,
//!     collocation_points: 512,
//!     initial_points: 1,
//!     lambda: 1.0,
//!     residual_scale: ResidualScale::Normalized,
//!     initial_scale: InitialScale::Normalized,
//!     phases: vec![Phase { optimizer, iterations: 200, restore_best: false }],
//!     growth: None,
//!     validation_every: 50,
//!     keep: SelectNet::Best,
//!     target_one_step_rms: None,
//! };
//! let scenarios = ValidationConfig {
//!     scenarios: 2,
//!     duration_s: 5.0,
//!     subintervals: 9,
//!     domain: Domain { state_low: vec![-3.0; 2], state_high: vec![3.0; 2], ..domain.clone() },
//!     tolerance: 1e-10,
//!     one_step_points: 100,
//! };
//! let validation = ValidationSet::generate(&plant, 0.5, &scenarios, 1)?;
//!
//! let mut trainer = Trainer::new(&plant, &net, &domain, &training, validation, 0, 1)?;
//! while let Progress::Iterated(_) = trainer.step()? {}
//! assert!(trainer.validate().one_step_mse < 1e-2);
//! # Ok::<(), NetError>(())
//! ```

mod ansatz;
mod data;
mod domain;
mod error;
mod kernel;
mod labels;
mod loss;
mod mlp;
mod model;
mod net;
mod normalizer;
pub mod optim;
mod predictor;
mod sampling;
mod schedule;
mod trainer;
mod validation;
mod workers;

pub use ansatz::Ansatz;
pub use data::{Measurements, Recorded};
pub use domain::Domain;
pub use error::{ModelError, NetError};
pub use kernel::BatchLoss;
pub use loss::{
    InitialScale, LossTerms, LossWeights, ResidualScale, reference_loss, reference_measured,
    reference_residuals,
};
pub use mlp::Mlp;
pub use net::{NetConfig, PincNet, Scenario};
pub use normalizer::Normalizer;
pub use pinc_ad::simd::Isa;
pub use predictor::PincModel;
pub use sampling::{Points, Sampler, initial_conditions};
pub use schedule::{
    GrowthConfig, IterationRecord, Phase, Progress, SelectNet, StopReason, Totals, TrainingConfig,
    TrainingTarget,
};
pub use trainer::{Checkpoint, Trainer};
pub use validation::{Validation, ValidationConfig, ValidationSet};
pub use workers::Workers;
