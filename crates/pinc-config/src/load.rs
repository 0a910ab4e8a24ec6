//! Loads on the plant of a closed loop, and what that plant is at which time.

use crate::experiment::step_at;
use crate::{ControlSpec, Experiment, Schedule, steps};
use pinc_ode::{DynRhs, Loaded, Variable};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// A load on the plant of the loop that no model knows of. Loads at the same time add up.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LoadSpec {
    /// Begin in s.
    pub start_s: f64,
    /// End in s; the load lasts until the run ends if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub end_s: Option<f64>,
    /// Amounts added to inputs before they act on the plant, as an offset of an actuator or a force.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub inputs: BTreeMap<String, f64>,
    /// Amounts added to the time derivatives of states, in their units per second, as a leak.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub rates: BTreeMap<String, f64>,
}

/// The plant of a loop from some step on.
#[derive(Clone, Debug)]
pub struct PlantInTheLoop {
    /// The step from which on it is this one.
    pub from_step: usize,
    /// The plant, with its loads and without parameters.
    pub plant: Arc<dyn DynRhs>,
}

impl LoadSpec {
    /// Whether it acts in a step.
    fn acts(&self, step: usize, sample_time_s: f64) -> bool {
        let end = self.end_s.map(|end_s| step_at(end_s, sample_time_s));
        step_at(self.start_s, sample_time_s) <= step && end.is_none_or(|end| step < end)
    }
}

impl Experiment {
    /// The plants that the loop has one after the other: the first from step 0 on, others where
    /// `plant_schedule` or `loads` change it. Without these it is one, the plant in the loop.
    #[must_use]
    pub fn plants_in_the_loop(&self, sample_time_s: f64) -> Vec<PlantInTheLoop> {
        let loads = self.control.as_ref().map_or(&[][..], |control| &control.loads);
        let schedule = self.plant_schedule(sample_time_s);
        let names: Vec<&str> = schedule.names.iter().map(String::as_str).collect();
        let plant = self.plant_in_the_loop().family(&names).to_shared();
        if loads.is_empty() && schedule.values.is_none() {
            return vec![PlantInTheLoop { from_step: 0, plant }];
        }
        let scheduled = schedule.values.iter().flat_map(|values| values.starts()).copied();
        let ends = loads.iter().flat_map(|load| [Some(load.start_s), load.end_s]).flatten();
        let changes = ends.map(|seconds| step_at(seconds, sample_time_s)).chain(scheduled);
        let last = self.control.as_ref().map_or(0, |c| steps(c.duration_s, sample_time_s));
        let changes: BTreeSet<usize> =
            changes.chain([0]).filter(|step| *step < last.max(1)).collect();
        let at = |from_step: usize| {
            let acting: Vec<_> =
                loads.iter().filter(|load| load.acts(from_step, sample_time_s)).collect();
            let plant = loaded(&plant, &schedule, from_step, &acting);
            PlantInTheLoop { from_step, plant: Arc::new(plant) }
        };
        changes.into_iter().map(at).collect()
    }
}

impl ControlSpec {
    /// Whether the plant of the loop differs from the plant of the models, at some time at least.
    #[must_use]
    pub fn has_mismatch(&self) -> bool {
        self.plant.is_some() || !self.plant_schedule.is_empty() || !self.loads.is_empty()
    }
}

/// The plant as it is at a step.
fn loaded(
    plant: &Arc<dyn DynRhs>,
    schedule: &Schedule,
    step: usize,
    acting: &[&LoadSpec],
) -> Loaded {
    let sum = |variables: &[Variable], of: fn(&LoadSpec) -> &BTreeMap<String, f64>| {
        let total = |v: &Variable| acting.iter().filter_map(|load| of(load).get(&*v.name)).sum();
        variables.iter().map(total).collect()
    };
    let inputs = sum(plant.inputs(), |load| &load.inputs);
    let rates = sum(plant.states(), |load| &load.rates);
    Loaded::new(Arc::clone(plant), schedule.at(step).to_vec(), inputs, rates)
}
