//! Putting a controller together.

use crate::horizon::Horizon;
use crate::sqp::Sqp;
use crate::{MpcError, Nmpc, NmpcProblem, SqpConfig, StageCost};
use pinc_ode::Model;

/// The parts of a controller.
///
/// ```
/// use pinc_mpc::{Nmpc, NmpcProblem, SqpStatus, Weights};
/// use pinc_ode::{Model, Rk4};
/// use pinc_plants::VanDerPol;
///
/// // Two steps of 0.5 s, then three of 1.5 s.
/// let [near, far] = [0.5, 1.5].map(|length| Rk4::new(VanDerPol::default(), length, 8));
/// let weights = Weights::uniform(vec![10.0; 2], vec![1.0]);
/// let mut nmpc = Nmpc::builder(NmpcProblem::new(near.dims(), 5, weights))
///     .stages(Box::new(near), 2)
///     .stages(Box::new(far), 3)
///     .build()?;
/// let step = nmpc.step(&[0.5, 0.0], &[0.0; 10])?;
/// assert_eq!(step.status, SqpStatus::Converged);
/// # Ok::<(), pinc_mpc::MpcError>(())
/// ```
#[derive(Debug)]
#[must_use = "the controller is made by `build`"]
pub struct NmpcBuilder {
    problem: NmpcProblem,
    models: Vec<(Box<dyn Model>, usize)>,
    stage_cost: Option<Box<dyn StageCost>>,
    config: SqpConfig,
}

impl NmpcBuilder {
    /// A controller for `problem`, so far without a model.
    pub fn new(problem: NmpcProblem) -> Self {
        Self { problem, models: Vec::new(), stage_cost: None, config: SqpConfig::default() }
    }

    /// One model for all stages.
    pub fn model(self, model: Box<dyn Model>) -> Self {
        let stages = self.problem.horizon;
        self.stages(model, stages)
    }

    /// A model for the next `count` stages, each of its sample time. The controller steps by the
    /// first stage's, which must not be longer than any other.
    pub fn stages(mut self, model: Box<dyn Model>, count: usize) -> Self {
        self.models.push((model, count));
        self
    }

    /// A cost per stage beside the tracking cost.
    pub fn stage_cost(mut self, cost: Box<dyn StageCost>) -> Self {
        self.stage_cost = Some(cost);
        self
    }

    /// The choices of the optimization.
    pub fn config(mut self, config: SqpConfig) -> Self {
        self.config = config;
        self
    }

    /// The controller.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if the problem does not suit the models, these do not make up the horizon, or
    /// the configuration is no sensible choice.
    pub fn build(self) -> Result<Nmpc, MpcError> {
        let Self { problem, models, stage_cost, config } = self;
        if let Some((model, _)) = models.first() {
            problem.validate(model.dims())?;
        }
        config.validate()?;
        let horizon = Horizon::new(models, problem.horizon)?;
        let sqp = Sqp::new(&problem, config, &horizon, stage_cost)?;
        Ok(Nmpc::of(problem, horizon, config, sqp))
    }
}
