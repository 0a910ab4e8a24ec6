//! `identify.json`: what was identified of a plant.

use crate::error::RecordError;
use crate::files::{file, json, read_json};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// What `pinc identify` found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct IdentificationMetrics {
    /// The experiment's name.
    pub experiment: String,
    /// The model that was fitted.
    pub model: String,
    /// The parameters, by their names.
    pub parameters: BTreeMap<String, ParameterMetrics>,
    /// Half the sum of the squares of all residuals, each divided by its noise.
    pub cost: f64,
    /// What was measured.
    pub outputs: Vec<String>,
    /// By what the residuals of each output are divided; 1 where the noise is not known.
    pub measurement_sd: Vec<f64>,
    /// The state at the first row of each file, where it is unknown.
    pub initial_states: Vec<InitialStateMetrics>,
    /// How the fit ended.
    pub status: String,
    /// Single or multiple shooting.
    pub method: String,
    /// Why.
    pub reason: String,
    /// The number of measured values.
    pub measurements: usize,
    /// These without the unknowns.
    pub degrees_of_freedom: usize,
    /// What is left of each output, by its name.
    pub residuals: BTreeMap<String, ResidualMetrics>,
    /// The correlations of the estimates.
    pub correlation: CorrelationMetrics,
    /// The singular values of the residuals' derivatives by all unknowns, each in its own size.
    pub singular_values: Vec<f64>,
    /// In words, what there is to say of data and fit.
    pub findings: Vec<String>,
    /// What it took.
    pub work: WorkMetrics,
}

/// An estimate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EstimateMetrics {
    /// Its value.
    pub value: f64,
    /// Half the width of its interval of 95 %; nothing where the data do not determine it.
    pub half_width_95: Option<f64>,
}

/// The estimate of a parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParameterMetrics {
    /// The estimate.
    #[serde(flatten)]
    pub estimate: EstimateMetrics,
    /// Where it started.
    pub initial: f64,
    /// The bounds that it had.
    pub low: Option<f64>,
    /// The upper one.
    pub high: Option<f64>,
    /// Which of them it is at: `low` or `high`.
    pub at_bound: Option<String>,
}

/// The estimated initial state of a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InitialStateMetrics {
    /// The file.
    pub file: String,
    /// The states, by their names.
    pub states: BTreeMap<String, EstimateMetrics>,
}

/// What is left of an output.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResidualMetrics {
    /// The number of measured values.
    pub measurements: usize,
    /// The root mean square of the residuals, in the output's unit.
    pub rms: f64,
    /// The correlation of neighbouring residuals.
    pub correlation: f64,
}

/// The correlations of the estimates.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CorrelationMetrics {
    /// Their names.
    pub names: Vec<String>,
    /// Row by row; nothing where one of the two is not determined.
    pub matrix: Vec<Vec<Option<f64>>>,
}

/// What a fit took.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WorkMetrics {
    /// Iterations.
    pub iterations: usize,
    /// Steps of the model.
    pub steps: usize,
    /// Points at which it was linearized.
    pub linearized: usize,
    /// The time in s.
    pub wall_s: f64,
}

impl IdentificationMetrics {
    /// Those in a run directory; `None` if there are none.
    ///
    /// # Errors
    ///
    /// [`RecordError`] if the file cannot be read or is damaged.
    pub fn read(dir: &Path) -> Result<Option<Self>, RecordError> {
        read_json(&dir.join(file::IDENTIFY))
    }

    /// The text of the file.
    #[must_use]
    pub fn to_json(&self) -> String {
        json(self)
    }
}
