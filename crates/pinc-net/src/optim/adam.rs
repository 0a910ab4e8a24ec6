//! Adam.

use super::{Iterate, Objective, Outcome};
use crate::NetError;
use crate::error::{check, check_positive};
use serde::{Deserialize, Serialize};

/// Settings of Adam: Kingma and Ba, "Adam: a method for stochastic optimization" (2014).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AdamConfig {
    /// Step size.
    pub learning_rate: f64,
    /// Decay of the mean of gradients.
    #[serde(default = "default_beta1")]
    pub beta1: f64,
    /// Decay of the mean of squared gradients.
    #[serde(default = "default_beta2")]
    pub beta2: f64,
    /// Number added to the root of the mean square.
    #[serde(default = "default_epsilon")]
    pub epsilon: f64,
}

fn default_beta1() -> f64 {
    0.9
}

fn default_beta2() -> f64 {
    0.999
}

/// The authors' value.
fn default_epsilon() -> f64 {
    1e-7
}

impl AdamConfig {
    /// Adam with the usual decays and this step size.
    #[must_use]
    pub fn new(learning_rate: f64) -> Self {
        let (beta1, beta2, epsilon) = (default_beta1(), default_beta2(), default_epsilon());
        Self { learning_rate, beta1, beta2, epsilon }
    }

    pub(super) fn validate(&self) -> Result<(), NetError> {
        check_positive("learning_rate", self.learning_rate)?;
        for (key, beta) in [("beta1", self.beta1), ("beta2", self.beta2)] {
            check((0.0..1.0).contains(&beta), key, beta, "a number in [0, 1)")?;
        }
        check_positive("epsilon", self.epsilon)
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Adam {
    config: AdamConfig,
    mean: Vec<f64>,
    mean_square: Vec<f64>,
    steps: i32,
}

impl Adam {
    pub(super) fn new(config: &AdamConfig, variables: usize) -> Self {
        let zeros = vec![0.0; variables];
        Self { config: config.clone(), mean: zeros.clone(), mean_square: zeros, steps: 0 }
    }

    pub(super) fn step(&mut self, objective: &mut impl Objective, at: &mut Iterate) -> Outcome {
        let AdamConfig { learning_rate, beta1, beta2, epsilon } = self.config;
        self.steps = self.steps.saturating_add(1);
        let correct1 = 1.0 - beta1.powi(self.steps);
        let correct2 = 1.0 - beta2.powi(self.steps);
        let moments = self.mean.iter_mut().zip(&mut self.mean_square);
        for ((x, &g), (m, v)) in at.x.iter_mut().zip(&at.gradient).zip(moments) {
            *m = beta1 * *m + (1.0 - beta1) * g;
            *v = beta2 * *v + (1.0 - beta2) * g * g;
            *x -= learning_rate * (*m / correct1) / ((*v / correct2).sqrt() + epsilon);
        }
        at.reevaluate(objective);
        Outcome::Moved
    }
}
