//! Steps whose plan is searched for beyond the optimization.

use super::Nmpc;
use crate::cost::Targets;
use crate::search::{Expired, Programs};
use crate::sqp::{Outcome, StepInput};
use crate::{Planner, SqpStatus};
use std::mem::{replace, take};

impl Nmpc {
    /// Whether its plans are not those of the optimization alone.
    #[must_use]
    pub fn is_searched(&self) -> bool {
        self.search.is_some() || self.planner.is_some()
    }

    /// Searches beyond the plan found, unless there is none.
    pub(super) fn look_further(
        &mut self,
        reference: &[f64],
        found: Outcome,
        expired: &mut dyn FnMut() -> bool,
    ) -> Outcome {
        let good = matches!(
            found.status,
            SqpStatus::Converged | SqpStatus::Stalled | SqpStatus::IterationLimit
        );
        let Some(search) = self.search.as_mut().filter(|_| good) else { return found };
        let reference = self.at_nodes.as_mut().map_or(reference, |nodes| nodes.spread(reference));
        let targets = Targets { reference, previous: &self.previous };
        self.sqp.keep_weight();
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

    /// Lets `planner` make the plans, or the optimization again. Returns the planner before.
    pub fn set_planner(&mut self, planner: Option<Box<dyn Planner>>) -> Option<Box<dyn Planner>> {
        replace(&mut self.planner, planner)
    }

    /// The planner's plan with the states that follow from it, if there is a planner.
    pub(super) fn plan_otherwise(&mut self, reference: &[f64]) -> Option<Outcome> {
        let mut planner = self.planner.take()?;
        let [x, before, mut z] = [&mut self.start, &mut self.previous, &mut self.plan.z].map(take);
        let inputs = &mut z[self.dims.all_states()..];
        let (status, cost) = planner.plan(&mut self.program(), [&x, reference, &before], inputs);
        (self.start, self.previous, self.plan.z) = (x, before, z);
        self.planner = Some(planner);
        self.roll_out();
        Some(Outcome::of_plan(status, cost))
    }

    /// Moves the input to apply to one that may be applied.
    pub(super) fn admit(&mut self) {
        let Some(search) = &self.search else { return };
        let first = self.plan.z[self.dims.input(0)].iter_mut().zip(&self.previous);
        for (input, (u, before)) in first.enumerate() {
            *u = search.admit(input, *u, self.sqp.transcription.reach(input, *before));
        }
    }
}
