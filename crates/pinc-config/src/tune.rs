//! The `[tune]` section: what `pinc tune` may change, and what a loop costs.

use crate::sweep::set_once;
use crate::validate::Checked;
use crate::validate::values::{ordered, value};
use crate::{CaseSpec, DrawsSpec, Experiment, Problem, RangeSpec, SearchRange, SweepSpec};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use toml::{Table, Value};

/// Seeds of the loops that are held out: the config's with this bit changed.
const HELD_OUT: u64 = 1 << 32;

/// The problem that `pinc tune` solves: keys of the controller, and the cost of closed loops with drawn plants.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TuneSpec {
    /// Keys of `[control]` that may change, each from `low` to `high`.
    pub ranges: Vec<SearchRange>,
    /// Weights of the metrics of a loop, by their columns in `sweep.csv` without the model; if there
    /// are none, `iae_dense_sum` with 1, `input_travel` with 0.1 and `violation_share` with 10.
    /// Metrics with a unit are divided by their mean with the config as it is written.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub cost: BTreeMap<String, f64>,
    /// Ranges of values that differ from loop to loop, as the plant's parameters, references and
    /// initial states; each loop also has its own noise.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub draws: Vec<RangeSpec>,
    /// Number of loops that a candidate is judged by.
    #[serde(default = "usual_loops")]
    pub loops: usize,
    /// Number of other loops by which the result is compared with the config.
    #[serde(default = "usual_held_out")]
    pub held_out: usize,
    /// Number of candidates.
    #[serde(default = "usual_candidates")]
    pub candidates: usize,
}

fn usual_loops() -> usize {
    8
}

fn usual_held_out() -> usize {
    20
}

fn usual_candidates() -> usize {
    200
}

/// A candidate: values by their keys.
pub type Candidate = Table;

/// The weights of a cost that the config does not say.
const USUAL_COST: [(&str, f64); 3] =
    [("iae_dense_sum", 1.0), ("input_travel", 0.1), ("violation_share", 10.0)];

impl TuneSpec {
    /// Returns the metrics that a loop costs, with their weights.
    #[must_use]
    pub fn weights(&self) -> Vec<(&str, f64)> {
        match self.cost.is_empty() {
            true => USUAL_COST.into(),
            false => self.cost.iter().map(|(metric, weight)| (&**metric, *weight)).collect(),
        }
    }

    /// The candidate at a place whose coordinates go from 0 to 1.
    #[must_use]
    pub fn candidate(&self, place: &[f64]) -> Candidate {
        let mut values = Table::new();
        for (range, place) in self.ranges.iter().zip(place) {
            let value = range.value(*place);
            for key in std::iter::once(&range.key).chain(&range.also) {
                values.insert(key.clone(), value.clone());
            }
        }
        values
    }

    /// The place of the config as it is written; in the middle of the ranges of keys that it lacks.
    #[must_use]
    pub fn start(&self, experiment: &Experiment) -> Vec<f64> {
        let place = |range: &SearchRange| {
            let found = experiment.value_of(&range.key);
            let number = found.and_then(|v| v.as_float().or(v.as_integer().map(|v| v as f64)));
            number.map_or(0.5, |number| range.place(number))
        };
        self.ranges.iter().map(place).collect()
    }

    pub(crate) fn validate(&self, experiment: &Experiment) -> Checked {
        let wrong =
            |key: &str, found: &str, expected: &str| value(&format!("tune.{key}"), found, expected);
        if experiment.control.is_none() {
            return wrong("ranges", "no section [control]", "a closed loop to tune");
        }
        if self.ranges.is_empty() {
            return wrong("ranges", "[]", "one range or more");
        }
        let counts = [("loops", self.loops), ("held_out", self.held_out)];
        for (key, count) in counts.into_iter().chain([("candidates", self.candidates)]) {
            if !(1..=MOST).contains(&count) {
                return wrong(key, &count.to_string(), "from 1 to 100000");
            }
        }
        for (metric, weight) in &self.cost {
            if *weight < 0.0 {
                return wrong(&format!("cost.{metric}"), &weight.to_string(), "0 or more");
            }
        }
        if !self.weights().iter().any(|(_, weight)| *weight > 0.0) {
            return wrong("cost", "no weight above 0", "one metric or more with a weight");
        }
        let mut known = BTreeSet::new();
        for (i, range) in self.ranges.iter().enumerate() {
            range.check(&format!("tune.ranges[{i}]"))?;
            if !range.values.is_empty() {
                return wrong(&format!("ranges[{i}].values"), "a list", "low and high");
            }
            for key in std::iter::once(&range.key).chain(&range.also) {
                if !key.starts_with("control.") {
                    let expected = "a key of [control]: the model is not tuned";
                    return wrong(&format!("ranges[{i}].key"), &format!("{key:?}"), expected);
                }
                set_once(&format!("tune.ranges[{i}].key"), key, &mut known)?;
            }
            // Another key may forbid a part of the range.
            let all = [0.5, 0.0, 1.0].map(|place| (range.key.clone(), range.value(place)));
            let tried: Vec<_> =
                all.into_iter().map(|value| self.tried(experiment, value)).collect();
            if tried.iter().all(Result::is_err) {
                tried.into_iter().next().unwrap_or(Ok(()))?;
            }
        }
        for (i, range) in self.draws.iter().enumerate() {
            ordered(&format!("tune.draws[{i}].low"), range.low, range.high)?;
            set_once(&format!("tune.draws[{i}].key"), &range.key, &mut known)?;
            self.tried(experiment, (range.key.clone(), Value::Float(range.low)))?;
        }
        Ok(())
    }

    /// Whether the config admits a value.
    fn tried(&self, experiment: &Experiment, (key, value): (String, Value)) -> Checked {
        let trial = format!("{key} = {value}");
        let mut base = experiment.to_table_as_written();
        base.remove("tune");
        base.remove("sweep");
        let made = Experiment::with_values(base, experiment.plants(), [(&*key, value)]);
        made.map(drop).map_err(|(key, problem)| {
            ("tune".to_owned(), Problem::Trial { trial, key, problem: Box::new(problem) })
        })
    }
}

/// Most loops and candidates.
const MOST: usize = 100_000;

impl Experiment {
    /// The sweep of these candidates over the loops that they are judged by, or over those that are
    /// held out; `None` without `[tune]`.
    #[must_use]
    pub fn tuning(&self, candidates: Vec<CaseSpec>, held_out: bool) -> Option<Self> {
        let tune = self.tune.as_ref()?;
        let mut sweep = self.clone();
        sweep.tune = None;
        sweep.name += if held_out { "-held-out" } else { "-tune" };
        let draws = DrawsSpec {
            name: "loops".to_owned(),
            count: if held_out { tune.held_out } else { tune.loops },
            seeded: true,
            seed: held_out.then_some(self.seed ^ HELD_OUT),
            ranges: tune.draws.clone(),
        };
        sweep.sweep = Some(SweepSpec {
            seeds: Vec::new(),
            timed: false,
            keep_traces: false,
            cases: candidates,
            grid: Vec::new(),
            draws: vec![draws],
            search: None,
            slurm: Table::new(),
        });
        Some(sweep)
    }

    /// The value at a key path, as `control.q.0`, if there is one.
    #[must_use]
    pub fn value_of(&self, key: &str) -> Option<Value> {
        let mut keys = key.split('.');
        let first = self.to_table().remove(keys.next()?)?;
        keys.try_fold(first, |value, key| match value {
            Value::Array(mut items) => {
                let place = key.parse::<usize>().ok().filter(|place| *place < items.len())?;
                Some(items.swap_remove(place))
            }
            Value::Table(mut table) => table.remove(key),
            _ => None,
        })
    }

    /// The experiment with a candidate's values.
    ///
    /// # Errors
    ///
    /// The key that is wrong, and what is wrong with its value.
    pub fn with_candidate(&self, candidate: &Candidate) -> Result<Self, (String, Problem)> {
        let values = candidate.iter().map(|(key, value)| (key.as_str(), value.clone()));
        Self::with_values(self.to_table_as_written(), self.plants(), values)
    }
}
