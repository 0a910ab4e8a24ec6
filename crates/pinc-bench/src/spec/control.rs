//! The `[control]` section.

use super::PlantSpec;
use pinc_mpc::{Profile, SqpConfig};
use serde::{Deserialize, Serialize};
use std::fmt;

/// A closed loop: the plant, integrated accurately, under the controller.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlSpec {
    /// The models that the controller is run with, one after the other.
    pub models: Vec<ModelKind>,
    /// The plant in the loop, where it is another than the one that the models are of.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plant: Option<PlantSpec>,
    /// Length of the run in s: a whole number of T.
    pub duration_s: f64,
    /// The state it starts from, in the plant's order.
    pub initial_state: Vec<f64>,
    /// Names of the states that are to follow the references.
    pub controlled: Vec<String>,
    /// N1, the first predicted step that counts.
    pub n1: usize,
    /// N2, the prediction horizon in steps.
    pub n2: usize,
    /// Nu, the number of free inputs.
    pub nu: usize,
    /// The diagonal of Q, one weight per controlled state.
    pub q: Vec<f64>,
    /// The diagonal of R, one weight per input.
    pub r: Vec<f64>,
    /// How the weights go along the horizon.
    pub weights_profile: Profile,
    /// Lower bounds of the predicted states, in the plant's order; none if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub state_low: Option<Vec<f64>>,
    /// Upper bounds of the predicted states; none if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub state_high: Option<Vec<f64>>,
    /// Lower bounds of the inputs.
    pub input_low: Vec<f64>,
    /// Upper bounds of the inputs.
    pub input_high: Vec<f64>,
    /// Substeps per T of the model `rk4`.
    pub rk4_substeps: usize,
    /// How many times each closed loop is run, for the statistics of its time.
    pub repetitions: usize,
    /// Local error tolerance of the plant's integration.
    pub plant_tolerance: f64,
    /// Length T of a control step in s: needed only where no `[model]` says it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step_s: Option<f64>,
    /// What the controlled states are to follow, in steps.
    pub references: Vec<ReferenceStep>,
    /// Parts of the run, each from one time to another in s, that the report shows enlarged; its
    /// beginning if there are none and the run is long.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub close_ups_s: Vec<[f64; 2]>,
    /// The optimiser.
    pub sqp: SqpConfig,
}

/// One value of the reference.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReferenceStep {
    /// When it begins, in s; the first at 0.
    pub start_s: f64,
    /// One number per controlled state.
    pub value: Vec<f64>,
}

/// The model inside the controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ModelKind {
    /// The trained net.
    Pinc,
    /// The Runge-Kutta method of order 4.
    Rk4,
}

impl ModelKind {
    /// The name in configs and results.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Pinc => "pinc",
            Self::Rk4 => "rk4",
        }
    }
}

impl fmt::Display for ModelKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
