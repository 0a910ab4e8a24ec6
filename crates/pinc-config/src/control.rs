//! The `[control]` section.

use crate::PlantSpec;
use pinc_mpc::{Bounds, NmpcProblem, Softness, SqpConfig, Tracked, Weight, Weights};
use pinc_ode::Dims;
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
    /// Q, for the controlled states: its diagonal, or all of its rows.
    pub q: Weight,
    /// R, for the inputs' changes: its diagonal, or all of its rows.
    pub r: Weight,
    /// The weight of the last predicted state, in place of Q; the same as elsewhere if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub q_terminal: Option<Weight>,
    /// How the weights go along the horizon.
    pub weights_profile: Profile,
    /// Lower bounds of the predicted states, in the plant's order; none if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub state_low: Option<Vec<f64>>,
    /// Upper bounds of the predicted states; none if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub state_high: Option<Vec<f64>>,
    /// What is done where the states' bounds cannot be met.
    #[serde(default)]
    pub state_softness: Softness,
    /// Lower bounds of the inputs.
    pub input_low: Vec<f64>,
    /// Upper bounds of the inputs.
    pub input_high: Vec<f64>,
    /// Lower bounds of the inputs' change from one step to the next, 0 or less; none if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub increment_low: Option<Vec<f64>>,
    /// Upper bounds of the same, 0 or more; none if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub increment_high: Option<Vec<f64>>,
    /// How many whole steps pass until an input acts on the plant.
    #[serde(default)]
    pub delay_steps: usize,
    /// The time that the controller may take per step, in us; no limit if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub budget_us: Option<f64>,
    /// What to do when a net is used outside the box that it was trained on.
    #[serde(default)]
    pub outside_domain: OutsidePolicy,
    /// Substeps per T of the model `rk4`.
    pub rk4_substeps: usize,
    /// Substeps per T of the model `rk5`.
    pub rk5_substeps: usize,
    /// Substeps per T of the model `rosenbrock`.
    pub rosenbrock_substeps: usize,
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
    /// The optimizer.
    pub sqp: SqpConfig,
}

impl ControlSpec {
    /// The problem for a plant whose states have these names.
    pub fn problem(&self, states: &[&str], inputs: usize, sample_time_s: f64) -> NmpcProblem {
        let dims = Dims::new(states.len(), inputs);
        let place = |name: &String| states.iter().position(|state| state == name);
        let factors = self.weights_profile.factors(self.n2, sample_time_s);
        let free = self.nu.min(self.n2);
        let weights = match factors {
            None => Weights::uniform(self.q.clone(), self.r.clone()),
            Some(w) => Weights::scaled(self.q.clone(), self.r.clone(), &w, &w[..free]),
        };
        let weights = Weights { terminal: self.q_terminal.clone(), ..weights };
        NmpcProblem {
            n1: self.n1,
            control_horizon: self.nu,
            tracked: Tracked::states(self.controlled.iter().filter_map(place)),
            state_bounds: bounds(&self.state_low, &self.state_high, states.len()),
            state_softness: self.state_softness.clone(),
            input_bounds: Bounds { low: self.input_low.clone(), high: self.input_high.clone() },
            increment_bounds: bounds(&self.increment_low, &self.increment_high, inputs),
            delay: self.delay_steps,
            ..NmpcProblem::new(dims, self.n2, weights)
        }
    }
}

fn bounds(low: &Option<Vec<f64>>, high: &Option<Vec<f64>>, variables: usize) -> Bounds {
    let none = Bounds::none(variables);
    Bounds { low: low.clone().unwrap_or(none.low), high: high.clone().unwrap_or(none.high) }
}

/// How the weights go along the horizon.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Profile {
    /// The cost as printed: the same weights at all stages.
    #[default]
    Uniform,
    /// The cost behind the paper's Table 1. Its authors' program adds up the stage costs
    ///
    /// ```text
    /// l_i = |y[k+i+1] - yref[k+i+1]|_Q^2 + |du[k+i]|_R^2        i = 0..N2-1
    /// ```
    ///
    /// in a variable that is never set back to 0 within the horizon, and adds that variable times T
    /// to the cost at every stage. Stage i is thus counted in its own stage and in every later one,
    /// its tracking part and its du part alike: both have the factor (N2 - i) T. (The four tanks
    /// tell the readings apart: dense IAE 544.41, but 530.9 if only the tracking part were counted
    /// so and du once, 532.2 if it were counted once times T.)
    Cumulative,
}

impl Profile {
    /// The factors of the weights at each of `stages` stages of `sample_time_s` seconds, if they
    /// are not 1.
    #[must_use]
    pub fn factors(self, stages: usize, sample_time_s: f64) -> Option<Vec<f64>> {
        #[expect(clippy::cast_precision_loss, reason = "no horizon has 2^53 stages")]
        let factor = |i: usize| (stages - i) as f64 * sample_time_s;
        (self == Self::Cumulative).then(|| (0..stages).map(factor).collect())
    }
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

/// What to do when a net is used outside the box that it was trained on, where it is wrong.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OutsidePolicy {
    /// Continue, and report how often and how far.
    #[default]
    Report,
    /// End the run there.
    Refuse,
}

/// The model inside the controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ModelKind {
    /// The trained net.
    Pinc,
    /// The Runge-Kutta method of order 4.
    Rk4,
    /// The Runge-Kutta method of order 5 of Dormand and Prince.
    Rk5,
    /// The Rosenbrock method, for stiff plants.
    #[serde(rename = "rosenbrock")]
    Rodas4,
}

impl ModelKind {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Pinc, Self::Rk4, Self::Rk5, Self::Rodas4];

    /// The name in configs and results.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Pinc => "pinc",
            Self::Rk4 => "rk4",
            Self::Rk5 => "rk5",
            Self::Rodas4 => "rosenbrock",
        }
    }

    /// The name in reports.
    pub fn title(self) -> &'static str {
        match self {
            Self::Pinc => "PINC",
            Self::Rk4 => "RK4",
            Self::Rk5 => "RK5",
            Self::Rodas4 => "Rosenbrock",
        }
    }
}

impl fmt::Display for ModelKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}
