//! `identify.json`: what was identified of a plant.

use crate::error::RecordError;
use crate::files::{file, json, read_json};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;

/// The share by which the costs of fits differ that ended in the same minimum.
const SAME: f64 = 1e-6;

/// The results of `pinc identify`.
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
    /// The measured quantities.
    pub outputs: Vec<String>,
    /// By what the residuals of each output are divided; 1 where the noise is not known.
    pub measurement_sd: Vec<f64>,
    /// The state at the first row of each file, where it is unknown.
    pub initial_states: Vec<InitialStateMetrics>,
    /// How the fit ended.
    pub status: String,
    /// Where the fit ended from each of its starts, the one that was taken first.
    #[serde(default)]
    pub starts: Vec<StartMetrics>,
    /// Single or multiple shooting.
    pub method: String,
    /// Why.
    pub reason: String,
    /// The number of measured values.
    pub measurements: usize,
    /// These without the unknowns.
    pub degrees_of_freedom: usize,
    /// The residuals of each output, by its name.
    pub residuals: BTreeMap<String, ResidualMetrics>,
    /// The correlations of the estimates.
    pub correlation: CorrelationMetrics,
    /// The singular values of the residuals' derivatives by all unknowns, each in its own size.
    pub singular_values: Vec<f64>,
    /// In words, what there is to say of data and fit.
    pub findings: Vec<String>,
    /// The work done.
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

/// One of the starts of a fit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StartMetrics {
    /// The cost where the fit from there ended; nothing if the model is not finite there.
    pub cost: Option<f64>,
    /// The parameters there, by their names.
    pub parameters: BTreeMap<String, f64>,
    /// How it ended.
    pub status: String,
}

/// The estimated initial state of a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct InitialStateMetrics {
    /// The file.
    pub file: String,
    /// The states, by their names.
    pub states: BTreeMap<String, EstimateMetrics>,
}

/// The residuals of an output.
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

/// The work of a fit.
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

impl StartMetrics {
    /// The status of a start that had only a short fit, since others were better.
    pub const SET_ASIDE: &str = "set aside";
}

impl IdentificationMetrics {
    /// How the fit ended, and from how many of its starts there.
    #[must_use]
    pub fn ended(&self) -> String {
        if self.starts.len() < 2 {
            let other = "another start may end in a better minimum";
            return format!("{} from a single start ({other})", self.status);
        }
        let (fitted, aside): (Vec<_>, Vec<_>) =
            self.starts.iter().partition(|start| start.status != StartMetrics::SET_ASIDE);
        let costs = || fitted.iter().filter_map(|start| start.cost);
        let same = |cost: &f64| *cost <= (1.0 + SAME) * self.cost;
        let others = || costs().filter(|cost| !same(cost));
        let elsewhere = match others().count() {
            0 => String::new(),
            count => {
                let (low, high) = (others().fold(f64::MAX, f64::min), others().fold(0.0, f64::max));
                format!(", {count} at costs of {low:.6} to {high:.6}")
            }
        };
        format!(
            "{} from {} starts: {} of {} that were fitted to the end ended here{elsewhere}; set \
             aside after a short fit: {}",
            self.status,
            self.starts.len(),
            costs().filter(same).count(),
            fitted.len(),
            aside.len()
        )
    }

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

#[cfg(test)]
mod tests {
    use super::*;

    fn of(status: &str, starts: &[(Option<f64>, &str)]) -> String {
        let start = |(cost, status): &(Option<f64>, &str)| StartMetrics {
            cost: *cost,
            parameters: BTreeMap::new(),
            status: (*status).to_owned(),
        };
        let text = r#"{ "experiment": "e", "model": "rk4", "parameters": {}, "cost": 2.0,
            "outputs": [], "measurement_sd": [], "initial_states": [], "status": "",
            "method": "", "reason": "", "measurements": 9, "degrees_of_freedom": 7,
            "residuals": {}, "correlation": { "names": [], "matrix": [] }, "singular_values": [],
            "findings": [],
            "work": { "iterations": 1, "steps": 1, "linearized": 1, "wall_s": 1.0 } }"#;
        let metrics: IdentificationMetrics = serde_json::from_str(text).unwrap();
        let (status, starts) = (status.to_owned(), starts.iter().map(start).collect());
        IdentificationMetrics { status, starts, ..metrics }.ended()
    }

    #[test]
    fn how_many_starts_ended_where_is_said() {
        let one = of("converged", &[(Some(2.0), "converged")]);
        assert!(one.starts_with("converged from a single start ("), "{one}");
        let several = [
            (Some(2.0), "converged"),
            (Some(2.0 + 1e-6), "stalled"),
            (Some(5.25), "converged"),
            (Some(7.5), "converged"),
            (None, "not finite"),
            (Some(3.0), "set aside"),
        ];
        assert_eq!(
            of("converged", &several),
            "converged from 6 starts: 2 of 5 that were fitted to the end ended here, 2 at costs of \
             5.250000 to 7.500000; set aside after a short fit: 1"
        );
    }
}
