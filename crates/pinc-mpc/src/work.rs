//! The counted work of a control step.

use pinc_qp::QpWork;

/// The work of a control step, the same on every machine.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct StepWork {
    /// At how many stages the model was linearized.
    pub linearized: usize,
    /// How many matrices were factored for the QPs: matrices of condensed programs, or recursions
    /// over all stages.
    pub factorizations: usize,
    /// How many rows joined or left the sets of active constraints.
    pub changes: usize,
}

impl StepWork {
    pub(crate) fn new(linearized: usize, QpWork { factorizations, changes }: QpWork) -> Self {
        Self { linearized, factorizations, changes }
    }
}
