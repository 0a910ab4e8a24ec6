//! Models that are tried in a loop.

use pinc_config::ModelKind;
use pinc_net::TrainingTarget;
use std::fmt::{self, Write};

/// A model to try.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Candidate {
    /// An integrator with so many substeps per control step.
    Integrator {
        /// Which.
        kind: ModelKind,
        /// How many.
        substeps: usize,
    },
    /// A net of this size, trained on this.
    Net {
        /// The size.
        shape: Shape,
        /// What it is trained on.
        source: TrainingTarget,
    },
}

/// Hidden layers and neurons in each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// Hidden layers.
    pub layers: usize,
    /// Neurons in each.
    pub neurons: usize,
}

/// The sizes of nets that are tried, from cheap to exact.
pub const SHAPES: [Shape; 5] = [
    Shape { layers: 2, neurons: 8 },
    Shape { layers: 2, neurons: 16 },
    Shape { layers: 2, neurons: 24 },
    Shape { layers: 3, neurons: 24 },
    Shape { layers: 4, neurons: 32 },
];

impl Candidate {
    /// The model of the loop.
    pub(crate) fn kind(self) -> ModelKind {
        match self {
            Self::Integrator { kind, .. } => kind,
            Self::Net { .. } => ModelKind::Pinc,
        }
    }

    /// The key of an integrator's substeps.
    fn substeps_key(kind: ModelKind) -> &'static str {
        match kind {
            ModelKind::Rk5 => "rk5_substeps",
            ModelKind::Rodas4 => "rosenbrock_substeps",
            _ => "rk4_substeps",
        }
    }

    /// A case of a sweep, as TOML: this candidate in loops that are run so many times.
    #[must_use]
    pub fn case(self, repetitions: usize) -> String {
        let mut set = format!("\"control.models\" = [\"{}\"]", self.kind());
        let _ = write!(set, ", \"control.repetitions\" = {repetitions}");
        // Writing to a String does not fail.
        let _ = match self {
            Self::Integrator { kind, substeps } => {
                write!(set, ", \"control.{}\" = {substeps}", Self::substeps_key(kind))
            }
            Self::Net { shape: Shape { layers, neurons }, source } => write!(
                set,
                ", \"model.hidden_layers\" = {layers}, \"model.neurons\" = {neurons}, \
                 \"training.source\" = \"{source}\""
            ),
        };
        format!("[[sweep.cases]]\nname = \"{self}\"\nset = {{ {set} }}\n")
    }
}

impl fmt::Display for Shape {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.layers, self.neurons)
    }
}

impl fmt::Display for Candidate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Integrator { kind, substeps } => write!(f, "{} x{substeps}", kind.title()),
            Self::Net { shape, source: TrainingTarget::Integrator } => {
                write!(f, "distilled {shape}")
            }
            Self::Net { shape, .. } => write!(f, "PINC {shape}"),
        }
    }
}
