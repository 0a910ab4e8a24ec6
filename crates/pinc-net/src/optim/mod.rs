//! Optimizers of a smooth function of many variables, one file each.
//!
//! Each has its choices ([`OptimizerConfig`]), its memory (serializable, so that a run can go on
//! after an interruption bit for bit) and its arithmetic (a `step` that moves an [`Iterate`]).

mod adam;
mod auto;
mod inverse_hessian;
mod lbfgs;
mod levenberg_marquardt;
mod line_search;
mod self_scaled_broyden;

pub use adam::AdamConfig;
pub use auto::AutoConfig;
pub use lbfgs::LbfgsConfig;
pub use levenberg_marquardt::LevenbergMarquardtConfig;
pub use line_search::LineSearch;
pub use self_scaled_broyden::SelfScaledBroydenConfig;

use crate::error::check;
use crate::{NetError, Workers};
use adam::Adam;
use lbfgs::Lbfgs;
use levenberg_marquardt::LevenbergMarquardt;
use self_scaled_broyden::SelfScaledBroyden;
use serde::{Deserialize, Serialize};

/// Norm of the gradient below which a minimum is taken for reached, unless another is given.
const GRADIENT_TOLERANCE: f64 = 1e-14;

/// A function to be minimized.
pub trait Objective {
    /// The value at `x`, and the gradient there into `gradient` (both of the same length).
    fn evaluate(&mut self, x: &[f64], gradient: &mut [f64]) -> f64;
}

/// A function to be minimized that is a sum of squares: its value is |r(x)|^2 with residuals r,
/// weights included. With J the Jacobian of r, its gradient is 2 J'r.
pub trait LeastSquares: Objective {
    /// The normal matrix J'J at `x`: half the Gauss-Newton approximation of the Hessian.
    ///
    /// # Shapes
    ///
    /// `out`: `[P, P]` for P variables, column by column. Only the lower triangle, `out[P * j + i]`
    /// with i >= j, has a meaning.
    fn normal_matrix(&mut self, x: &[f64], out: &mut [f64]);
}

/// A point, with the function's value and gradient there.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
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

    /// Changes the length of the point to `variables`.
    fn resize(&mut self, variables: usize) {
        self.x.resize(variables, 0.0);
        self.gradient.resize(variables, 0.0);
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

/// The outcome of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The iterate has moved; it is the point that was evaluated last.
    Moved,
    /// The gradient is below the tolerance; the iterate has not moved.
    Converged,
    /// No better point was found along the direction, nor along the steepest descent; the iterate
    /// has not moved. Near a minimum this means that rounding allows no further progress.
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
    /// Levenberg-Marquardt, with the normal matrix.
    LevenbergMarquardt(LevenbergMarquardtConfig),
    /// Self-scaled Broyden or L-BFGS, by the number of weights.
    #[serde(rename = "by-size")]
    Auto(AutoConfig),
}

impl OptimizerConfig {
    /// The optimizer for a net of `weights` weights and biases: a choice by size is made, all else
    /// stays.
    #[must_use]
    pub fn for_size(&self, weights: usize) -> Self {
        match self {
            Self::Auto(config) => config.choose(weights),
            chosen => chosen.clone(),
        }
    }

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
            Self::LevenbergMarquardt(config) => config.validate(),
            Self::Auto(config) => config.validate(),
        }
    }
}

impl From<AdamConfig> for OptimizerConfig {
    fn from(config: AdamConfig) -> Self {
        Self::Adam(config)
    }
}

impl From<LbfgsConfig> for OptimizerConfig {
    fn from(config: LbfgsConfig) -> Self {
        Self::Lbfgs(config)
    }
}

impl From<SelfScaledBroydenConfig> for OptimizerConfig {
    fn from(config: SelfScaledBroydenConfig) -> Self {
        Self::SelfScaledBroyden(config)
    }
}

impl From<LevenbergMarquardtConfig> for OptimizerConfig {
    fn from(config: LevenbergMarquardtConfig) -> Self {
        Self::LevenbergMarquardt(config)
    }
}

impl From<AutoConfig> for OptimizerConfig {
    fn from(config: AutoConfig) -> Self {
        Self::Auto(config)
    }
}

/// An optimizer at buffers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Optimizer(Method);

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
enum Method {
    Adam(Adam),
    Lbfgs(Lbfgs),
    SelfScaledBroyden(SelfScaledBroyden),
    LevenbergMarquardt(LevenbergMarquardt),
}

impl Optimizer {
    /// A fresh optimizer of functions of `variables` variables.
    #[must_use]
    pub fn new(config: &OptimizerConfig, variables: usize) -> Self {
        Self(match config {
            OptimizerConfig::Adam(config) => Method::Adam(Adam::new(config, variables)),
            OptimizerConfig::Lbfgs(config) => Method::Lbfgs(Lbfgs::new(config)),
            OptimizerConfig::SelfScaledBroyden(config) => {
                Method::SelfScaledBroyden(SelfScaledBroyden::new(config))
            }
            OptimizerConfig::LevenbergMarquardt(config) => {
                Method::LevenbergMarquardt(LevenbergMarquardt::new(config))
            }
            OptimizerConfig::Auto(config) => {
                return Self::new(&config.choose(variables), variables);
            }
        })
    }

    /// One iteration from `iterate`, whose value and gradient must come from `objective`.
    ///
    /// Where the function is not finite, line searches step back and Levenberg-Marquardt tries a
    /// smaller step; a step of Adam may end there.
    pub fn step(
        &mut self,
        objective: &mut impl LeastSquares,
        iterate: &mut Iterate,
        workers: &Workers,
    ) -> Outcome {
        match &mut self.0 {
            Method::Adam(adam) => adam.step(objective, iterate),
            Method::Lbfgs(lbfgs) => lbfgs.step(objective, iterate),
            Method::SelfScaledBroyden(broyden) => broyden.step(objective, iterate, workers),
            Method::LevenbergMarquardt(method) => method.step(objective, iterate),
        }
    }

    /// Tells that the objective has changed, and `iterate` with it, at the same point. What has
    /// been learnt of the curvature is kept.
    pub fn refresh(&mut self, iterate: &Iterate, workers: &Workers) {
        if let Method::SelfScaledBroyden(broyden) = &mut self.0 {
            broyden.refresh(&iterate.gradient, workers);
        }
    }
}

/// Buffers that carry nothing from one step to the next, kept to avoid allocations. They are
/// neither cloned nor serialized, and comparisons ignore them.
#[derive(Default)]
struct Scratch<T>(T);

impl<T> std::fmt::Debug for Scratch<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Scratch")
    }
}

impl<T: Default> Clone for Scratch<T> {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl<T> PartialEq for Scratch<T> {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Replaces the content of `to` by `values`.
fn set(to: &mut Vec<f64>, values: impl Iterator<Item = f64>) {
    to.clear();
    to.extend(values);
}

fn norm(a: &[f64]) -> f64 {
    dot(a, a).sqrt()
}

fn check_gradient_tolerance(tolerance: f64) -> Result<(), NetError> {
    check(tolerance >= 0.0, "gradient_tolerance", tolerance, "a number that is not negative")
}
