//! Parameters and bounds that change during a closed loop.

use crate::experiment::step_at;
use crate::sampled::BOUNDS;
use crate::{ControlSpec, Experiment, LoopParameters, PlantSpec, Variables};
use pinc_mpc::{BoundSchedule, Bounded, MpcError, NmpcProblem, Timetable};
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

/// New bounds of some states, inputs and outputs, by name; other bounds stay as they are.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BoundStep {
    /// Time in s from which on the bounds hold.
    pub start_s: f64,
    /// Lower bounds of states.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub state_low: BTreeMap<String, f64>,
    /// Upper bounds of states.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub state_high: BTreeMap<String, f64>,
    /// Lower bounds of inputs.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub input_low: BTreeMap<String, f64>,
    /// Upper bounds of inputs.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub input_high: BTreeMap<String, f64>,
    /// Lower bounds of outputs that are no states.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub output_low: BTreeMap<String, f64>,
    /// Upper bounds of outputs that are no states.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub output_high: BTreeMap<String, f64>,
}

impl BoundStep {
    /// The bounds with the names of their keys, in the order of the rows of a [`BoundSchedule`].
    pub(crate) fn sides(&self) -> [(&'static str, &BTreeMap<String, f64>); 6] {
        let sides = [
            &self.state_low,
            &self.input_low,
            &self.output_low,
            &self.state_high,
            &self.input_high,
            &self.output_high,
        ];
        std::array::from_fn(|i| (BOUNDS[i], sides[i]))
    }
}

impl ControlSpec {
    /// The bounds at the beginning, in the order of [`BoundStep::sides`].
    fn sides(&self) -> [Option<&Vec<f64>>; 6] {
        [
            self.state_low.as_ref(),
            Some(&self.input_low),
            self.output_low.as_ref(),
            self.state_high.as_ref(),
            Some(&self.input_high),
            self.output_high.as_ref(),
        ]
    }

    /// A bound at the beginning, by the place of its side in [`BoundStep::sides`].
    pub(crate) fn bound(&self, side: usize, place: usize) -> Option<f64> {
        self.sides()[side]?.get(place).copied()
    }

    /// Returns the lower and the upper bound of the variable `name` over the run: pairs of the time
    /// in s from which a value holds and the value. There is one pair if the bound never changes, and
    /// none without a bound.
    #[must_use]
    pub fn bounds_over_time(&self, of: Bounded, name: &str) -> [Vec<(f64, f64)>; 2] {
        let (low, place) = match of {
            Bounded::State(place) => (0, place),
            Bounded::Input(place) => (1, place),
            Bounded::Output(place) => (2, place),
        };
        [low, low + 3].map(|side| {
            let Some(first) = self.bound(side, place) else { return Vec::new() };
            let changes = self.bound_schedule.iter();
            let changes = changes.filter_map(|s| Some((s.start_s, *s.sides()[side].1.get(name)?)));
            [(0.0, first)].into_iter().chain(changes).collect()
        })
    }

    /// How the bounds of `problem` change, if they do.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if there are other bounds than the problem has, or a lower one is above its upper one.
    pub fn bound_schedule(
        &self,
        problem: &NmpcProblem,
        variables: &Variables,
        sample_time_s: f64,
    ) -> Result<Option<BoundSchedule>, MpcError> {
        if self.bound_schedule.is_empty() {
            return Ok(None);
        }
        let dims = variables.dims();
        let mut outputs: Vec<String> = variables.output_names();
        if problem.output_bounds.is_none() {
            outputs.clear();
        }
        let side = [variables.state_names(), variables.input_names(), outputs];
        let parts: Vec<&[String]> = side.iter().chain(&side).map(|names| &names[..]).collect();
        let mut row = BoundSchedule::row(problem, dims);
        let mut rows = vec![(0, row.clone())];
        for step in &self.bound_schedule {
            let given = step.sides().into_iter().zip(&parts);
            let values = given.flat_map(|((_, given), names)| names.iter().map(|n| given.get(n)));
            for (value, new) in row.iter_mut().zip(values) {
                *value = new.copied().unwrap_or(*value);
            }
            let start = step_at(step.start_s, sample_time_s);
            push(&mut rows, start, &row);
        }
        let rows = Timetable::new(row.len(), rows)?;
        BoundSchedule::new(rows, problem, dims).map(Some)
    }
}

/// The values of parameters over the steps of a closed loop.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Schedule {
    /// Their names.
    pub names: Vec<String>,
    /// Their values; nothing if they never change.
    pub values: Option<Timetable>,
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
            let start = step_at(change.start_s, sample_time_s);
            push(&mut all, start, &values);
        }
        // The config was checked for times that increase.
        let values = Timetable::new(names.len(), all).ok();
        Self { names, values }
    }

    /// The values that hold in `step`; none if they never change.
    pub(crate) fn at(&self, step: usize) -> &[f64] {
        self.values.as_ref().map_or(&[], |values| values.at(step))
    }

    /// The values that begin at `step`, if any do.
    #[must_use]
    pub fn beginning(&self, step: usize) -> Option<&[f64]> {
        self.values.as_ref()?.beginning(step)
    }
}

/// Adds a row that begins at a step, where it takes the place of one that begins there too.
fn push(rows: &mut Vec<(usize, Vec<f64>)>, start: usize, row: &[f64]) {
    match rows.last_mut() {
        Some((last, values)) if *last == start => values.copy_from_slice(row),
        _ => rows.push((start, row.to_vec())),
    }
}

impl Experiment {
    /// Returns the values that the models of the loop get for [`LoopParameters::known`].
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
        let LoopParameters { names, values, known, .. } = self.loop_parameters();
        let told = known.into_iter().map(|place| (names[place].to_owned(), values[place]));
        let (names, values) = told.unzip();
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
