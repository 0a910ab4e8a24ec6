//! Steps whose plan is searched for beyond the optimization.

use super::Nmpc;
use crate::SqpStatus;
use crate::cost::Targets;
use crate::search::{Expired, Programs};
use crate::sqp::{Outcome, StepInput};

impl Nmpc {
    /// Whether its plans are searched for, as those with whole inputs.
    #[must_use]
    pub fn is_searched(&self) -> bool {
        self.search.is_some()
    }

    /// Searches beyond the plan found, unless there is none.
    pub(super) fn look_further(
        &mut self,
        reference: &[f64],
        found: Outcome,
        expired: &mut dyn FnMut() -> bool,
    ) -> Outcome {
        let good = matches!(found.status, SqpStatus::Converged | SqpStatus::Stalled);
        let Some(search) = self.search.as_mut().filter(|_| good) else { return found };
        let reference = self.at_nodes.as_mut().map_or(reference, |nodes| nodes.spread(reference));
        let targets = Targets { reference, previous: &self.previous };
        let mut programs = Programs {
            sqp: &mut self.sqp,
            horizon: &mut self.horizon,
            input: StepInput { x0: &self.start, targets },
            plan: &mut self.plan,
            outcome: found,
            expired: Expired(expired),
        };
        let status = search.search(&mut programs);
        Outcome { status, ..programs.outcome }
    }

    /// Moves the input to apply to one that may be applied.
    pub(super) fn admit(&mut self) {
        if let Some(search) = &self.search {
            search.admit(&mut self.plan.z[self.dims.input(0)]);
        }
    }
}
