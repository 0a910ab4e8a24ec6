//! The `[identify]` section, and the config of a plant that was identified.

#[cfg(test)]
mod tests;

use crate::{Experiment, MeasurementSpec, PlantSpec};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The problem that `pinc identify` solves on recorded data, with all numbers in the units of the plant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IdentifySpec {
    /// Names of the states and outputs that were measured; all states if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measured: Option<Vec<String>>,
    /// Standard deviation of the noise of each measured quantity, by which its residuals are
    /// divided; if absent, `noise_sd` of `[control.measurement]`, and without it the rms of its
    /// residuals where several quantities are measured, and 1 for a single one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub measurement_sd: Option<Vec<f64>>,
    /// Unknown parameters of the plant.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parameters: Vec<IdentifiedParameter>,
    /// Nets inside the plant's equations whose weights are unknown.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub nets: Vec<IdentifiedNet>,
    /// Which error is fitted; if absent, a simulation's, by single or multiple shooting, whichever is needed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub criterion: Option<IdentifyCriterion>,
    /// Number of starts of the fit within the parameters' bounds, the config's included; if absent,
    /// 16 if all parameters have bounds or `sd`, and otherwise 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub starts: Option<usize>,
    /// How many starts, beside the config's, are fitted to the end: those that are best after a
    /// short fit; 4 if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub finished_starts: Option<usize>,
    /// The first rows of a file that is held out (`--validate`) to which its initial state is
    /// fitted, and which do not count; 5 if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub validation_rows: Option<usize>,
    /// First guess of the initial state of each file, in the plant's order and units.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub initial_state: Option<Vec<f64>>,
    /// Initial state of each file where it is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fixed_initial_state: Option<Vec<f64>>,
    /// Length T of a step in s; if absent, the step of `[model]` or `[control]`, or the spacing of the data.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub step_s: Option<f64>,
    /// Substeps of the integrator per T; if absent, the substeps of `[control]`, or 4.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub substeps: Option<usize>,
}

/// A parameter that is identified.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IdentifiedParameter {
    /// Name of the parameter, one of those that a family of plants may vary.
    pub name: String,
    /// First guess of the parameter.
    pub initial: f64,
    /// Lower bound of the parameter; no bound if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub low: Option<f64>,
    /// Upper bound of the parameter; no bound if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub high: Option<f64>,
    /// Standard deviation of what is known of the parameter beforehand, which is around `initial`;
    /// nothing is known if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sd: Option<f64>,
}

/// A net inside the plant's equations whose weights are identified.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IdentifiedNet {
    /// Name of the net.
    pub name: String,
    /// Standard deviation that weights are expected to have around 0: smaller values penalize
    /// weights more. The penalty counts beside residuals in units of `measurement_sd`.
    pub weight_sd: f64,
}

/// The error that `pinc identify` makes small.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum IdentifyCriterion {
    /// The error of a simulation from the initial state to the end of a file.
    Simulation,
    /// The same error, in segments that are fitted first and then joined.
    MultipleShooting,
    /// The error of predictions from each row to the next, in which every measurement corrects the
    /// state by a constant gain that is identified as well.
    PredictionError,
}

impl IdentifySpec {
    /// Returns the measured quantities as a [`MeasurementSpec`].
    #[must_use]
    pub fn measurement(&self) -> MeasurementSpec {
        MeasurementSpec { measured: self.measured.clone(), noise_sd: self.measurement_sd.clone() }
    }
}

impl Experiment {
    /// The noise of each of `measured`, in the units of these: what `[identify]` says, or what
    /// `[control.measurement]` says of them all.
    #[must_use]
    pub fn measurement_sd(&self, spec: &IdentifySpec, measured: &[String]) -> Option<Vec<f64>> {
        if spec.measurement_sd.is_some() {
            return spec.measurement_sd.clone();
        }
        let of_the_loop = self.control.as_ref()?.measurement.as_ref()?;
        let names = of_the_loop.names(&self.plant.variables());
        let sd = of_the_loop.noise_sd.as_ref()?;
        let of = |name: &String| sd.get(names.iter().position(|known| known == name)?).copied();
        measured.iter().map(|name| of(name).filter(|sd| *sd > 0.0)).collect()
    }

    /// The same experiment with these values of the parameters: in `[plant]`, and for parameters
    /// that a net takes in the models of `[control]`.
    #[must_use]
    pub fn with_parameters(&self, values: &BTreeMap<String, f64>) -> Self {
        let mut with = self.clone();
        with.plant = self.plant.with_parameters(values);
        let varying: Vec<String> = self.varying().into_iter().map(str::to_owned).collect();
        if let Some(control) = &mut with.control {
            for (name, value) in values.iter().filter(|(name, _)| varying.contains(name)) {
                control.parameters.insert(name.clone(), *value);
            }
        }
        with
    }
}

impl PlantSpec {
    /// The plant with other values for some of its [`PlantSpec::parameters`].
    #[must_use]
    pub fn with_parameters(&self, values: &BTreeMap<String, f64>) -> Self {
        let mut with = self.clone();
        match &mut with {
            _ if values.is_empty() => {}
            Self::VanDerPol(spec) => spec.mu = values.get("mu").copied().unwrap_or(spec.mu),
            Self::FourTanks(spec) => {
                let old = self.parameters();
                let value = |name: &str| values.get(name).or(old.get(name)).copied();
                let pair =
                    |name: &str| [1, 2].map(|i| value(&format!("{name}{i}")).unwrap_or(f64::NAN));
                let any = |name: &str| values.keys().any(|key| key.starts_with(name));
                if any("k") {
                    spec.pump = Some(pair("k"));
                }
                if any("gamma") {
                    spec.gamma = Some(pair("gamma"));
                }
                let has_key = |name: &str| name.starts_with('k') || name.starts_with("gamma");
                let others = values.iter().filter(|(name, _)| !has_key(name));
                spec.constants.retain(|name, _| !values.contains_key(name));
                spec.constants.extend(others.map(|(name, value)| (name.clone(), *value)));
            }
            Self::Expression(equations) => {
                for (name, old) in &mut equations.parameters {
                    *old = values.get(name).copied().unwrap_or(*old);
                }
            }
            Self::Own(spec) => *spec = spec.with(values),
            built_in => built_in.set_constants(values.clone()),
        }
        with
    }
}
