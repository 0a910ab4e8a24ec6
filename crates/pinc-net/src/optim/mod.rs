//! Optimizers of a smooth function of many variables, one file each.
//!
//! Each has its choices ([`OptimizerConfig`]), its memory (serializable, so that a run can go on after
//! an interruption bit for bit) and its arithmetic (a `step` that moves an [`Iterate`]).

mod adam;
mod inverse_hessian;
mod lbfgs;
mod line_search;
mod self_scaled_broyden;

pub use adam::AdamConfig;
pub use lbfgs::LbfgsConfig;
pub use line_search::LineSearch;
pub use self_scaled_broyden::SelfScaledBroydenConfig;

use crate::{NetError, Workers};
use adam::Adam;
use lbfgs::Lbfgs;
use self_scaled_broyden::SelfScaledBroyden;
use serde::{Deserialize, Serialize};

/// A function to be minimized.
pub trait Objective {
    /// The value at `x`, and the gradient there into `gradient` (both of the same length).
    fn evaluate(&mut self, x: &[f64], gradient: &mut [f64]) -> f64;
}

impl<F: FnMut(&[f64], &mut [f64]) -> f64> Objective for F {
    fn evaluate(&mut self, x: &[f64], gradient: &mut [f64]) -> f64 {
        self(x, gradient)
    }
}

/// A point, with the function's value and gradient there.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Iterate {
    /// The point.
    pub x: Vec<f64>,
    /// The value.
    pub value: f64,
    /// The gradient.
    pub gradient: Vec<f64>,
}

impl Iterate {
    /// The point `x` with the value and gradient of `objective` there.
    pub fn new(objective: &mut impl Objective, x: Vec<f64>) -> Self {
        let mut iterate = Self { gradient: vec![0.0; x.len()], x, value: 0.0 };
        iterate.reevaluate(objective);
        iterate
    }

    /// Computes value and gradient anew, after the function has changed.
    pub fn reevaluate(&mut self, objective: &mut impl Objective) {
        self.value = objective.evaluate(&self.x, &mut self.gradient);
    }

    /// Euclidean norm of the gradient.
    #[must_use]
    pub fn gradient_norm(&self) -> f64 {
        norm(&self.gradient)
    }

    /// Whether value and gradient are finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.value.is_finite() && self.gradient_norm().is_finite()
    }
}

/// What a step came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The iterate has moved; it is the point that was evaluated last.
    Moved,
    /// The gradient is below the tolerance; the iterate has not moved.
    Converged,
    /// No better point was found along the direction, nor along the steepest descent; the iterate has
    /// not moved. Near a minimum this means that rounding allows no further progress.
    Stuck,
}

/// Which optimizer, with its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OptimizerConfig {
    /// Adam.
    Adam(AdamConfig),
    /// Limited-memory BFGS.
    Lbfgs(LbfgsConfig),
    /// Self-scaled Broyden, with the full inverse Hessian.
    SelfScaledBroyden(SelfScaledBroydenConfig),
}

impl OptimizerConfig {
    /// Checks the settings.
    ///
    /// # Errors
    ///
    /// [`NetError::Setting`] for one that makes no sense.
    pub fn validate(&self) -> Result<(), NetError> {
        match self {
            Self::Adam(config) => config.validate(),
            Self::Lbfgs(config) => config.validate(),
            Self::SelfScaledBroyden(config) => config.validate(),
        }
    }
}

/// An optimizer at work.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Optimizer(Method);

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
enum Method {
    Adam(Adam),
    Lbfgs(Lbfgs),
    SelfScaledBroyden(SelfScaledBroyden),
}

impl Optimizer {
    /// An optimizer of functions of `variables` variables, with nothing learnt yet.
    #[must_use]
    pub fn new(config: &OptimizerConfig, variables: usize) -> Self {
        Self(match config {
            OptimizerConfig::Adam(config) => Method::Adam(Adam::new(config, variables)),
            OptimizerConfig::Lbfgs(config) => Method::Lbfgs(Lbfgs::new(config)),
            OptimizerConfig::SelfScaledBroyden(config) => {
                Method::SelfScaledBroyden(SelfScaledBroyden::new(config))
            }
        })
    }

    /// One iteration from `iterate`, whose value and gradient must be those of `objective`.
    ///
    /// Line searches step back from points where the function is not finite; a step of Adam may end in
    /// one.
    pub fn step(
        &mut self,
        objective: &mut impl Objective,
        iterate: &mut Iterate,
        workers: &Workers,
    ) -> Outcome {
        match &mut self.0 {
            Method::Adam(adam) => adam.step(objective, iterate),
            Method::Lbfgs(lbfgs) => lbfgs.step(objective, iterate),
            Method::SelfScaledBroyden(broyden) => broyden.step(objective, iterate, workers),
        }
    }

    /// Tells that the objective has changed, and `iterate` with it, at the same point. What has been
    /// learnt of the curvature is kept.
    pub fn refresh(&mut self, iterate: &Iterate, workers: &Workers) {
        if let Method::SelfScaledBroyden(broyden) = &mut self.0 {
            broyden.refresh(&iterate.gradient, workers);
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}

/// The setting `key`, which must satisfy `valid`.
fn check(
    key: &'static str,
    value: f64,
    valid: impl Fn(f64) -> bool,
    expected: &'static str,
) -> Result<(), NetError> {
    if valid(value) {
        return Ok(());
    }
    Err(NetError::Setting { key, found: value.to_string(), expected })
}
