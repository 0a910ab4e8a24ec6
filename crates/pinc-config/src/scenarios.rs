//! The `[control.scenarios]` section.

use pinc_mpc::Scenarios;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The stream of random numbers that branches come from; those below are others'.
const STREAM: u64 = 1 << 35;

/// Uncertain parameters of the models: the plan is a tree with a branch for each combination of their values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScenarioSpec {
    /// Values that each parameter may have. The first ones are the branch that the plan of the next
    /// step starts from. Or the path of an `identify.json`: each parameter's value and the ends of its
    /// interval of 95 % are taken.
    pub values: BTreeMap<String, Vec<f64>>,
    /// Which combinations of the values are branches.
    #[serde(default)]
    pub combine: Combine,
    /// How many stages branch, less than `nu`. After these a parameter keeps its value.
    #[serde(default = "one")]
    pub robust_horizon: usize,
    /// Weights of the branches, of which only ratios matter; equal if absent. All combinations are
    /// in the order of the parameters' names, the last one's values changing first.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub weights: Option<Vec<f64>>,
}

/// Which combinations of values are branches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Combine {
    /// Each value of a parameter with each value of the others.
    #[default]
    All,
    /// The first values of all parameters, the second ones, and so on.
    InOrder,
    /// The first values, and so many drawn by the experiment's `seed`, uniformly between the least
    /// and the greatest value of each parameter.
    Draws(usize),
}

impl ScenarioSpec {
    /// Returns the number of branches at a stage, or `None` if there are too many to count.
    #[must_use]
    pub fn branches(&self) -> Option<usize> {
        let mut lengths = self.values.values().map(Vec::len);
        match self.combine {
            Combine::All => lengths.try_fold(1, usize::checked_mul),
            Combine::InOrder => lengths.max(),
            Combine::Draws(count) => count.checked_add(1),
        }
    }

    /// The scenarios of models whose parameters have these names.
    pub(crate) fn of(&self, names: &[&str], seed: u64) -> Scenarios {
        let place = |name: &String| names.iter().position(|known| known == name);
        let places = self.values.keys().filter_map(place).collect();
        let values: Vec<Vec<f64>> = self.values.values().cloned().collect();
        let branch = |i| values.iter().map(|values| values[i]).collect();
        let horizon = self.robust_horizon;
        let mut scenarios = match self.combine {
            Combine::All => Scenarios::grid(places, &values, horizon),
            Combine::InOrder => {
                let branches = 0..values.first().map_or(0, Vec::len);
                Scenarios::list(places, branches.map(branch).collect(), horizon)
            }
            Combine::Draws(count) => Scenarios::list(places, drawn(&values, count, seed), horizon),
        };
        if let Some(weights) = &self.weights {
            let sum: f64 = weights.iter().sum();
            scenarios.weights = weights.iter().map(|weight| weight / sum).collect();
        }
        scenarios
    }
}

/// The first values of all parameters, and `count` between the least and the greatest of each: the
/// first ones are the same however many there are.
fn drawn(values: &[Vec<f64>], count: usize, seed: u64) -> Vec<Vec<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(STREAM);
    let mut between = |values: &Vec<f64>| {
        let least = values.iter().copied().fold(f64::INFINITY, f64::min);
        let greatest = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        least + rng.random::<f64>() * (greatest - least)
    };
    let first = values.iter().map(|values| values[0]).collect();
    let others = (0..count).map(|_| values.iter().map(&mut between).collect());
    std::iter::once(first).chain(others).collect()
}

fn one() -> usize {
    1
}
