//! Models that are tried in a loop.

use pinc_config::{ControlSpec, ModelKind};
use pinc_net::TrainingTarget;
use pinc_ode::Integrator;
use std::fmt::{self, Write};

/// A model to try.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Candidate {
    /// An integrator with so many substeps per control step.
    Integrator {
        /// Which.
        integrator: Integrator,
        /// How many.
        substeps: usize,
    },
    /// A plant without an equation itself.
    BlackBox,
    /// A net of this size, trained on this.
    Net {
        /// The size.
        shape: Shape,
        /// What it is trained on.
        source: TrainingTarget,
        /// Whether it is trained with twice the iterations of the config.
        longer: bool,
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

/// The sizes of nets that are tried for a plant with so many states, from cheap to exact. With many
/// states the first and the last layer are most of a net's work, and a second hidden one gains
/// little (docs/accuracy-cost.md).
pub(crate) fn shapes(states: usize) -> &'static [Shape; 5] {
    const FEW_STATES: [Shape; 5] = [net(2, 8), net(2, 16), net(2, 24), net(3, 24), net(4, 32)];
    const MANY_STATES: [Shape; 5] = [net(1, 16), net(1, 24), net(1, 32), net(1, 48), net(2, 48)];
    if states < MANY { &FEW_STATES } else { &MANY_STATES }
}

/// How many times the config's iterations a net gets that was nearly good.
pub(crate) const LONGER: u64 = 2;

/// So many states are many.
const MANY: usize = 10;

const fn net(layers: usize, neurons: usize) -> Shape {
    Shape { layers, neurons }
}

impl Candidate {
    /// What it is, in words.
    pub(crate) fn noun(self) -> &'static str {
        match self {
            Self::Integrator { .. } => "integrator",
            Self::BlackBox => "black box",
            Self::Net { .. } => "net",
        }
    }

    pub(crate) fn is_net(self) -> bool {
        matches!(self, Self::Net { .. })
    }

    /// The model of the loop.
    pub(crate) fn kind(self) -> ModelKind {
        match self {
            Self::Integrator { integrator, .. } => ModelKind::Integrator(integrator),
            Self::BlackBox => ModelKind::BlackBox,
            Self::Net { .. } => ModelKind::Pinc,
        }
    }

    /// A case of a sweep, as TOML: this candidate in loops that are run so many times. The phases
    /// of the config's training have so many `iterations`.
    #[must_use]
    pub fn case(self, repetitions: usize, iterations: &[u64]) -> String {
        let mut set = format!("\"control.models\" = [\"{}\"]", self.kind());
        let _ = write!(set, ", \"control.repetitions\" = {repetitions}");
        // Writing to a String does not fail.
        let _ = match self {
            Self::Integrator { integrator, substeps } => {
                let key = ControlSpec::substeps_key(integrator);
                write!(set, ", \"control.{key}\" = {substeps}")
            }
            Self::BlackBox => Ok(()),
            Self::Net { shape: Shape { layers, neurons }, source, longer } => {
                if longer {
                    for (phase, count) in iterations.iter().enumerate() {
                        let count = LONGER * count;
                        let _ = write!(set, ", \"training.phases.{phase}.iterations\" = {count}");
                    }
                }
                write!(
                    set,
                    ", \"model.hidden_layers\" = {layers}, \"model.neurons\" = {neurons}, \
                     \"training.source\" = \"{source}\""
                )
            }
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
            Self::Integrator { integrator, substeps } => {
                write!(f, "{} x{substeps}", integrator.title())
            }
            Self::BlackBox => f.write_str("black box"),
            Self::Net { shape, source, longer } => {
                let kind = if *source == TrainingTarget::Integrator { "distilled" } else { "PINC" };
                write!(f, "{kind} {shape}{}", if *longer { " longer" } else { "" })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The values that a trial with the candidate sets, as they are in the sweep's config.
    fn set(candidate: Candidate, iterations: &[u64]) -> String {
        let text = candidate.case(3, iterations);
        let of = format!("[[sweep.cases]]\nname = \"{candidate}\"\nset = {{ ");
        text.strip_prefix(&of).unwrap().strip_suffix(" }\n").unwrap().to_owned()
    }

    /// A trial has one model and its size; a net that is trained for longer has twice as many
    /// iterations in each phase.
    #[test]
    fn a_case_of_a_sweep_sets_all_that_a_candidate_says() {
        let rk5 = Candidate::Integrator { integrator: Integrator::Rk5, substeps: 6 };
        let models =
            |name: &str| format!("\"control.models\" = [\"{name}\"], \"control.repetitions\" = 3");
        assert_eq!(set(rk5, &[9]), models("rk5") + ", \"control.rk5_substeps\" = 6");
        assert_eq!(set(Candidate::BlackBox, &[9]), models("black-box"));
        let net = |source, longer| Candidate::Net { shape: shapes(2)[3], source, longer };
        let size = ", \"model.hidden_layers\" = 3, \"model.neurons\" = 24";
        let source = |name: &str| format!("{size}, \"training.source\" = \"{name}\"");
        let physics = models("pinc") + &source("physics");
        assert_eq!(set(net(TrainingTarget::Physics, false), &[100, 7]), physics);
        let phases =
            ", \"training.phases.0.iterations\" = 200, \"training.phases.1.iterations\" = 14";
        let distilled = models("pinc") + phases + &source("integrator");
        assert_eq!(set(net(TrainingTarget::Integrator, true), &[100, 7]), distilled);
        let names = [(TrainingTarget::Physics, false), (TrainingTarget::Integrator, true)];
        let names = names.map(|(source, longer)| net(source, longer).to_string());
        assert_eq!(names, ["PINC 3x24", "distilled 3x24 longer"]);
    }
}
