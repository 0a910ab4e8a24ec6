//! Sequential quadratic programming with Gauss-Newton Hessians.

use crate::cost::Targets;
use crate::error::{check_range, check_setting};
use crate::kkt::KktResidual;
use crate::qp::{ChosenQp, Qp, QpMethod, QpSolver, QpStatus, QpStep};
use crate::shape::Shape;
use crate::solution::Solution;
use crate::transcription::Transcription;
use crate::{MpcError, NmpcProblem};
use pinc_ode::Predictor;
use serde::{Deserialize, Serialize};
use std::fmt;

/// How the optimisation of a control step ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum SqpStatus {
    /// The KKT residual is within the tolerance.
    Converged,
    /// It is not, after all the iterations that are allowed.
    IterationLimit,
    /// No step satisfies the linearised dynamics and the bounds.
    InfeasibleQp,
    /// The model gave NaN or infinity, or the QP solver broke off.
    NumericalTrouble,
}

/// The serialised name, as `converged`.
impl fmt::Display for SqpStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Converged => "converged",
            Self::IterationLimit => "iteration-limit",
            Self::InfeasibleQp => "infeasible-qp",
            Self::NumericalTrouble => "numerical-trouble",
        })
    }
}

/// The choices of the optimisation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SqpConfig {
    /// The largest [`KktResidual`] that counts as converged; 1e-8 unless said otherwise.
    pub tolerance: f64,
    /// How many QPs a control step may solve; 50 unless said otherwise.
    pub max_iterations: usize,
    /// What solves the QPs; chosen by their size unless said otherwise.
    pub qp: QpMethod,
}

impl Default for SqpConfig {
    fn default() -> Self {
        Self { tolerance: 1e-8, max_iterations: 50, qp: QpMethod::Auto }
    }
}

impl SqpConfig {
    /// Checks the choices.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if the tolerance is not positive and finite, or no iteration is allowed.
    pub fn validate(&self) -> Result<(), MpcError> {
        let good = self.tolerance > 0.0 && self.tolerance.is_finite();
        check_setting("tolerance", self.tolerance, "positive and finite", good)?;
        check_range("max_iterations", self.max_iterations, 1, usize::MAX)
    }
}

/// Full-step SQP: linearise the problem at the current plan, solve the QP, take its step and its
/// multipliers, until the KKT residual is small.
///
/// With the Gauss-Newton Hessian this converges linearly, the faster the smaller the multipliers of
/// the dynamics times their curvature. Nothing enforces convergence from afar: a run that diverges
/// ends at the iteration limit. Reference: Nocedal and Wright, *Numerical Optimization*, chapter 18;
/// Diehl et al., "Real-time optimization for large scale processes", J. Process Control 12 (2002).
///
/// All memory is allocated at construction, but for what Clarabel does inside.
#[derive(Debug)]
pub(crate) struct Sqp {
    config: SqpConfig,
    transcription: Transcription,
    qp: Qp,
    solver: ChosenQp,
    step: QpStep,
    work: Vec<f64>,
}

/// What came of an optimisation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Outcome {
    pub(crate) status: SqpStatus,
    pub(crate) iterations: usize,
    /// The residual at the start.
    pub(crate) first: KktResidual,
    /// The residual at the end.
    pub(crate) last: KktResidual,
}

impl Sqp {
    pub(crate) fn new(
        problem: &NmpcProblem,
        config: SqpConfig,
        shape: Shape,
        horizon_s: f64,
    ) -> Self {
        let transcription = Transcription::new(problem, shape, horizon_s);
        let qp = transcription.qp(problem);
        let solver = ChosenQp::new(&qp, config.qp);
        let (step, work) = (QpStep::new(shape), vec![0.0; shape.unknowns()]);
        Self { config, transcription, qp, solver, step, work }
    }

    /// Moves the plan into its bounds.
    pub(crate) fn project(&self, plan: &mut Solution, previous: &[f64]) {
        self.transcription.project(plan, previous);
    }

    /// Improves the plan for a plant measured to be at `x0`. The plan must be within its bounds and
    /// stays there.
    pub(crate) fn solve(
        &mut self,
        model: &mut dyn Predictor,
        x0: &[f64],
        targets: Targets<'_>,
        plan: &mut Solution,
    ) -> Outcome {
        let first = self.linearize(model, x0, targets, plan);
        let (mut last, mut iterations) = (first, 0);
        let status = loop {
            if let Some(status) = self.verdict(last, iterations) {
                break status;
            }
            self.step.multipliers.copy_from(&plan.multipliers);
            match self.solver.solve(&self.qp, &mut self.step) {
                QpStatus::Solved => iterations += 1,
                QpStatus::Infeasible(_) => break SqpStatus::InfeasibleQp,
                QpStatus::Failed => break SqpStatus::NumericalTrouble,
            }
            for (z, d) in plan.z.iter_mut().zip(&self.step.d) {
                *z += d;
            }
            plan.multipliers.copy_from(&self.step.multipliers);
            // The interior-point step may be outside by its tolerance.
            self.project(plan, targets.previous);
            last = self.linearize(model, x0, targets, plan);
        };
        Outcome { status, iterations, first, last }
    }

    fn linearize(
        &mut self,
        model: &mut dyn Predictor,
        x0: &[f64],
        targets: Targets<'_>,
        plan: &Solution,
    ) -> KktResidual {
        self.transcription.linearize(model, x0, targets, plan, &mut self.qp);
        KktResidual::new(&self.qp, plan, &mut self.work)
    }

    /// Whether to stop after so many iterations with this residual.
    fn verdict(&self, kkt: KktResidual, iterations: usize) -> Option<SqpStatus> {
        if !kkt.max().is_finite() {
            Some(SqpStatus::NumericalTrouble)
        } else if kkt.max() <= self.config.tolerance {
            Some(SqpStatus::Converged)
        } else if iterations == self.config.max_iterations {
            Some(SqpStatus::IterationLimit)
        } else {
            None
        }
    }
}
