//! The `[control]` section.

use crate::estimator::{EstimatorSpec, MeasurementSpec};
use crate::{LoadSpec, ModelKind, ParameterStep, PlantSpec, Variables};
use pinc_mpc::{Bounds, NmpcProblem, Softness, SqpConfig, Tracked, Weight, Weights};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A closed loop: the plant, integrated accurately, under the controller.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlSpec {
    /// The models that the controller is run with, one after the other.
    pub models: Vec<ModelKind>,
    /// The plant in the loop, where it is another than the one that the models are of.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plant: Option<PlantSpec>,
    /// What of that plant is measured; its states, exactly, if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measurement: Option<MeasurementSpec>,
    /// What makes a state of the measurements.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub estimator: Option<EstimatorSpec>,
    /// Length of the run in s: a whole number of T.
    pub duration_s: f64,
    /// The state it starts from, in the plant's order.
    pub initial_state: Vec<f64>,
    /// The values that the models have for the parameters in `[domain.parameters]`; those of
    /// `[plant]` for the others.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub parameters: BTreeMap<String, f64>,
    /// Those of them that are measured: the models are told what the plant in the loop has.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub measured_parameters: Vec<String>,
    /// Other values of these in parts of the run: what the controller is told.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parameter_schedule: Vec<ParameterStep>,
    /// Other values of parameters of the plant in the loop in parts of the run: what is true.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub plant_schedule: Vec<ParameterStep>,
    /// Loads on the plant in the loop: what no model knows of.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub loads: Vec<LoadSpec>,
    /// What was applied before the first step, one number per input; 0 if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub initial_input: Option<Vec<f64>>,
    /// Names of the states and outputs that are to follow the references.
    pub controlled: Vec<String>,
    /// N1, the first predicted step that counts.
    pub n1: usize,
    /// N2, the prediction horizon in steps.
    pub n2: usize,
    /// Nu, the number of free inputs.
    pub nu: usize,
    /// The lengths of the N2 stages of the horizon in s, of which the first, the shortest, is the
    /// control step; each a control step long if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stages_s: Option<Vec<f64>>,
    /// Q, for the controlled quantities: its diagonal, or all of its rows.
    pub q: Weight,
    /// R, for the inputs' changes: its diagonal, or all of its rows.
    pub r: Weight,
    /// The weight of the last predicted state, in place of Q; the same as elsewhere if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub q_terminal: Option<Weight>,
    /// How the weights go along the horizon.
    pub weights_profile: Profile,
    /// Weighted differences between inputs of the horizon, beside the changes that R weights.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub input_differences: Vec<InputDifference>,
    /// Lower bounds of the predicted states, in the plant's order; none if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub state_low: Option<Vec<f64>>,
    /// Upper bounds of the predicted states; none if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub state_high: Option<Vec<f64>>,
    /// What is done where the states' bounds cannot be met.
    #[serde(default)]
    pub state_softness: Softness,
    /// Lower bounds of the predicted outputs, those that are no states, in the plant's order; none
    /// if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub output_low: Option<Vec<f64>>,
    /// Upper bounds of the same; none if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub output_high: Option<Vec<f64>>,
    /// What is done where the outputs' bounds cannot be met.
    #[serde(default)]
    pub output_softness: Softness,
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
    /// Whether the controller knows the references in advance; if not, it takes the present one for
    /// all later ones.
    #[serde(default = "yes")]
    pub preview: bool,
    /// The time that the controller may take per step, in us; no limit if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub budget_us: Option<f64>,
    /// What to do when a net is used outside the box that it was trained on.
    #[serde(default)]
    pub outside_domain: OutsidePolicy,
    /// The share of control steps that may fail, from 0 to 1: with more, the run has failed.
    #[serde(default = "max_failed_share")]
    pub max_failed_share: f64,
    /// How near its reference a controlled quantity stays to have settled there, in its unit; a
    /// hundredth of its largest error at the step marks if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub settled_within: Option<Vec<f64>>,
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
    /// What the controlled quantities are to follow, in steps.
    pub references: Vec<ReferenceStep>,
    /// Parts of the run, each from one time to another in s, that the report shows enlarged; its
    /// beginning if there are none and the run is long.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub close_ups_s: Vec<[f64; 2]>,
    /// The optimizer.
    pub sqp: SqpConfig,
}

impl ControlSpec {
    /// The problem for a plant with these variables.
    #[must_use]
    pub fn problem(&self, variables: &Variables, sample_time_s: f64) -> NmpcProblem {
        let (states, inputs) = (variables.states.len(), variables.inputs.len());
        let own = variables.own_outputs();
        let tracked = |name: &String| {
            let output = || own.iter().find(|(_, v)| v.name == *name);
            match variables.states.iter().position(|v| v.name == *name) {
                Some(state) => Some(Tracked::State(state)),
                None => output().map(|(place, _)| Tracked::Output(*place)),
            }
        };
        let factors = self.weights_profile.factors(self.n2, sample_time_s);
        let free = self.nu.min(self.n2);
        let weights = match factors {
            None => {
                let uniform = || Weights::uniform(self.q.clone(), self.r.clone());
                self.weights_by_length().unwrap_or_else(uniform)
            }
            Some(w) => Weights::scaled(self.q.clone(), self.r.clone(), &w, &w[..free]),
        };
        let weights = Weights {
            terminal: self.q_terminal.clone(),
            input_sequence: self.input_sequence(inputs),
            ..weights
        };
        NmpcProblem {
            n1: self.n1,
            control_horizon: self.nu,
            tracked: self.controlled.iter().filter_map(tracked).collect(),
            state_bounds: bounds(&self.state_low, &self.state_high, states),
            state_softness: self.state_softness.clone(),
            input_bounds: Bounds { low: self.input_low.clone(), high: self.input_high.clone() },
            increment_bounds: bounds(&self.increment_low, &self.increment_high, inputs),
            output_bounds: self.output_bounds(variables),
            output_softness: self.output_softness(variables),
            delay: self.delay_steps,
            ..NmpcProblem::new(variables.dims(), self.n2, weights)
        }
    }
}

impl ControlSpec {
    /// The width of each state's range between its bounds, 0 without both of them; empty without
    /// any bounds.
    #[must_use]
    pub fn state_ranges(&self) -> Vec<f64> {
        let (Some(low), Some(high)) = (&self.state_low, &self.state_high) else {
            return Vec::new();
        };
        let widths = low.iter().zip(high).map(|(low, high)| high - low);
        widths.map(|width| if width.is_finite() { width } else { 0.0 }).collect()
    }

    /// The bounds of all outputs, those that are states among them, which have none here.
    fn output_bounds(&self, variables: &Variables) -> Option<Bounds> {
        if self.output_low.is_none() && self.output_high.is_none() {
            return None;
        }
        let mut all = Bounds::none(variables.outputs.len());
        for (i, (place, _)) in variables.own_outputs().into_iter().enumerate() {
            let side = |side: &Option<Vec<f64>>| side.as_ref().and_then(|s| s.get(i).copied());
            all.low[place] = side(&self.output_low).unwrap_or(all.low[place]);
            all.high[place] = side(&self.output_high).unwrap_or(all.high[place]);
        }
        Some(all)
    }

    /// How hard these are. The penalty of an output without bounds is never asked for.
    fn output_softness(&self, variables: &Variables) -> Softness {
        let Softness::Penalty(own) = &self.output_softness else {
            return self.output_softness.clone();
        };
        let mut all = vec![1.0; variables.outputs.len()];
        for ((place, _), weight) in variables.own_outputs().into_iter().zip(own) {
            all[place] = *weight;
        }
        Softness::Penalty(all)
    }

    /// The weight of all inputs of the horizon that `input_differences` make, the input applied
    /// last in front: that of two inputs i and j is `(u_i - u_j)' W (u_i - u_j)`.
    fn input_sequence(&self, inputs: usize) -> Option<Weight> {
        if self.input_differences.is_empty() {
            return None;
        }
        let size = (self.nu + 1) * inputs;
        let mut rows = vec![vec![0.0; size]; size];
        for InputDifference { between, weight } in &self.input_differences {
            let [i, j] = between.map(|place| usize::try_from(place + 1).unwrap_or(usize::MAX));
            if i.max(j) > self.nu {
                // Not in a config that was checked.
                continue;
            }
            for row in 0..inputs {
                for column in 0..inputs {
                    let entry = match weight {
                        Weight::Diagonal(diagonal) if row == column => diagonal[row],
                        Weight::Diagonal(_) => 0.0,
                        Weight::Full(rows) => rows[row][column],
                    };
                    for (a, b, sign) in [(i, i, 1.0), (j, j, 1.0), (i, j, -1.0), (j, i, -1.0)] {
                        rows[a * inputs + row][b * inputs + column] += sign * entry;
                    }
                }
            }
        }
        Some(Weight::Full(rows))
    }
}

fn yes() -> bool {
    true
}

/// One step in twenty.
fn max_failed_share() -> f64 {
    0.05
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

/// A difference between two inputs of the horizon, and its weight in the cost.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InputDifference {
    /// Which inputs: i stands for u\[k+i\], from -1, the input applied last, to Nu - 1.
    pub between: [i64; 2],
    /// W: its diagonal, or all of its rows, one per input of the plant.
    pub weight: Weight,
}

/// One value of the reference.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReferenceStep {
    /// When it begins, in s; the first at 0.
    pub start_s: f64,
    /// One number per controlled quantity.
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
