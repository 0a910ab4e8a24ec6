//! The tracked quantities.

use std::fmt;

/// A quantity that is to follow a reference.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Tracked {
    /// A state, by its index.
    State(usize),
    /// An output of the model, y = h(x, u, p), by its index.
    Output(usize),
    /// An input, by its index: the input of the interval that leads to a stage.
    Input(usize),
}

impl Tracked {
    /// These states.
    #[must_use]
    pub fn states(indices: impl IntoIterator<Item = usize>) -> Vec<Self> {
        indices.into_iter().map(Self::State).collect()
    }

    /// These outputs.
    #[must_use]
    pub fn outputs(indices: impl IntoIterator<Item = usize>) -> Vec<Self> {
        indices.into_iter().map(Self::Output).collect()
    }
}

impl fmt::Display for Tracked {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::State(index) => write!(f, "state {index}"),
            Self::Output(index) => write!(f, "output {index}"),
            Self::Input(index) => write!(f, "input {index}"),
        }
    }
}
