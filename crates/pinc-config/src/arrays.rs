//! Lists of a config for a plant with arrays: one entry per array, or one per element.
//!
//! Where the plant has the states `T[20]` and `E`, a list of states is `[300.0, 0.0]`, the first
//! number for all elements of `T`, or `[[300.0, 301.0, ..], 0.0]`, or has 21 numbers.

use crate::layers;
use crate::plant::PlantSpec;
use crate::problem::{Problem, nearest};
use crate::validate;
use pinc_expr::Equations;
use pinc_ode::Variable;
use serde::Deserialize;
use std::ops::Range;
use toml::{Table, Value};

/// A value, or the key and what is wrong there.
type Checked<T> = Result<T, (String, Problem)>;

/// Equations with their states, inputs and outputs.
type Arrays = (Equations, [Vec<Variable>; 3]);

/// How lists were written in a file, by their keys. No result depends on it: all are equal.
#[derive(Clone, Debug, Default)]
pub(crate) struct AsWritten(Vec<(String, Value)>);

impl PartialEq for AsWritten {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl AsWritten {
    /// Puts these lists back, so that arrays of another size can have them.
    pub(crate) fn restore(&self, table: &mut Table) {
        for (key, value) in &self.0 {
            // A key that is gone did not name a list.
            let _ = layers::assign(table, key, value.clone());
        }
    }
}

/// What there is one number of per variable.
const PER_STATE: [&str; 16] = [
    "domain.state_low",
    "domain.state_high",
    "validation.domain.state_low",
    "validation.domain.state_high",
    "model.time_only.initial_state",
    "training.residual_scale.custom",
    "prediction.initial_state",
    "control.initial_state",
    "control.state_low",
    "control.state_high",
    "control.state_softness.penalty",
    "control.estimator.process_sd",
    "control.estimator.initial_estimate",
    "control.estimator.initial_sd",
    "control.estimator.low",
    "control.estimator.high",
];
const PER_INPUT: [&str; 14] = [
    "domain.input_low",
    "domain.input_high",
    "validation.domain.input_low",
    "validation.domain.input_high",
    "model.time_only.input",
    "prediction.input_low",
    "prediction.input_high",
    "control.initial_input",
    "control.r",
    "control.input_low",
    "control.input_high",
    "control.increment_low",
    "control.increment_high",
    "control.input_differences.*.weight",
];
const PER_OUTPUT: [&str; 3] =
    ["control.output_low", "control.output_high", "control.output_softness.penalty"];
const PER_CONTROLLED: [&str; 4] =
    ["control.q", "control.q_terminal", "control.settled_within", "control.references.*.value"];
const PER_MEASURED: [&str; 2] =
    ["control.measurement.noise_sd", "control.estimator.measurement_sd"];
const PER_DISTURBANCE: [&str; 2] =
    ["control.estimator.disturbance_sd", "control.estimator.disturbance_initial_sd"];

/// Writes the lists of a resolved config out, one entry per element.
pub(crate) fn write_out(table: &mut Table) -> Checked<AsWritten> {
    let Some((equations, [states, inputs, outputs])) = arrays(table)? else {
        return Ok(AsWritten::default());
    };
    let names = |variables: &[Variable]| -> Vec<String> {
        variables.iter().map(|variable| variable.name.to_string()).collect()
    };
    let (states, inputs) = (names(&states), names(&inputs));
    let mut outputs = names(&outputs);
    outputs.retain(|output| !states.contains(output));
    let all = [&states[..], &outputs].concat();
    let mut lists = Lists { equations, table, written: Vec::new() };
    let controlled = lists.names("control.controlled", &all)?;
    let measured = lists.names("control.measurement.measured", &all)?;
    let disturbed = lists.names("control.estimator.disturbance.states", &states)?;
    let disturbed = disturbed.or_else(|| {
        match lists.table.get("control")?.get("estimator")?.get("disturbance")?.as_str()? {
            "input" => Some(Variable::groups(&inputs)),
            "output" => Some(measured.clone().unwrap_or_else(|| Variable::groups(&states))),
            _ => None,
        }
    });
    lists.numbers(&PER_STATE, &Variable::groups(&states))?;
    lists.numbers(&PER_INPUT, &Variable::groups(&inputs))?;
    lists.numbers(&PER_OUTPUT, &Variable::groups(&outputs))?;
    lists.numbers(&PER_CONTROLLED, &controlled.unwrap_or_default())?;
    lists.numbers(&PER_MEASURED, &measured.unwrap_or_else(|| Variable::groups(&states)))?;
    lists.numbers(&PER_DISTURBANCE, &disturbed.unwrap_or_default())?;
    Ok(AsWritten(lists.written))
}

/// The equations of a plant with arrays, and its variables. Of a section that is no plant nothing
/// is said here.
fn arrays(table: &Table) -> Checked<Option<Arrays>> {
    let plant = table.get("plant").filter(|plant| plant.get("expression").is_some());
    let plant = plant.map(|plant| PlantSpec::deserialize(plant.clone()));
    let Some(Ok(PlantSpec::Expression(equations))) = plant else { return Ok(None) };
    let variables =
        equations.variables().map_err(|error| validate::expression_finding("plant", error))?;
    let is_element = |variable: &Variable| Variable::split_name(&variable.name).is_some();
    let has_arrays = variables.iter().flatten().any(is_element);
    Ok(has_arrays.then_some((equations, variables)))
}

struct Lists<'a> {
    equations: Equations,
    table: &'a mut Table,
    written: Vec<(String, Value)>,
}

impl Lists<'_> {
    /// A list of names, in which `T` stands for all elements of an array and `T[n]` or `T[2..n]`
    /// for some: the places that each entry has in the new list. None if there is no such list.
    fn names(&mut self, key: &str, known: &[String]) -> Checked<Option<Vec<Range<usize>>>> {
        let Some(Value::Array(list)) = at(self.table, key) else { return Ok(None) };
        let (mut all, mut groups) = (Vec::new(), Vec::new());
        for entry in &*list {
            let text = entry.as_str().unwrap_or_default();
            let range = self.equations.indices(text);
            let is_meant = |name: &&String| {
                Variable::split_name(name).is_some_and(|(array, index)| match &range {
                    Some((of, range)) => array == *of && range.contains(&index),
                    None => array == text,
                })
            };
            let elements = known.iter().filter(is_meant).map(|name| Value::String(name.clone()));
            let elements: Vec<Value> = elements.collect();
            let start = all.len();
            match elements.is_empty() {
                true if range.is_some() => {
                    let (found, known) = (text.to_owned(), known.to_vec());
                    let key = in_errors(&format!("{key}.{}", groups.len()));
                    let nearest = nearest(text, &known);
                    return Err((key, Problem::Word { found, known, nearest }));
                }
                true => all.push(entry.clone()),
                false => all.extend(elements),
            }
            groups.push(start..all.len());
        }
        if all != *list {
            let old = std::mem::replace(list, all);
            self.written.push((key.to_owned(), Value::Array(old)));
        }
        Ok(Some(groups))
    }

    fn numbers(&mut self, keys: &[&str], groups: &[Range<usize>]) -> Checked<()> {
        for key in keys {
            let Some((list, rest)) = key.split_once(".*.") else {
                self.list(key, groups)?;
                continue;
            };
            let Some(Value::Array(items)) = at(self.table, list) else { continue };
            for i in 0..items.len() {
                self.list(&format!("{list}.{i}.{rest}"), groups)?;
            }
        }
        Ok(())
    }

    fn list(&mut self, key: &str, groups: &[Range<usize>]) -> Checked<()> {
        let total = groups.last().map_or(0, |last| last.end);
        let Some(Value::Array(list)) = at(self.table, key) else { return Ok(()) };
        let has_lists = list.iter().any(Value::is_array);
        if list.len() != groups.len() || (list.len() == total && !has_lists) {
            return Ok(());
        }
        // As many lists as variables are the rows of a matrix.
        if list.len() == total && list.iter().all(Value::is_array) && total > 1 {
            return Ok(());
        }
        let mut all = Vec::with_capacity(total);
        for (i, (entry, group)) in list.iter().zip(groups).enumerate() {
            match entry {
                Value::Array(elements) if elements.len() == group.len() => {
                    all.extend(elements.iter().cloned());
                }
                Value::Array(elements) => {
                    let (found, expected) = (elements.len(), group.len());
                    let problem = Problem::Length { found, expected, per: "element of the array" };
                    return Err((in_errors(&format!("{key}.{i}")), problem));
                }
                number => all.extend(std::iter::repeat_n(number.clone(), group.len())),
            }
        }
        let old = std::mem::replace(list, all);
        self.written.push((key.to_owned(), Value::Array(old)));
        Ok(())
    }
}

/// A key such as `control.references.0.value` as errors write it.
fn in_errors(key: &str) -> String {
    key.split('.').fold(String::new(), |path, key| match key.parse::<usize>() {
        Ok(place) => format!("{path}[{place}]"),
        Err(_) if path.is_empty() => key.to_owned(),
        Err(_) => format!("{path}.{key}"),
    })
}

/// The value of a key such as `control.references.0.value`.
fn at<'a>(table: &'a mut Table, key: &str) -> Option<&'a mut Value> {
    let mut keys = key.split('.');
    let first = table.get_mut(keys.next()?);
    keys.fold(first, |value, key| match value? {
        Value::Table(table) => table.get_mut(key),
        Value::Array(items) => items.get_mut(key.parse::<usize>().ok()?),
        _ => None,
    })
}
