//! Which method solves the QPs.

use super::{ClarabelQp, CondensedQp, Qp, QpSolver, QpStatus, QpStep, RiccatiQp};
use serde::{Deserialize, Serialize};
use std::fmt;

/// Up to this many free inputs, Nu times m, condensing is the faster path: `cargo bench -p pinc-mpc --bench horizon`
/// measures it.
const MOST_CONDENSED: usize = 40;

/// What solves the quadratic programs of a controller.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum QpMethod {
    /// `Condensed` for up to 40 free inputs, `Riccati` above; where that fails, `Clarabel`.
    #[default]
    Auto,
    /// The states are eliminated; a dense dual active-set method solves what is left. The fastest for
    /// short horizons; its cost grows with the square of the horizon and more.
    Condensed,
    /// Stage by stage, an active-set and an interior-point method on a Riccati recursion: the cost is linear in the
    /// horizon.
    Riccati,
    /// Clarabel's sparse interior-point method, for all that is convex.
    Clarabel,
}

impl QpMethod {
    /// What `Auto` stands for, with `inputs` free inputs (Nu times m).
    #[must_use]
    pub fn resolve(self, inputs: usize) -> Self {
        match self {
            Self::Auto if inputs <= MOST_CONDENSED => Self::Condensed,
            Self::Auto => Self::Riccati,
            forced => forced,
        }
    }
}

/// The serialised name, as `condensed`.
impl fmt::Display for QpMethod {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Auto => "auto",
            Self::Condensed => "condensed",
            Self::Riccati => "riccati",
            Self::Clarabel => "clarabel",
        })
    }
}

/// The method chosen, and what helps where it fails.
#[derive(Debug)]
pub struct ChosenQp {
    method: Box<dyn QpSolver>,
    fallback: Option<ClarabelQp>,
}

impl ChosenQp {
    /// A solver for QPs of the sizes of `qp`, with finite limits and penalties where it has them.
    #[must_use]
    pub fn new(qp: &Qp, method: QpMethod) -> Self {
        let chosen: Box<dyn QpSolver> = match method.resolve(qp.dims.all_inputs()) {
            QpMethod::Condensed => Box::new(CondensedQp::new(qp)),
            QpMethod::Riccati => Box::new(RiccatiQp::new(qp)),
            QpMethod::Clarabel | QpMethod::Auto => Box::new(ClarabelQp::new(qp)),
        };
        let fallback = (method == QpMethod::Auto).then(|| ClarabelQp::new(qp));
        Self { method: chosen, fallback }
    }
}

/// The status, which is [`QpStatus::Failed`] where the solution is not finite.
fn checked(status: QpStatus, step: &QpStep) -> QpStatus {
    if status == QpStatus::Solved && !step.is_finite() { QpStatus::Failed } else { status }
}

impl QpSolver for ChosenQp {
    fn solve(&mut self, qp: &Qp, step: &mut QpStep) -> QpStatus {
        let status = checked(self.method.solve(qp, step), step);
        match &mut self.fallback {
            Some(fallback) if status == QpStatus::Failed => {
                tracing::debug!("a quadratic program is left to Clarabel");
                checked(fallback.solve(qp, step), step)
            }
            _ => status,
        }
    }
}
