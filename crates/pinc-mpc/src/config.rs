//! The choices of the optimization, and how it ends.

use crate::error::{check_range, check_setting};
use crate::{MpcError, NmpcProblem, QpMethod};
use serde::{Deserialize, Serialize};
use std::fmt;

/// How the optimization of a control step ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum SqpStatus {
    /// The KKT residual is within the tolerance.
    Converged,
    /// Inputs that are whole numbers were rounded, since the search among them was not finished. The
    /// KKT residual with these inputs held is within the tolerance.
    Rounded,
    /// It is not, after all the iterations that are allowed.
    IterationLimit,
    /// It is not, and there was no time for more.
    Deadline,
    /// One step of a real-time iteration was taken; its outcome is not judged.
    Prepared,
    /// A net's plan passed its check. Nothing was optimized.
    Kept,
    /// The check of a net's plan preferred another one. Nothing was optimized.
    Replaced,
    /// No plan satisfies the dynamics and the hard constraints, near the one found.
    InfeasibleQp,
    /// The residual is above the tolerance, and no step makes the plan better: it is as good as
    /// rounding or a kink of the model allows.
    Stalled,
    /// The model gave NaN or infinity, or the QP solver found no solution.
    NumericalTrouble,
    /// The state is not known: a measurement is missing, that is NaN or infinite. Nothing was
    /// optimized, and the input is the last one, moved into its bounds.
    BadArgument,
}

impl SqpStatus {
    /// Whether the plan solves its problem, or the program of a real-time iteration.
    #[must_use]
    pub fn is_solved(self) -> bool {
        match self {
            Self::Converged | Self::Rounded | Self::Prepared => true,
            Self::IterationLimit
            | Self::Deadline
            | Self::Kept
            | Self::Replaced
            | Self::InfeasibleQp
            | Self::Stalled
            | Self::NumericalTrouble
            | Self::BadArgument => false,
        }
    }
}

/// The serialized name, as `converged`.
impl fmt::Display for SqpStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

/// The Hessian of the QPs. With a stage cost that leaves out its own ([`StageCost`](crate::StageCost))
/// it is always the exact one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum SqpHessian {
    /// `Adaptive` on a scenario tree, where the cost leaves inputs free
    /// ([`NmpcProblem::leaves_inputs_free`]), and with constraints h and g; otherwise `GaussNewton`, until
    /// so many QPs were slow that the step might end at its limit, or one gave a step without descent.
    #[default]
    Auto,
    /// Without the curvature of model, outputs, h and g.
    GaussNewton,
    /// Gauss-Newton, and where it is slow or has no descent the exact Hessian of the Lagrangian, made
    /// convex. It needs second derivatives, which make a QP several times as expensive.
    Adaptive,
}

impl SqpHessian {
    /// `Adaptive` in place of `Auto` for a problem that needs it.
    #[must_use]
    pub fn resolve(self, problem: &NmpcProblem) -> Self {
        match self {
            Self::Auto
                if !problem.tree().is_chain()
                    || problem.leaves_inputs_free()
                    || problem.constraints.is_some() =>
            {
                Self::Adaptive
            }
            Self::Auto | Self::GaussNewton | Self::Adaptive => self,
        }
    }
}

/// The choices of the optimization.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SqpConfig {
    /// The largest KKT residual ([`KktResidual`](crate::KktResidual)) that counts as converged.
    pub tolerance: f64,
    /// The most QPs that a control step solves, with the iterations of a barrier method where QPs are slow.
    pub max_iterations: usize,
    /// Whether each control step solves one QP only, prepared before the state is measured: the
    /// real-time iteration of Diehl et al. (2002).
    pub real_time: bool,
    /// The method that solves the QPs.
    pub qp: QpMethod,
    /// The Hessian of the QPs.
    pub hessian: SqpHessian,
    /// From how many first plans a step that has no plan to start from is solved, within its budget:
    /// the plan given or the last input held, and constant inputs spread over their bounds. The
    /// cheapest plan that converges is kept. Each start may take `max_iterations` QPs.
    pub starts: usize,
}

impl Default for SqpConfig {
    fn default() -> Self {
        Self {
            tolerance: 1e-8,
            max_iterations: 50,
            real_time: false,
            qp: QpMethod::Auto,
            hessian: SqpHessian::Auto,
            starts: 1,
        }
    }
}

impl SqpConfig {
    /// Checks the choices.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if the tolerance is not positive and finite, no iteration is allowed, or real-time
    /// iterations have several starts.
    pub fn validate(&self) -> Result<(), MpcError> {
        let good = self.tolerance > 0.0 && self.tolerance.is_finite();
        check_setting("tolerance", self.tolerance, "positive and finite", good)?;
        check_range("max_iterations", self.max_iterations, 1, usize::MAX)?;
        let most = if self.real_time { 1 } else { 10_000 };
        check_range("starts", self.starts, 1, most)
    }
}
