//! The choices of a training.

use crate::error::{check, check_count, check_positive};
use crate::loss::{InitialScale, LossWeights, ResidualScale};
use crate::optim::{AutoConfig, OptimizerConfig};
use crate::sampling::Sampler;
use crate::{NetError, PincNet};
use serde::{Deserialize, Serialize};

/// The target that a net is trained on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TrainingTarget {
    /// The residual of the plant's equation at times in \[0, T\]: a PINC net.
    #[default]
    Physics,
    /// The plant's state at t = T, by an accurate integration ([`pinc_ode::AccurateIntegrator`]): a
    /// distilled net y0 + N(y0, u). Between 0 and T its values are meaningless. The points of the
    /// sample are initial states and inputs, and the loss has the term `MSE_D` alone.
    Integrator,
}

impl std::fmt::Display for TrainingTarget {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.serialize(f)
    }
}

/// Which net a training returns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum SelectNet {
    /// The net with the best score on validation: Algorithm 1.
    Best,
    /// The last net: the authors' code.
    Last,
}

/// A phase of the schedule: one optimizer for a number of iterations.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Phase {
    /// Optimizer of the phase, which starts afresh.
    pub optimizer: OptimizerConfig,
    /// Largest number of iterations.
    pub iterations: u64,
    /// Whether the next phase starts from the best net on validation rather than from the last.
    #[serde(default)]
    pub restore_best: bool,
}

impl Phase {
    /// At most `iterations` iterations of an optimizer; the next phase starts from the last net.
    #[must_use]
    pub fn new(optimizer: impl Into<OptimizerConfig>, iterations: u64) -> Self {
        Self { optimizer: optimizer.into(), iterations, restore_best: false }
    }
}

/// A sample of collocation points that grows when the net begins to fit the points rather than the
/// equation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GrowthConfig {
    /// Largest number of points in the sample.
    pub max_points: usize,
    /// Factor by which the sample grows each time.
    pub factor: usize,
    /// The sample grows when the loss on fresh points is this many times the loss on the sample.
    pub overfit_ratio: f64,
    /// Iterations between two evaluations of the loss on fresh points.
    pub check_every: u64,
    /// Number of fresh points.
    pub fresh_points: usize,
}

impl GrowthConfig {
    /// The recommended growth: from the sample's size to 16384 points, doubled each time.
    #[must_use]
    pub fn recommended() -> Self {
        Self {
            max_points: 16_384,
            factor: 2,
            overfit_ratio: 6.0,
            check_every: 50,
            fresh_points: 4096,
        }
    }
}

/// The choices of a training.
///
/// Others than the recommended ones are given by struct update:
///
/// ```
/// # use pinc_net::TrainingConfig;
/// let config = TrainingConfig { collocation_points: 256, ..TrainingConfig::recommended() };
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainingConfig {
    /// The target that the net is trained on.
    #[serde(default)]
    pub source: TrainingTarget,
    /// With source [`"integrator"`](TrainingTarget::Integrator): weight of the squared errors of
    /// the state's derivative along one random direction of (y0, u, p) per point, of unit length
    /// where half the width of the domain is 1, against the squared errors of the state. If absent, the state
    /// alone is fitted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub derivatives: Option<f64>,
    /// How collocation points are distributed.
    pub sampler: Sampler,
    /// Number `N_F` of collocation points, at the start if the sample grows; with source
    /// [`"integrator"`](TrainingTarget::Integrator) the number of initial states and inputs.
    pub collocation_points: usize,
    /// Number `N_t` of initial points of `MSE_y`, and of scenarios of the coupled grid. With a hard
    /// initial condition it has an effect on the coupled grid alone.
    pub initial_points: usize,
    /// Weight lambda of `MSE_F` in the loss.
    pub lambda: f64,
    /// The units in which residuals are squared.
    pub residual_scale: ResidualScale,
    /// The units in which errors of the initial condition and of measured states are squared.
    pub initial_scale: InitialScale,
    /// Phases of the training, one after the other.
    pub phases: Vec<Phase>,
    /// How the sample grows; it keeps its size if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub growth: Option<GrowthConfig>,
    /// Iterations between two validations.
    pub validation_every: u64,
    /// Which net is returned.
    pub keep: SelectNet,
    /// Accuracy at which the training stops and returns the current net: the root mean squared
    /// error of one step on validation, in the states' units. The training runs to its end if
    /// absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target_one_step_rms: Option<f64>,
}

impl TrainingConfig {
    /// The recommended training: 4000 iterations of a self-scaled Broyden method (of L-BFGS for
    /// large nets) on a Sobol sample of 1024 points, which grows when the net overfits it.
    ///
    /// With the hard initial condition and without measurements `initial_points`, `lambda` and
    /// `initial_scale` have no effect.
    #[must_use]
    pub fn recommended() -> Self {
        Self {
            source: TrainingTarget::Physics,
            derivatives: None,
            sampler: Sampler::Sobol,
            collocation_points: 1024,
            initial_points: 1024,
            lambda: 1.0,
            residual_scale: ResidualScale::Normalized,
            initial_scale: InitialScale::Normalized,
            phases: vec![Phase::new(AutoConfig::default(), 4000)],
            growth: Some(GrowthConfig::recommended()),
            validation_every: 100,
            keep: SelectNet::Best,
            target_one_step_rms: None,
        }
    }

    /// The weights in the loss of `net`.
    pub(crate) fn weights(&self, net: &PincNet) -> Result<LossWeights, NetError> {
        let Self { lambda, residual_scale, initial_scale, derivatives, .. } = self;
        let weights = LossWeights::new(net, *lambda, residual_scale, *initial_scale)?;
        Ok(LossWeights { derivatives: derivatives.unwrap_or(weights.derivatives), ..weights })
    }

    /// Checks the settings.
    ///
    /// # Errors
    ///
    /// [`NetError::Setting`] for one that makes no sense.
    pub fn validate(&self) -> Result<(), NetError> {
        let of_integrator = self.source == TrainingTarget::Integrator;
        let is_sampled = !(of_integrator && self.sampler == Sampler::CoupledGrid);
        let expected = "\"sobol\" or \"independent\" with source = \"integrator\"";
        check(is_sampled, "sampler", "coupled-grid", expected)?;
        if let Some(weight) = self.derivatives {
            let expected = "no such key without source = \"integrator\"";
            check(of_integrator, "derivatives", weight, expected)?;
            check_positive("derivatives", weight)?;
        }
        check_count("collocation_points", self.collocation_points)?;
        check_count("initial_points", self.initial_points)?;
        check(self.validation_every > 0, "validation_every", self.validation_every, "at least 1")?;
        check_count("phases", self.phases.len())?;
        for phase in &self.phases {
            phase.optimizer.validate()?;
        }
        if let Some(target) = self.target_one_step_rms {
            check_positive("target_one_step_rms", target)?;
        }
        if let Some(growth) = &self.growth {
            let GrowthConfig { factor, overfit_ratio, check_every, .. } = *growth;
            check(check_every > 0, "growth.check_every", check_every, "at least 1")?;
            check_count("growth.fresh_points", growth.fresh_points)?;
            check(factor >= 2, "growth.factor", factor, "at least 2")?;
            let key = "growth.overfit_ratio";
            check(overfit_ratio > 1.0, key, overfit_ratio, "a number above 1")?;
        }
        Ok(())
    }
}
