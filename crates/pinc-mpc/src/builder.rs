//! Putting a controller together.

use crate::error::check_numbers;
use crate::guard::{Guard, Judge};
use crate::horizon::Horizon;
use crate::sqp::Sqp;
use crate::{Bounds, MpcError, Nmpc, NmpcProblem, PlanSearch, SqpConfig, StageCost};
use pinc_ode::Model;
use pinc_tube::Tube;

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
    guard: Option<Guard>,
    tube: Option<Box<dyn Tube>>,
    search: Option<Box<dyn PlanSearch>>,
}

impl NmpcBuilder {
    /// A controller for `problem`, so far without a model.
    pub fn new(problem: NmpcProblem) -> Self {
        let (models, config) = (Vec::new(), SqpConfig::default());
        Self { problem, models, stage_cost: None, config, guard: None, tube: None, search: None }
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

    /// Lets `judge` look at the first step of each plan. If it does not trust the model there, the
    /// `substitute`, a controller for the same problem with another model, makes the step over from
    /// the same plan, and its plan is the one that the next step starts from; without a substitute
    /// the plan is followed. A step without a plan to follow is not judged.
    ///
    /// The substitute's parameters are the judge's to say: see [`Judge::substitute_parameters`].
    pub fn guard(mut self, judge: Box<dyn Judge>, substitute: Option<Nmpc>) -> Self {
        self.guard = Some(Guard::new(judge, substitute));
        self
    }

    /// Tightens the bounds of each step by `tube`, along the plan of the step before (zero-order
    /// robust optimization: A. Zanelli, J. Frey, F. Messerer, M. Diehl, IFAC-PapersOnLine 54-6
    /// (2021)). The controller has stages of one length, no scenarios, no delay and no substitute.
    pub fn tube(mut self, tube: Box<dyn Tube>) -> Self {
        self.tube = Some(tube);
        self
    }

    /// Lets `search` choose the plan of each step. Real-time iterations are not searched.
    pub fn search(mut self, search: Box<dyn PlanSearch>) -> Self {
        self.search = Some(search);
        self
    }

    /// The controller.
    ///
    /// # Errors
    ///
    /// [`MpcError::Argument`] if the substitute is for a problem of other sizes, and [`MpcError`] if
    /// the problem does not suit the models, these do not make up the horizon, or
    /// the configuration is no sensible choice.
    pub fn build(self) -> Result<Nmpc, MpcError> {
        let Self { problem, models, stage_cost, config, guard, tube, search } = self;
        if let Some((model, _)) = models.first() {
            problem.validate(model.dims())?;
        }
        config.validate()?;
        let exact = stage_cost.as_ref().is_some_and(|cost| cost.leaves_out_hessian());
        if exact && config.real_time {
            return Err(MpcError::CurvedInRealTime);
        }
        if config.real_time && !problem.periodic.is_empty() {
            return Err(MpcError::WithOrbit("real-time iterations"));
        }
        if config.starts > 1 {
            let Bounds { low, high } = &problem.input_bounds;
            check_numbers("input_bounds.low", low, "finite with several starts", f64::is_finite)?;
            check_numbers("input_bounds.high", high, "finite with several starts", f64::is_finite)?;
        }
        let horizon = Horizon::new(models, problem.horizon, problem.tree())?;
        if !horizon.is_uniform() && !problem.tree().is_chain() {
            return Err(MpcError::WithScenarios("stages of different lengths"));
        }
        let mut sqp = Sqp::new(&problem, config, &horizon, stage_cost)?;
        if let Some(tube) = tube {
            let substituted = guard.as_ref().is_some_and(|guard| guard.substitute.is_some());
            for (what, is_there) in [
                ("scenarios", !problem.tree().is_chain()),
                ("stages of different lengths", !horizon.is_uniform()),
                ("a delay", problem.delay > 0),
                ("a substitute controller", substituted),
                ("whole inputs", search.is_some()),
                ("several starts", config.starts > 1),
                ("a periodic plan", !problem.periodic.is_empty()),
            ] {
                if is_there {
                    return Err(MpcError::WithTube(what));
                }
            }
            sqp.transcription.set_tube(tube, horizon.dims().ny);
        }
        let mut nmpc = Nmpc::of(problem, horizon, config, sqp);
        nmpc.search = search;
        nmpc.with_guard(guard)
    }
}
