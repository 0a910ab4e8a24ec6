//! The `[control]` section.

use crate::estimator::{EstimatorSpec, MeasurementSpec};
use crate::{
    BoundStep, CostSpec, LoadSpec, ModelKind, ParameterStep, PlantSpec, ScenarioSpec,
    UncertaintySpec, Variables, free_time,
};
use pinc_mpc::{Bounds, NmpcProblem, Softness, SqpConfig, Tracked, Weight, Weights};
use pinc_ode::Variable;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::PathBuf;

/// A bound of a state beyond this, and so many times the values in a loop, tells no size: it may stand for none.
const WIDE: f64 = 1e4;
const PARTS: f64 = 100.0;

/// A closed loop: the plant, integrated accurately, under the controller.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlSpec {
    /// The models in the controller. The loop runs once with each, in this order. With "policy" the
    /// net in `policy` takes the optimization's place, checked by the first of the others.
    pub models: Vec<ModelKind>,
    /// File of a net in place of the optimization, `policy.json` of `pinc shrink`, for the model "policy" only.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub policy: Option<PathBuf>,
    /// The plant in the loop; if absent, the plant that the models describe.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub plant: Option<PlantSpec>,
    /// What the controller measures of the plant in the loop; if absent, all states without noise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measurement: Option<MeasurementSpec>,
    /// The estimator that makes a state of the measurements; if absent, measured states are taken as they are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub estimator: Option<EstimatorSpec>,
    /// Length of the run in s, a whole number of T.
    pub duration_s: f64,
    /// Initial state of the plant, in its order and units.
    pub initial_state: Vec<f64>,
    /// Values that the models have for the parameters in `[domain.parameters]`; a parameter that is
    /// not named here has its value in `[plant]`.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub parameters: BTreeMap<String, f64>,
    /// Names of the parameters that the controller measures: its models get the values of the plant in the loop.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub measured_parameters: Vec<String>,
    /// Uncertain parameters of the models. The controller then plans for a tree of scenarios, whose
    /// bounds hold in all of them; if absent, for one value of each parameter.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scenarios: Option<ScenarioSpec>,
    /// What is uncertain of model and state. The controller then keeps a distance to its bounds; if
    /// absent, it takes both for true.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uncertainty: Option<UncertaintySpec>,
    /// Other values of the models' parameters in parts of the run, as the controller knows them.
    /// Functions of t and columns of a file may take the place of the list.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parameter_schedule: Vec<ParameterStep>,
    /// Whether the controller knows the parameters of later steps in advance: the values of
    /// `parameter_schedule`, or of `plant_schedule` if they are measured.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub parameter_preview: bool,
    /// Other values of the plant's parameters in parts of the run: what is true. Functions of t and
    /// columns of a file may take the place of the list.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub plant_schedule: Vec<ParameterStep>,
    /// Loads on the plant in the loop, of which no model knows.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub loads: Vec<LoadSpec>,
    /// Seed of the sensors' noise; that of the experiment if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_seed: Option<u64>,
    /// Input applied before the first step, one number per input; 0 if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub initial_input: Option<Vec<f64>>,
    /// Inputs that the search for the first plan starts from; if absent, the input applied before, or 0, held.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub first_plan: Option<FirstPlanSpec>,
    /// Names of the states, outputs and inputs that follow the references. They may be left out
    /// where there is a `[control.cost]`, with `q` and `references`.
    #[serde(default)]
    pub controlled: Vec<String>,
    /// N1, the first predicted step whose error counts, from 1.
    pub n1: usize,
    /// N2, the prediction horizon in steps.
    pub n2: usize,
    /// Nu, the control horizon: the number of inputs that are chosen; the last one holds until N2.
    pub nu: usize,
    /// Lengths of the N2 stages of the horizon in s. The first, the shortest, is the control step.
    /// If absent, each stage is one control step long.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stages_s: Option<Vec<f64>>,
    /// Name of the input that stretches the horizon's time: a factor on the length of all stages but
    /// the first, one for all of them, that the controller chooses. It is an input of the plant that
    /// no equation uses. If absent, stages have their given lengths.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub free_time: Option<String>,
    /// Values that states must have at the end of the horizon, by name; none if absent.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub end_state: BTreeMap<String, f64>,
    /// Names of the states that end the horizon where it begins, so that the plan is an orbit in them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub periodic: Vec<String>,
    /// Names of the inputs that are whole numbers, as pumps that are on (1) or off (0).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub integer: Vec<String>,
    /// The most programs that a step solves to find the best whole numbers by branch and bound; beyond
    /// them the best inputs known are taken, sum-up rounding's at least, and the status is `rounded`.
    #[serde(default = "integer_programs", skip_serializing_if = "is_integer_programs")]
    pub integer_programs: usize,
    /// Whether references are replaced in each step by the nearest steady state that the models can
    /// hold within the bounds, under the disturbances and parameters that the estimator finds.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub target: bool,
    /// Q, the weight of the controlled quantities' squared errors.
    #[serde(default, skip_serializing_if = "is_no_weight")]
    pub q: Weight,
    /// R, the weight of the inputs' squared changes. It may be left out beside a `[control.cost]`.
    #[serde(default, skip_serializing_if = "is_no_weight")]
    pub r: Weight,
    /// A cost as text beside the quadratic one, or in its place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cost: Option<CostSpec>,
    /// Weight of the squared error at the end of the horizon, in place of Q. It is not multiplied
    /// by the length of the last stage. If absent, Q counts there too.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub q_terminal: Option<Weight>,
    /// How the weights vary along the horizon.
    pub weights_profile: Profile,
    /// Weighted differences between inputs of the horizon, beside the changes that R weights.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub input_differences: Vec<InputDifference>,
    /// Lower bounds of the predicted states, in the plant's order and units; no bounds if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub state_low: Option<Vec<f64>>,
    /// Upper bounds of the predicted states, in the plant's order and units; no bounds if absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub state_high: Option<Vec<f64>>,
    /// What the controller does where it cannot meet the bounds of states.
    #[serde(default)]
    pub state_softness: Softness,
    /// Lower bounds of predicted outputs that are no states, in the plant's order and units; none if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub output_low: Option<Vec<f64>>,
    /// Upper bounds of predicted outputs that are no states, in the plant's order and units; none if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub output_high: Option<Vec<f64>>,
    /// What the controller does where it cannot meet the bounds of outputs.
    #[serde(default)]
    pub output_softness: Softness,
    /// Lower bounds of the inputs, in the plant's order and units.
    pub input_low: Vec<f64>,
    /// Upper bounds of the inputs, in the plant's order and units.
    pub input_high: Vec<f64>,
    /// Lower bounds of the change of each input from one step to the next, 0 or less; no bounds if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub increment_low: Option<Vec<f64>>,
    /// Upper bounds of the change of each input from one step to the next, 0 or more; no bounds if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub increment_high: Option<Vec<f64>>,
    /// Other bounds in parts of the run, of quantities that have bounds. Functions of t and columns
    /// of a file may take the place of the list.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub bound_schedule: Vec<BoundStep>,
    /// Dead time of the inputs in whole control steps.
    #[serde(default)]
    pub delay_steps: usize,
    /// Whether the controller knows future references. If not, it plans as if the present one stayed.
    #[serde(default = "yes")]
    pub preview: bool,
    /// Time that the controller may take for a step, in µs; no limit if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub budget_us: Option<f64>,
    /// What happens when a net is used outside the box that it was trained on.
    #[serde(default)]
    pub outside_domain: OutsidePolicy,
    /// Largest error that a step of the net may have, by state, in the state's unit. Each control step compares
    /// the estimated error of its plan's first step with it; states that are not named are not judged.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub error_tolerance: BTreeMap<String, f64>,
    /// What happens when that error is larger.
    #[serde(default, skip_serializing_if = "crate::uncertainty::is_default")]
    pub on_error: OnError,
    /// Share of control steps that may fail, from 0 to 1. A run with more failures has failed.
    #[serde(default = "max_failed_share")]
    pub max_failed_share: f64,
    /// Band around a reference within which a controlled quantity has settled, one number per
    /// quantity in its unit; if absent, a hundredth of its largest error at the step marks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub settled_within: Option<Vec<f64>>,
    /// Substeps per T of the model `rk4`.
    pub rk4_substeps: usize,
    /// Substeps per T of the model `rk5`.
    pub rk5_substeps: usize,
    /// Substeps per T of the model `rosenbrock`.
    pub rosenbrock_substeps: usize,
    /// How often each closed loop is run, for the statistics of the controller's time.
    pub repetitions: usize,
    /// Local error tolerance of the integration of the plant.
    pub plant_tolerance: f64,
    /// Length T of a control step in s. It is needed where no `[model]` says it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step_s: Option<f64>,
    /// Reference of the controlled quantities, piecewise constant. Functions of t and columns of a
    /// file may take the place of the list.
    #[serde(default)]
    pub references: Vec<ReferenceStep>,
    /// Parts of the run, each `[from, to]` in s, that the report shows enlarged; if there are none,
    /// the first steps of a long run.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub close_ups_s: Vec<[f64; 2]>,
    /// Settings of the optimizer.
    pub sqp: SqpConfig,
}

impl ControlSpec {
    /// The model that a loop of this kind works with.
    #[must_use]
    pub fn model_of(&self, kind: ModelKind) -> ModelKind {
        let other = || self.models.iter().copied().find(|other| *other != ModelKind::Policy);
        match kind {
            ModelKind::Policy => other().unwrap_or(ModelKind::RK4),
            own => own,
        }
    }

    /// The problem for a plant with these variables.
    #[must_use]
    pub fn problem(&self, variables: &Variables, sample_time_s: f64) -> NmpcProblem {
        let inputs = variables.inputs.len();
        let own = variables.own_outputs();
        let tracked = |name: &String| {
            let output = || own.iter().find(|(_, v)| v.name == *name);
            let place = |of: &[Variable]| of.iter().position(|v| v.name == *name);
            match (place(&variables.states), output()) {
                (Some(state), _) => Some(Tracked::State(state)),
                (None, Some((place, _))) => Some(Tracked::Output(*place)),
                (None, None) => place(&variables.inputs).map(Tracked::Input),
            }
        };
        let factors = self.weights_profile.factors(self.n2, sample_time_s);
        let free = self.nu.min(self.n2);
        let r = self.input_weight(inputs);
        let weights = match factors {
            None => {
                let uniform = || Weights::uniform(self.q.clone(), r.clone());
                self.weights_by_length(&r).unwrap_or_else(uniform)
            }
            Some(w) => Weights::scaled(self.q.clone(), r, &w, &w[..free]),
        };
        let mut weights = Weights {
            terminal: self.q_terminal.clone(),
            input_sequence: self.input_sequence(inputs),
            ..weights
        };
        let mut increment_bounds = bounds(&self.increment_low, &self.increment_high, inputs);
        if let Some(stretch) = self.stretch(variables) {
            increment_bounds = free_time::held(increment_bounds, free, stretch);
            weights.r = free_time::stiff(&weights.r, free, stretch);
        }
        NmpcProblem {
            n1: self.n1,
            control_horizon: self.nu,
            tracked: self.controlled.iter().filter_map(tracked).collect(),
            state_bounds: self.state_bounds(variables),
            state_sizes: self.state_sizes(variables),
            state_softness: self.state_softness.clone(),
            input_bounds: Bounds { low: self.input_low.clone(), high: self.input_high.clone() },
            increment_bounds,
            output_bounds: self.output_bounds(variables),
            output_softness: self.output_softness(variables),
            delay: self.delay_steps,
            periodic: places(&self.periodic, &variables.states),
            end_states: (0..variables.states.len())
                .filter(|&i| self.end_state.contains_key(&*variables.states[i].name))
                .collect(),
            ..NmpcProblem::new(variables.dims(), self.n2, weights)
        }
    }

    /// Whether the models are told a parameter at given times.
    pub(crate) fn schedules(&self, name: &str) -> bool {
        self.parameter_schedule.iter().any(|step| step.values.contains_key(name))
    }

    /// Whether they are told its values in the loop at all.
    pub(crate) fn tells(&self, name: &str) -> bool {
        self.measured_parameters.iter().any(|of| of == name) || self.schedules(name)
    }

    /// The bounds of the states, with the values at the end of the horizon.
    fn state_bounds(&self, variables: &Variables) -> Bounds {
        let states = variables.states.len();
        let all = bounds(&self.state_low, &self.state_high, states);
        if self.end_state.is_empty() {
            return all;
        }
        let mut all = Bounds { low: all.low.repeat(self.n2), high: all.high.repeat(self.n2) };
        let last = (self.n2 - 1) * states;
        for (i, state) in variables.states.iter().enumerate() {
            if let Some(value) = self.end_state.get(state.name.as_ref()) {
                (all.low[last + i], all.high[last + i]) = (*value, *value);
            }
        }
        all
    }

    /// Whether a state's bound may stand for none where the loop begins at and follows values up to `shown`.
    #[must_use]
    pub fn is_far(bound: f64, shown: f64) -> bool {
        bound.abs() > WIDE.max(PARTS * shown)
    }

    /// The sizes of the states by their bounds, if some of these are far: then by start and references.
    fn state_sizes(&self, variables: &Variables) -> Option<Vec<f64>> {
        let bounded = self.state_bounds(variables).sizes(variables.states.len());
        let size = |(i, bounded): (usize, &f64)| {
            let place = self.controlled.iter().position(|of| *of == variables.states[i].name);
            let references = place.map(|k| self.references.iter().map(move |step| step.value[k]));
            let values = references.into_iter().flatten().chain(self.initial_state.get(i).copied());
            let shown = values.fold(0.0, |most: f64, value| most.max(value.abs()));
            if Self::is_far(*bounded, shown) { PARTS * shown } else { *bounded }
        };
        Some(bounded.iter().enumerate().map(size).collect()).filter(|sizes| *sizes != bounded)
    }

    /// The places of the inputs that are whole numbers.
    #[must_use]
    pub fn integer_places(&self, variables: &Variables) -> Vec<usize> {
        places(&self.integer, &variables.inputs)
    }

    /// R, which is 0 if it was left out.
    #[must_use]
    pub fn input_weight(&self, inputs: usize) -> Weight {
        if is_no_weight(&self.r) { Weight::Diagonal(vec![0.0; inputs]) } else { self.r.clone() }
    }

    /// The width of each state's range between its bounds, 0 without both of them; empty without any bounds.
    #[must_use]
    pub fn state_ranges(&self) -> Vec<f64> {
        let (Some(low), Some(high)) = (&self.state_low, &self.state_high) else {
            return Vec::new();
        };
        let widths = low.iter().zip(high).map(|(low, high)| high - low);
        widths.map(|width| if width.is_finite() { width } else { 0.0 }).collect()
    }

    /// The widths of the inputs' bounds; 1 where there is none.
    #[must_use]
    pub fn input_widths(&self) -> Vec<f64> {
        let widths = self.input_low.iter().zip(&self.input_high).map(|(low, high)| high - low);
        widths.map(|width| if width.is_finite() && width > 0.0 { width } else { 1.0 }).collect()
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
    /// last in front: two inputs i and j contribute `(u_i - u_j)' W (u_i - u_j)`.
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

/// Whether a weight was left out.
pub(crate) fn is_no_weight(weight: &Weight) -> bool {
    *weight == Weight::default()
}

fn yes() -> bool {
    true
}

fn integer_programs() -> usize {
    200
}

fn is_integer_programs(of: &usize) -> bool {
    *of == integer_programs()
}

/// One step in twenty.
fn max_failed_share() -> f64 {
    0.05
}

/// The places of names in a list, in ascending order.
fn places(names: &[String], of: &[Variable]) -> Vec<usize> {
    let named = |variable: &Variable| names.iter().any(|name| variable.name == *name);
    (0..of.len()).filter(|&place| named(&of[place])).collect()
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
    /// The cost behind the paper's Table 1: the tracking part and the du part of stage i both have the
    /// factor (N2 - i) T.
    ///
    /// Its authors' program adds up the stage costs
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
    /// The factors of the weights at each of `stages` stages of `sample_time_s` seconds, if they are not 1.
    #[must_use]
    pub fn factors(self, stages: usize, sample_time_s: f64) -> Option<Vec<f64>> {
        let factor = |i: usize| (stages - i) as f64 * sample_time_s;
        (self == Self::Cumulative).then(|| (0..stages).map(factor).collect())
    }
}

/// A difference between two inputs of the horizon, and its weight in the cost.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InputDifference {
    /// The two inputs: i stands for u\[k+i\], from -1, the input applied last, to Nu - 1.
    pub between: [i64; 2],
    /// W, the weight of the squared difference, one row per input of the plant.
    pub weight: Weight,
}

/// A value of the reference, and when it begins.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReferenceStep {
    /// Begin in s; the first value begins at 0.
    pub start_s: f64,
    /// Reference of each controlled quantity, in its unit.
    pub value: Vec<f64>,
}

/// The inputs of a first plan: `input` or `file`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FirstPlanSpec {
    /// One number per input, held over the horizon.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub input: Option<Vec<f64>>,
    /// A CSV file with the columns `t` and the inputs, whose rows hold until the next row, such as
    /// `control.csv` of an earlier run. Its first row is the beginning of the plan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<PathBuf>,
}

/// What to do when the estimated error of a net's step is larger than `error_tolerance`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OnError {
    /// Follow the plan, and count the step.
    #[default]
    Count,
    /// Make the step over with an integrator as the model: the first of `models`, or RK4.
    Integrator,
    /// Make the step over with the net's predictions less the estimated error.
    Correct,
}

/// How to react when a net is used outside the box that it was trained on, where it is wrong.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OutsidePolicy {
    /// The run continues; the report says how often and how far the net was outside.
    #[default]
    Report,
    /// The run ends there with an error.
    Refuse,
}
