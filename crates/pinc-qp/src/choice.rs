//! Which method solves the QPs.

#[cfg(feature = "clarabel")]
use super::ClarabelQp;
use super::{CondensedQp, Qp, QpSolver, QpStatus, QpStep, RiccatiQp};
use serde::{Deserialize, Serialize};
use std::fmt;
use thiserror::Error;

/// Up to this many free inputs, Nu times m, condensing is the faster path: `cargo bench -p pinc-mpc
/// --bench horizon` measures it.
const MOST_CONDENSED: usize = 40;

/// What solves the quadratic programs of a controller.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum QpMethod {
    /// `Condensed` for up to 40 free inputs and for programs that couple all inputs, `Riccati` for
    /// others; where that fails, `Clarabel`, if this crate is built with it.
    #[default]
    Auto,
    /// The states are eliminated; a dense dual active-set method solves what is left. The fastest
    /// for short horizons; its cost grows with the square of the horizon and more.
    Condensed,
    /// Stage by stage, an active-set and an interior-point method on a Riccati recursion: the cost
    /// is linear in the horizon. Not for programs that couple all inputs.
    Riccati,
    /// Clarabel's sparse interior-point method, for all that is convex. It needs the feature
    /// `clarabel`.
    Clarabel,
}

/// A method that cannot solve the programs asked of it.
#[derive(Clone, Copy, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum QpError {
    /// A weight on the whole sequence of inputs, which couples stages that are not neighbours.
    #[error(
        "the QP method riccati works stage by stage and cannot weight the whole input sequence"
    )]
    NotStagewise,
    /// This build has no Clarabel.
    #[error("the QP method clarabel needs a build with the feature `clarabel`")]
    NoClarabel,
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
    fallback: Option<Box<dyn QpSolver>>,
}

impl ChosenQp {
    /// A solver for QPs of the sizes of `qp`, with finite limits and penalties where it has them.
    ///
    /// # Errors
    ///
    /// [`QpError`] if the method cannot solve such programs, or is not part of this build.
    pub fn new(qp: &Qp, method: QpMethod) -> Result<Self, QpError> {
        let stagewise = qp.w.is_empty();
        let chosen: Box<dyn QpSolver> = match method.resolve(qp.dims.all_inputs()) {
            QpMethod::Riccati if stagewise => Box::new(RiccatiQp::new(qp)),
            QpMethod::Riccati if method == QpMethod::Riccati => return Err(QpError::NotStagewise),
            QpMethod::Clarabel => general(qp).ok_or(QpError::NoClarabel)?,
            QpMethod::Condensed | QpMethod::Riccati | QpMethod::Auto => {
                Box::new(CondensedQp::new(qp))
            }
        };
        let fallback = if method == QpMethod::Auto { general(qp) } else { None };
        Ok(Self { method: chosen, fallback })
    }
}

/// Clarabel, if it is part of this build.
#[cfg(feature = "clarabel")]
fn general(qp: &Qp) -> Option<Box<dyn QpSolver>> {
    Some(Box::new(ClarabelQp::new(qp)))
}

/// Clarabel, if it is part of this build.
#[cfg(not(feature = "clarabel"))]
fn general(_qp: &Qp) -> Option<Box<dyn QpSolver>> {
    None
}

/// The status, which is [`QpStatus::Failed`] where the solution is not finite.
fn checked(status: QpStatus, step: &QpStep) -> QpStatus {
    if status == QpStatus::Solved && !step.is_finite() { QpStatus::Failed } else { status }
}

impl QpSolver for ChosenQp {
    fn solve(&mut self, qp: &Qp, step: &mut QpStep, expired: &mut dyn FnMut() -> bool) -> QpStatus {
        let status = checked(self.method.solve(qp, step, expired), step);
        match &mut self.fallback {
            Some(fallback) if status == QpStatus::Failed => {
                tracing::debug!("a quadratic program is left to Clarabel");
                checked(fallback.solve(qp, step, expired), step)
            }
            _ => status,
        }
    }
}
