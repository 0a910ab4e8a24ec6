//! The choice between full and limited memory by the size of the net.

use super::{LbfgsConfig, LineSearch, OptimizerConfig, SelfScaledBroydenConfig};
use crate::NetError;
use serde::{Deserialize, Serialize};

/// Self-scaled Broyden for nets up to a size, L-BFGS for larger ones.
///
/// The full inverse Hessian takes 4 P^2 bytes for P weights and biases and a pass over them in each
/// iteration; L-BFGS is linear in P, but gains less per iteration. Where the one overtakes the
/// other is measured in `docs/measurements.md`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AutoConfig {
    /// The largest number of weights and biases with the full inverse Hessian.
    pub max_full_memory_weights: usize,
    /// Settings for nets up to this size.
    pub full_memory: SelfScaledBroydenConfig,
    /// Settings for larger nets.
    pub limited_memory: LbfgsConfig,
}

impl Default for AutoConfig {
    /// The recommended choice.
    fn default() -> Self {
        let (memory, line_search) = (20, LineSearch::WeakWolfe);
        Self {
            max_full_memory_weights: 8000,
            full_memory: SelfScaledBroydenConfig::default(),
            limited_memory: LbfgsConfig { memory, line_search, ..LbfgsConfig::default() },
        }
    }
}

impl AutoConfig {
    pub(super) fn validate(&self) -> Result<(), NetError> {
        self.full_memory.validate()?;
        self.limited_memory.validate()
    }

    pub(super) fn choose(&self, weights: usize) -> OptimizerConfig {
        if weights <= self.max_full_memory_weights {
            OptimizerConfig::SelfScaledBroyden(self.full_memory.clone())
        } else {
            OptimizerConfig::Lbfgs(self.limited_memory.clone())
        }
    }
}
