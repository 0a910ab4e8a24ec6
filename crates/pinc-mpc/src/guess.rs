//! What a controller remembers of its plan.

/// What the plan is worth as the first guess of the next step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Guess {
    /// Nothing: the first guess stays at the state measured.
    Cold,
    /// The inputs are known, and the states stay at that of the first step.
    Held,
    /// All inputs are known, and the states are those to which they lead from the first step's.
    Given,
    /// Its states are worth starting from. `fallback`: it was also good enough to be followed
    /// without need.
    Warm { fallback: bool },
    /// It is a guess only, since the time was up before it was worth following, for so many steps
    /// in a row; the last plan that was is the fallback.
    Tentative { waited: usize },
}

/// How far the next step is prepared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Phase {
    /// The plan is that of the last step.
    Solved,
    /// The plan is shifted by a step.
    Shifted,
    /// The problem is linearized along it.
    Linearized,
}
