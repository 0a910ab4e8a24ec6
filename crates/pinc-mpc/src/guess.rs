//! A controller's memory of its plan.

use crate::sqp::PlanState;
use pinc_ode::Memory;

/// What the plan is worth as the first guess of the next step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Guess {
    /// Nothing: the first guess stays at the state measured.
    Cold,
    /// The inputs are known, and all states equal the first.
    Held,
    /// All inputs are known, and the states are those to which they lead from the first step's.
    Given,
    /// Its states are worth starting from. `fallback`: it was also good enough to be followed without need.
    Warm { fallback: bool },
    /// It is a guess only, since the time was up before it was worth following, for so many steps
    /// in a row; the last plan that was is the fallback.
    Tentative { waited: usize },
}

impl Guess {
    /// Saves or restores it.
    pub(crate) fn remember(&mut self, memory: &mut Memory<'_>) {
        let (mut kind, mut detail) = match *self {
            Self::Cold => (0, 0),
            Self::Held => (1, 0),
            Self::Warm { fallback } => (2, usize::from(fallback)),
            Self::Tentative { waited } => (3, waited),
            Self::Given => (4, 0),
        };
        memory.count(&mut kind, 4);
        memory.count(&mut detail, usize::MAX);
        *self = match kind {
            0 => Self::Cold,
            1 => Self::Held,
            2 => Self::Warm { fallback: detail == 1 },
            3 => Self::Tentative { waited: detail },
            _ => Self::Given,
        };
    }
}

/// How far the next step is prepared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Phase {
    /// The plan of the last step.
    Solved,
    /// The plan is shifted by a step.
    Shifted,
    /// The problem is linearized along it.
    Linearized,
}

impl Phase {
    /// The phase without the linearization, which belongs to one optimizer.
    pub(crate) fn without_linearization(self) -> Self {
        match self {
            Self::Linearized => Self::Shifted,
            Self::Solved | Self::Shifted => self,
        }
    }

    const ALL: [Self; 3] = [Self::Solved, Self::Shifted, Self::Linearized];

    /// Saves or restores it.
    pub(crate) fn remember(&mut self, memory: &mut Memory<'_>) {
        memory.choice(self, &Self::ALL);
    }
}

impl PlanState {
    const ALL: [Self; 3] = [Self::Evaluated, Self::Stepped, Self::Partial];

    /// Saves or restores it.
    pub(crate) fn remember(&mut self, memory: &mut Memory<'_>) {
        memory.choice(self, &Self::ALL);
    }
}
