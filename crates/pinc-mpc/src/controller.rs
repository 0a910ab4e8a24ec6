//! The controller.

use crate::cost::Targets;
use crate::error::check_finite;
use crate::kkt::KktResidual;
use crate::shape::Shape;
use crate::solution::Solution;
use crate::sqp::{Outcome, Sqp};
use crate::{MpcError, NmpcProblem, SqpConfig, SqpStatus};
use pinc_ode::Predictor;

/// Nonlinear model predictive control, Algorithm 2 of the paper, with any [`Predictor`] as the model.
///
/// Each [`Nmpc::step`] solves the [`NmpcProblem`], starting from the last plan moved on by a step,
/// and gives the plan's first input.
///
/// When the optimisation fails, the status says so, and the input is within its bounds all the same.
/// A plan that is not optimal yet, but better than the first guess and true to the model (to the
/// square root of the tolerance), is followed: suboptimal control suffices (Scokaert, Mayne and
/// Rawlings, IEEE Trans. Autom. Control 44 (1999)). Otherwise the input is the next one of the last
/// plan (0 before there is one), and the step after starts afresh from the state measured then, so
/// that one failure does not lead to the next.
///
/// ```
/// use pinc_mpc::{Bounds, Nmpc, NmpcProblem, SqpConfig, SqpStatus, Weights};
/// use pinc_ode::{Predictor, Rk4, VanDerPol};
///
/// let model = Rk4::new(VanDerPol::default(), 0.5, 4);
/// let weights = Weights::uniform(vec![10.0, 10.0], vec![1.0]);
/// let problem = NmpcProblem {
///     state_bounds: Bounds { low: vec![-1.0; 2], high: vec![1.0; 2] },
///     input_bounds: Bounds { low: vec![-1.0], high: vec![1.0] },
///     ..NmpcProblem::new(model.dims(), 5, weights)
/// };
/// let mut nmpc = Nmpc::new(problem, Box::new(model), SqpConfig::default())?;
/// let step = nmpc.step(&[1.0, 0.0], &[0.0; 10])?;
/// assert_eq!(step.status, SqpStatus::Converged);
/// assert!(step.u[0].abs() <= 1.0);
/// # Ok::<(), pinc_mpc::MpcError>(())
/// ```
#[derive(Debug)]
pub struct Nmpc {
    problem: NmpcProblem,
    model: Box<dyn Predictor>,
    config: SqpConfig,
    shape: Shape,
    sqp: Sqp,
    plan: Solution,
    /// The last plan, moved on.
    fallback: Solution,
    /// Whether the plan's states are worth starting from.
    warm: bool,
    /// u\[k-1\]
    previous: Vec<f64>,
}

/// What came of a control step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepReport<'a> {
    /// The input to apply, within its bounds whatever the status.
    pub u: &'a [f64],
    /// How the optimisation ended.
    pub status: SqpStatus,
    /// How many QPs were solved.
    pub sqp_iterations: usize,
    /// The residual of the plan that `u` begins; not finite if the model has no value there.
    pub kkt: KktResidual,
}

impl Nmpc {
    /// A controller for `problem` with the model `model`.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if the problem does not suit the model, or `config` is no sensible choice.
    pub fn new(
        problem: NmpcProblem,
        model: Box<dyn Predictor>,
        config: SqpConfig,
    ) -> Result<Self, MpcError> {
        problem.validate(model.dims())?;
        config.validate()?;
        let shape = Shape::new(&problem, model.dims());
        let sqp = Sqp::new(&problem, config, shape, model.horizon_s());
        let plan = Solution::new(shape);
        Ok(Self {
            problem,
            model,
            config,
            shape,
            sqp,
            fallback: plan.clone(),
            plan,
            warm: false,
            previous: vec![0.0; shape.inputs],
        })
    }

    /// The problem that is solved.
    #[must_use]
    pub fn problem(&self) -> &NmpcProblem {
        &self.problem
    }

    /// The model.
    #[must_use]
    pub fn model(&self) -> &dyn Predictor {
        self.model.as_ref()
    }

    /// The plan of the last step, with its multipliers.
    #[must_use]
    pub fn plan(&self) -> &Solution {
        &self.plan
    }

    /// Forgets everything: the next step is again the first one, with u\[k-1\] = 0.
    pub fn reset(&mut self) {
        self.plan = Solution::new(self.shape);
        self.warm = false;
        self.previous.fill(0.0);
    }

    /// Chooses the input for a plant measured to be at `x`.
    ///
    /// # Shapes
    ///
    /// `x`: `n`; `reference`: yref\[k+1\]..yref\[k+N2\], `[N2, outputs]`, row by row.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if an argument is of the wrong length or not finite; nothing has happened then.
    pub fn step(&mut self, x: &[f64], reference: &[f64]) -> Result<StepReport<'_>, MpcError> {
        check_finite("x", x, self.shape.states)?;
        let outputs = self.problem.controlled.len();
        check_finite("reference", reference, self.shape.stages * outputs)?;

        self.move_on(x);
        let targets = Targets { reference, previous: &self.previous };
        let model = self.model.as_mut();
        let outcome = self.sqp.solve(model, x, targets, &mut self.plan);
        let kkt = self.accept(&outcome);
        self.previous.copy_from_slice(self.plan.first_input());
        Ok(StepReport {
            u: self.plan.first_input(),
            status: outcome.status,
            sqp_iterations: outcome.iterations,
            kkt,
        })
    }

    /// Makes the last plan the first guess of the next.
    fn move_on(&mut self, x: &[f64]) {
        self.plan.shift();
        if !self.warm {
            self.plan.stay_at(x);
        }
        self.sqp.project(&mut self.plan, &self.previous);
        self.fallback.copy_from(&self.plan);
    }

    /// Keeps the new plan if it is worth following, or else takes the first guess; gives the
    /// residual of the one taken.
    fn accept(&mut self, outcome: &Outcome) -> KktResidual {
        let Outcome { status, iterations, first, last } = *outcome;
        let credible = last.dynamics <= self.config.tolerance.sqrt();
        self.warm = status == SqpStatus::Converged || credible && last.max() < first.max();
        if status != SqpStatus::Converged {
            tracing::debug!(%status, iterations, kkt = last.max(), "a control step did not converge");
        }
        if self.warm {
            last
        } else {
            self.plan.copy_from(&self.fallback);
            first
        }
    }
}
