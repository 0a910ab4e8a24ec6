//! The `[control.scenarios]` section.

use pinc_mpc::Scenarios;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Uncertain parameters of the models: the plan is a tree with a branch for each combination of
/// their values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScenarioSpec {
    /// Values that each parameter may have. The first ones are the branch that the plan of the next
    /// step starts from. Or the path of an `identify.json`: each parameter's value and the ends of its
    /// interval of 95 % are taken.
    pub values: BTreeMap<String, Vec<f64>>,
    /// How many stages branch, less than `nu`. After these a parameter keeps its value.
    #[serde(default = "one")]
    pub robust_horizon: usize,
    /// Weights of the branches, of which only ratios matter; equal if absent. Combinations are in
    /// the order of the parameters' names, the last one's values changing first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weights: Option<Vec<f64>>,
}

impl ScenarioSpec {
    /// Returns the number of branches at a stage, or `None` if there are too many to count.
    #[must_use]
    pub fn branches(&self) -> Option<usize> {
        self.values.values().try_fold(1_usize, |count, values| count.checked_mul(values.len()))
    }

    /// The scenarios of models whose parameters have these names.
    pub(crate) fn of(&self, names: &[&str]) -> Scenarios {
        let place = |name: &String| names.iter().position(|known| known == name);
        let places = self.values.keys().filter_map(place).collect();
        let values: Vec<Vec<f64>> = self.values.values().cloned().collect();
        let mut scenarios = Scenarios::grid(places, &values, self.robust_horizon);
        if let Some(weights) = &self.weights {
            let sum: f64 = weights.iter().sum();
            scenarios.weights = weights.iter().map(|weight| weight / sum).collect();
        }
        scenarios
    }
}

fn one() -> usize {
    1
}
