//! The measured quantities, and the places of disturbances.

use std::fmt;

/// A quantity that is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Measured {
    /// A state, by its index.
    State(usize),
    /// An output of the model, y = h(x, u, p), by its index.
    Output(usize),
}

impl Measured {
    /// These states.
    #[must_use]
    pub fn states(indices: impl IntoIterator<Item = usize>) -> Vec<Self> {
        indices.into_iter().map(Self::State).collect()
    }

    /// Its value where the model has this state and these outputs.
    #[must_use]
    pub fn read(self, x: &[f64], y: &[f64]) -> f64 {
        match self {
            Self::State(state) => x[state],
            Self::Output(output) => y[output],
        }
    }
}

impl fmt::Display for Measured {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::State(index) => write!(f, "state {index}"),
            Self::Output(index) => write!(f, "output {index}"),
        }
    }
}

/// Where constant disturbances d enter, which are estimated with the state as integrators, d+ = d +
/// w: the difference between plant and model that is left at rest. With one per measured quantity
/// the control is free of offset (Pannocchia and Rawlings, "Disturbance models for offset-free
/// model-predictive control", `AIChE` Journal 49 (2003)).
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Disturbance {
    /// There are none.
    #[default]
    None,
    /// One per input: x+ = F(x, u + d).
    Input,
    /// One per measured quantity: y = h(x, u) + d.
    Output,
    /// One on each of these states, in its unit per step: x+ = F(x, u) + d.
    States(Vec<usize>),
}

impl Disturbance {
    /// How many there are, of a model with `inputs` inputs of which `measured` quantities are
    /// measured.
    #[must_use]
    pub fn count(&self, inputs: usize, measured: usize) -> usize {
        match self {
            Self::None => 0,
            Self::Input => inputs,
            Self::Output => measured,
            Self::States(states) => states.len(),
        }
    }
}
