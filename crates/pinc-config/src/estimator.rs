//! `[control.measurement]` and `[control.estimator]`.

use crate::{ControlSpec, Variables};
use pinc_estimate::{Augmentation, Disturbance, Gate, Measured, Tuning};
use serde::{Deserialize, Serialize};

/// The quantities of the plant that are measured in the closed loop.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeasurementSpec {
    /// Names of the states and outputs that are measured; all states if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured: Option<Vec<String>>,
    /// Standard deviation of each measured quantity's noise, drawn from the experiment's seed; none if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub noise_sd: Option<Vec<f64>>,
}

/// The estimator of the state. A standard deviation has the unit of its quantity.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EstimatorSpec {
    /// Which estimator.
    pub kind: EstimatorKind,
    /// Standard deviation of the model's error in each step, one per state.
    pub process_sd: Vec<f64>,
    /// Standard deviation of the noise that the estimator expects, one per measured quantity.
    pub measurement_sd: Vec<f64>,
    /// Estimate of the state before the first measurement, in the plant's order and units.
    pub initial_estimate: Vec<f64>,
    /// Standard deviation of the initial estimate, one per state.
    pub initial_sd: Vec<f64>,
    /// Where disturbances enter that are estimated beside the state.
    #[serde(default)]
    pub disturbance: DisturbanceSpec,
    /// Standard deviation of the change of each disturbance in a step.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub disturbance_sd: Vec<f64>,
    /// Standard deviation of each disturbance before the first measurement.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub disturbance_initial_sd: Vec<f64>,
    /// Parameters of the plant that are estimated beside the state.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parameters: Vec<UnknownParameter>,
    /// Length of the window of `mhe` in steps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub window: Option<usize>,
    /// Alpha of `ukf`, whose points are alpha times the root of n standard deviations from the estimate of n
    /// quantities, at most 1; 0.001 if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub alpha: Option<f64>,
    /// Lower bound of each estimated state; no bounds if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub low: Option<Vec<f64>>,
    /// Upper bound of each estimated state; no bounds if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub high: Option<Vec<f64>>,
    /// Standard deviations of an innovation beyond which its measurement is rejected; 30 if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gate: Option<GateSpec>,
}

/// The innovation gate.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected a number of standard deviations, or \"off\"")]
pub enum GateSpec {
    /// Measurements are rejected that are further from what is expected than so many standard
    /// deviations of the innovation.
    Sd(f64),
    /// None are.
    Word(GateWord),
}

/// The innovation gate in a word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum GateWord {
    /// No measurement is rejected.
    Off,
}

impl From<GateSpec> for Gate {
    fn from(spec: GateSpec) -> Self {
        match spec {
            GateSpec::Sd(sd) => Self::Sd(sd),
            GateSpec::Word(GateWord::Off) => Self::Off,
        }
    }
}

/// The estimators.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum EstimatorKind {
    /// The extended Kalman filter.
    Ekf,
    /// The unscented Kalman filter.
    Ukf,
    /// Moving horizon estimation.
    Mhe,
}

impl EstimatorKind {
    /// The name in reports.
    #[must_use]
    pub fn title(self) -> &'static str {
        match self {
            Self::Ekf => "extended Kalman filter",
            Self::Ukf => "unscented Kalman filter",
            Self::Mhe => "moving horizon estimator",
        }
    }
}

/// Where disturbances enter.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum DisturbanceSpec {
    /// No disturbance.
    #[default]
    None,
    /// One disturbance per input, added to it.
    Input,
    /// One disturbance per measured quantity, added to it.
    Output,
    /// One disturbance on each of these states, in its unit per step.
    States(Vec<String>),
}

/// A parameter of the plant that is estimated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UnknownParameter {
    /// Name of the parameter, one of those that a family of plants may vary.
    pub name: String,
    /// Estimate before the first measurement.
    pub initial: f64,
    /// Standard deviation of the initial estimate.
    pub initial_sd: f64,
    /// Standard deviation of the parameter's change in a step.
    #[serde(default)]
    pub drift_sd: f64,
    /// Lower bound of the parameter; no bound if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub low: Option<f64>,
    /// Upper bound of the parameter; no bound if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub high: Option<f64>,
}

impl MeasurementSpec {
    /// The names of what is measured.
    #[must_use]
    pub fn names(&self, variables: &Variables) -> Vec<String> {
        self.measured.clone().unwrap_or_else(|| variables.state_names())
    }

    /// The measured quantities, by their places among the variables; unknown names are left out.
    #[must_use]
    pub fn quantities(&self, variables: &Variables) -> Vec<Measured> {
        let own = variables.own_outputs();
        let quantity = |name: &String| {
            let output = || own.iter().find(|(_, v)| v.name == *name);
            match variables.states.iter().position(|v| v.name == *name) {
                Some(state) => Some(Measured::State(state)),
                None => output().map(|(place, _)| Measured::Output(*place)),
            }
        };
        self.names(variables).iter().filter_map(quantity).collect()
    }
}

impl EstimatorSpec {
    /// Where disturbances enter, by the places of states.
    fn disturbance(&self, variables: &Variables) -> Disturbance {
        match &self.disturbance {
            DisturbanceSpec::None => Disturbance::None,
            DisturbanceSpec::Input => Disturbance::Input,
            DisturbanceSpec::Output => Disturbance::Output,
            DisturbanceSpec::States(names) => {
                let place = |name: &String| variables.states.iter().position(|v| v.name == *name);
                Disturbance::States(names.iter().filter_map(place).collect())
            }
        }
    }

    /// Returns what is measured, estimated and known beside the state, with models that have the
    /// parameters `values`; those at the places `estimated` are estimated, those at `known` known.
    #[must_use]
    pub fn augmentation(
        &self,
        measurement: &MeasurementSpec,
        variables: &Variables,
        (values, estimated, known): (&[f64], &[usize], &[usize]),
    ) -> Augmentation {
        let mut augmentation = Augmentation::measured(measurement.quantities(variables));
        augmentation.disturbance = self.disturbance(variables);
        augmentation.parameters = values.to_vec();
        augmentation.estimated = estimated.to_vec();
        augmentation.known = known.to_vec();
        augmentation
    }

    /// The names of all that is estimated: states, disturbances, parameters.
    #[must_use]
    pub fn names(&self, measurement: &MeasurementSpec, variables: &Variables) -> Vec<String> {
        let disturbed = match &self.disturbance {
            DisturbanceSpec::None => Vec::new(),
            DisturbanceSpec::Input => variables.input_names(),
            DisturbanceSpec::Output => measurement.names(variables),
            DisturbanceSpec::States(names) => names.clone(),
        };
        let mut names = variables.state_names();
        names.extend(disturbed.iter().map(|name| format!("d_{name}")));
        names.extend(self.parameters.iter().map(|parameter| parameter.name.clone()));
        names
    }

    /// What the estimator knows of states, disturbances and parameters that it estimates. The states
    /// move between the bounds that `control` has for them.
    #[must_use]
    pub fn tuning(&self, control: &ControlSpec) -> Tuning {
        let disturbances = self.disturbance_sd.len();
        let unknown = |of: fn(&UnknownParameter) -> f64| self.parameters.iter().map(of);
        let with = |states: &[f64], disturbances: &[f64], of: fn(&UnknownParameter) -> f64| {
            let mut all = [states, disturbances].concat();
            all.extend(unknown(of));
            all
        };
        let (states, none) = (self.process_sd.len(), vec![0.0; disturbances]);
        let side = |side: &Option<Vec<f64>>, none: f64, of: fn(&UnknownParameter) -> f64| {
            let states = side.clone().unwrap_or_else(|| vec![none; states]);
            let all = with(&states, &vec![none; disturbances], of);
            if all.iter().any(|bound| bound.is_finite()) { all } else { Vec::new() }
        };
        Tuning {
            initial_estimate: with(&self.initial_estimate, &none, |p| p.initial),
            initial_sd: with(&self.initial_sd, &self.disturbance_initial_sd, |p| p.initial_sd),
            process_sd: with(&self.process_sd, &self.disturbance_sd, |p| p.drift_sd),
            measurement_sd: self.measurement_sd.clone(),
            parameters: Vec::new(),
            low: side(&self.low, f64::NEG_INFINITY, |p| p.low.unwrap_or(f64::NEG_INFINITY)),
            high: side(&self.high, f64::INFINITY, |p| p.high.unwrap_or(f64::INFINITY)),
            gate: self.gate.map_or_else(Gate::default, Gate::from),
            range: control.state_ranges(),
            alpha: self.alpha,
        }
    }
}
