//! PINC.
mod activation;
mod ansatz;
mod domain;
mod error;
mod kernel;
mod loss;
mod mlp;
mod net;
mod normalizer;
mod sampling;
mod simd;

pub use ansatz::Ansatz;
pub use domain::Domain;
pub use error::{ModelError, NetError};
pub use kernel::BatchLoss;
pub use loss::{InitialScale, LossTerms, LossWeights, ResidualScale, reference_loss};
pub use mlp::{Mlp, MlpConfig};
pub use net::{NetConfig, PincNet, Scenario};
pub use normalizer::Normalizer;
pub use sampling::{Points, Sampler, initial_conditions};
pub use simd::Isa;
