//! PINC.
mod activation;
mod ansatz;
mod domain;
mod error;
mod kernel;
mod loss;
mod mlp;
mod model;
mod net;
mod normalizer;
pub mod optim;
mod predictor;
mod sampling;
mod simd;
mod trainer;
mod validation;
mod workers;

pub use ansatz::Ansatz;
pub use domain::Domain;
pub use error::{ModelError, NetError};
pub use kernel::BatchLoss;
pub use loss::{InitialScale, LossTerms, LossWeights, ResidualScale, reference_loss};
pub use mlp::{Mlp, MlpConfig};
pub use net::{NetConfig, PincNet, Scenario};
pub use normalizer::Normalizer;
pub use sampling::{Points, Sampler, initial_conditions};
pub use predictor::PincPredictor;
pub use simd::Isa;
pub use trainer::{
    Checkpoint, GrowthConfig, IterationRecord, Keep, Phase, Progress, StopReason, Totals, Trainer,
    TrainingConfig,
};
pub use validation::{Validation, ValidationConfig, ValidationSet};
pub use workers::Workers;
