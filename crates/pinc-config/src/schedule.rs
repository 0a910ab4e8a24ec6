//! Parameters that change during a closed loop.

use crate::experiment::step_at;
use crate::{Experiment, LoopParameters, PlantSpec};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// New values of some parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ParameterStep {
    /// Time in s from which on the values hold.
    pub start_s: f64,
    /// Values by the names of parameters; other parameters keep theirs.
    pub values: BTreeMap<String, f64>,
}

/// The values of parameters over the steps of a closed loop.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Schedule {
    /// Their names.
    pub names: Vec<String>,
    /// From which step on they have which values, by steps, the first from 0; nothing if they never
    /// change.
    pub values: Vec<(usize, Vec<f64>)>,
}

impl Schedule {
    /// The parameters `names`, which begin with `values`, in steps of `sample_time_s`.
    fn of(
        names: Vec<String>,
        mut values: Vec<f64>,
        changes: &[ParameterStep],
        sample_time_s: f64,
    ) -> Self {
        if changes.is_empty() {
            return Self::default();
        }
        let mut all = vec![(0, values.clone())];
        for change in changes {
            for (name, value) in names.iter().zip(&mut values) {
                *value = change.values.get(name).copied().unwrap_or(*value);
            }
            all.push((step_at(change.start_s, sample_time_s), values.clone()));
        }
        Self { names, values: all }
    }

    /// The values that hold in `step`; none if they never change.
    pub(crate) fn at(&self, step: usize) -> &[f64] {
        let found = self.values.iter().rfind(|(start, _)| *start <= step);
        found.map_or(&[], |(_, values)| values)
    }

    /// The values that begin at `step`, if any do.
    #[must_use]
    pub fn beginning(&self, step: usize) -> Option<&[f64]> {
        let found = self.values.iter().rfind(|(start, _)| *start == step);
        found.map(|(_, values)| &values[..])
    }
}

impl Experiment {
    /// Returns the values that the models of the loop get for the parameters
    /// [`Experiment::varying`].
    #[must_use]
    pub fn model_schedule(&self, sample_time_s: f64) -> Schedule {
        let Some(control) = &self.control else { return Schedule::default() };
        let mut changes = control.parameter_schedule.clone();
        if !control.measured_parameters.is_empty() {
            changes.clone_from(&control.plant_schedule);
            for change in &mut changes {
                change.values.retain(|name, _| control.measured_parameters.contains(name));
            }
        }
        let LoopParameters { names, values, .. } = self.loop_parameters();
        let names = names.into_iter().map(str::to_owned).collect();
        Schedule::of(names, values, &changes, sample_time_s)
    }

    /// How the plant in the loop changes, of the parameters that do.
    pub(crate) fn plant_schedule(&self, sample_time_s: f64) -> Schedule {
        let changes = self.control.as_ref().map_or(&[][..], |control| &control.plant_schedule);
        let nominal = self.plant_in_the_loop().parameters();
        let changing = |name: &&String| changes.iter().any(|c| c.values.contains_key(*name));
        let names: Vec<String> = nominal.keys().filter(changing).cloned().collect();
        let values = names.iter().map(|name| nominal[name]).collect();
        Schedule::of(names, values, changes, sample_time_s)
    }

    /// The plant in the loop: the models' plant, unless `[control]` has another one.
    #[must_use]
    pub fn plant_in_the_loop(&self) -> &PlantSpec {
        let own = self.control.as_ref().and_then(|control| control.plant.as_ref());
        own.unwrap_or(&self.plant)
    }
}
