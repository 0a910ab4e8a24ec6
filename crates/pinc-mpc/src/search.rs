//! A search beyond the optimization, for plans with whole numbers for instance, and plans without one.

use crate::horizon::Horizon;
use crate::sqp::{Outcome, Sqp, StepInput};
use crate::{Program, Solution, SqpStatus};
use std::fmt::{self, Debug};

/// Looks for the plan of a step among programs with other bounds on the inputs.
pub trait PlanSearch: Debug + Send {
    /// Begins at the optimal plan of the problem, leaves the plan to follow in `programs` and their
    /// bounds as they were, and returns how the search ended. It allocates nothing.
    fn search(&mut self, programs: &mut Programs<'_>) -> SqpStatus;

    /// What `u`, one of the `m` inputs, is to be that it may be applied, however the step ended: by its
    /// bounds, those of its increment and the input before, at least and at most these.
    fn admit(&self, input: usize, u: f64, reach: [f64; 2]) -> f64;
}

/// Makes the plans of steps in place of the optimization.
pub trait Planner: Debug + Send {
    /// Moves `inputs`, `[Nu, m]`, from the plan before, shifted, to the plan to follow, and returns its
    /// status and its cost. With [`SqpStatus::InfeasibleQp`] the optimization goes on from that plan.
    /// It allocates nothing.
    ///
    /// # Shapes
    ///
    /// `at`: the state, `n`; the reference, `[N2, outputs]`; the input applied last, `m`.
    fn plan(
        &mut self,
        program: &mut Program<'_>,
        at: [&[f64]; 3],
        inputs: &mut [f64],
    ) -> (SqpStatus, f64);
}

/// The programs of a step: the problem with other bounds on the inputs, solved one after another,
/// each from the plan of the one before.
#[derive(Debug)]
pub struct Programs<'a> {
    pub(crate) sqp: &'a mut Sqp,
    pub(crate) horizon: &'a mut Horizon,
    pub(crate) input: StepInput<'a>,
    pub(crate) plan: &'a mut Solution,
    pub(crate) outcome: Outcome,
    pub(crate) expired: Expired<'a>,
}

/// Says whether the time is up.
pub(crate) struct Expired<'a>(pub(crate) &'a mut dyn FnMut() -> bool);

impl Debug for Expired<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Expired").finish_non_exhaustive()
    }
}

impl Programs<'_> {
    /// The plan of the last program.
    #[must_use]
    pub fn plan(&self) -> &Solution {
        self.plan
    }

    /// The cost of this plan.
    #[must_use]
    pub fn cost(&self) -> f64 {
        self.outcome.cost
    }

    /// The least and the most that an input of the first stage may be, by its bounds and those of its
    /// increment.
    #[must_use]
    pub fn reach(&self, input: usize) -> [f64; 2] {
        self.sqp.transcription.reach(input, self.input.targets.previous[input])
    }

    /// The bounds of all inputs, `[Nu, m]` each, the lower ones first.
    pub fn bounds_mut(&mut self) -> [&mut [f64]; 2] {
        let first = self.sqp.dims().all_states();
        let bounds = &mut self.sqp.transcription.bounds;
        [&mut bounds.low[first..], &mut bounds.high[first..]]
    }

    /// Solves the program with these bounds, from the plan of the last one.
    pub fn solve(&mut self) -> SqpStatus {
        let Self { sqp, horizon, input, plan, outcome, expired } = self;
        sqp.project(plan, input.targets.previous);
        let before = outcome.iterations;
        *outcome = sqp.solve(horizon, *input, plan, expired.0);
        outcome.iterations += before;
        outcome.status
    }
}
