//! Lists of a config by name, and for a plant with arrays.
//!
//! A list of one number per state, input, output or disturbance may be a table by name, as `{ V = 4.0 }`.
//! Names that it does not have get their default where there is one: no bound, or no weight.
//!
//! In a list for a plant with arrays there is one entry per array, or one per element.
//!
//! For a plant with the states `T[20]` and `E`, a list of states is `[300.0, 0.0]`, with the first
//! number for all elements of `T`, or `[[300.0, 301.0, ..], 0.0]`, or a list of 21 numbers.

use crate::plant::PlantSpec;
use crate::plants::Plants;
use crate::registry::names;
use crate::validate;
use pinc_expr::Equations;
use pinc_ode::Variable;
use pinc_toml::{ConfigError, Layers, Problem, assign, explain};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::PathBuf;
use toml::{Table, Value};

/// A value, or the key and what is wrong there.
type Checked<T> = Result<T, (String, Problem)>;

/// The equations, if the plant is a text, and the names of states, inputs and own outputs.
type Named = (Option<Equations>, [Vec<String>; 3]);

/// How lists were written in a file, by their keys. No result depends on it: all are equal.
#[derive(Clone, Debug, Default)]
pub(crate) struct AsWritten {
    lists: Vec<(String, Value)>,
    pub(crate) file: PathBuf,
}

impl PartialEq for AsWritten {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl AsWritten {
    /// These and others, which are put back later.
    pub(crate) fn and(mut self, later: Vec<(String, Value)>) -> Self {
        self.lists.extend(later);
        self
    }

    /// Puts these lists back, so that arrays of another size can have them.
    pub(crate) fn restore(&self, table: &mut Table) {
        for (key, value) in &self.lists {
            // A key that is gone did not name a list.
            let _ = assign(table, key, value.clone());
        }
    }
}

/// The bounds that may be infinite, which is no bound.
pub(crate) const BOUNDS: [&str; 8] = [
    "control.state_low",
    "control.state_high",
    "control.output_low",
    "control.output_high",
    "control.increment_low",
    "control.increment_high",
    "control.estimator.low",
    "control.estimator.high",
];

/// What there is one number of per variable.
const PER_STATE: [&str; 19] = [
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
    "control.uncertainty.process_sd",
    "identify.initial_state",
    "identify.fixed_initial_state",
];
const PER_INPUT: [&str; 15] = [
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
    "control.first_plan.input",
];
const PER_OUTPUT: [&str; 3] =
    ["control.output_low", "control.output_high", "control.output_softness.penalty"];
const PER_CONTROLLED: [&str; 4] =
    ["control.q", "control.q_terminal", "control.settled_within", "control.references.*.value"];
const PER_MEASURED: [&str; 2] =
    ["control.measurement.noise_sd", "control.estimator.measurement_sd"];
const PER_DISTURBANCE: [&str; 2] =
    ["control.estimator.disturbance_sd", "control.estimator.disturbance_initial_sd"];
const PER_IDENTIFIED: [&str; 1] = ["identify.measurement_sd"];

/// Tables with a value for some names.
const SOME_STATES: [&str; 7] = [
    "control.end_state",
    "control.error_tolerance",
    "training.proven_tolerance",
    "control.loads.*.rates",
    "control.uncertainty.boxes",
    "control.bound_schedule.*.state_low",
    "control.bound_schedule.*.state_high",
];
const SOME_INPUTS: [&str; 3] = [
    "control.loads.*.inputs",
    "control.bound_schedule.*.input_low",
    "control.bound_schedule.*.input_high",
];
const SOME_OUTPUTS: [&str; 2] =
    ["control.bound_schedule.*.output_low", "control.bound_schedule.*.output_high"];

/// Writes the lists of a resolved config out, one entry per element.
pub(crate) fn write_out(table: &mut Table, plants: &Plants) -> Checked<AsWritten> {
    let Some((equations, [states, inputs, outputs])) = named(table, plants)? else {
        return Ok(AsWritten::default());
    };
    let readable = [&states[..], &outputs].concat();
    let all = [&readable[..], &inputs].concat();
    let mut lists = Lists { equations, table, written: Vec::new() };
    let controlled = lists.names("control.controlled", &all)?.unwrap_or_default();
    lists.names("control.periodic", &states)?;
    lists.names("control.integer", &inputs)?;
    let identified = lists.names("identify.measured", &readable)?;
    let identified = identified.unwrap_or_else(|| Entries::of(&states));
    let measured = lists.names("control.measurement.measured", &readable)?;
    let measured = measured.unwrap_or_else(|| Entries::of(&states));
    let disturbed = lists.names("control.estimator.disturbance.states", &states)?;
    let disturbed = disturbed.or_else(|| {
        match lists.table.get("control")?.get("estimator")?.get("disturbance")?.as_str()? {
            "input" => Some(Entries::of(&inputs)),
            "output" => Some(measured.clone()),
            _ => None,
        }
    });
    lists.numbers(&PER_STATE, &Entries::of(&states))?;
    lists.numbers(&PER_INPUT, &Entries::of(&inputs))?;
    lists.numbers(&PER_OUTPUT, &Entries::of(&outputs))?;
    lists.numbers(&PER_CONTROLLED, &controlled)?;
    lists.numbers(&PER_MEASURED, &measured)?;
    lists.numbers(&PER_DISTURBANCE, &disturbed.unwrap_or_default())?;
    lists.numbers(&PER_IDENTIFIED, &identified)?;
    lists.tables(&SOME_STATES, &states);
    lists.tables(&SOME_INPUTS, &inputs);
    lists.tables(&SOME_OUTPUTS, &outputs);
    Ok(AsWritten { lists: lists.written, ..AsWritten::default() })
}

/// Refuses lists per output of a plant whose file has the outputs in another order than the plant,
/// which has them in that of their names.
pub(crate) fn in_one_order(layers: &Layers) -> Result<(), ConfigError> {
    let tables = ["plant.expression.outputs", "plant.expression.algebraic"];
    let mut pairs = PER_OUTPUT.iter().flat_map(|key| tables.map(|table| (key, table)));
    pairs.try_for_each(|(key, table)| layers.in_order_of_keys(key, table))
}

/// The names of a plant with arrays, or of any plant if a list is written by name.
fn named(table: &mut Table, plants: &Plants) -> Checked<Option<Named>> {
    let by_name = has_tables(table);
    let plant = table.get("plant").cloned();
    let plant = plant.filter(|plant| by_name || plant.get("expression").is_some());
    // Lists by name cannot be read without the names, and would be complained of before the plant.
    let alone = Value::Table(plant.map(|plant| ("plant".to_owned(), plant)).into_iter().collect());
    let mut read: BTreeMap<String, PlantSpec> =
        serde_path_to_error::deserialize(alone).map_err(|error| explain(&error))?;
    let Some(mut plant) = read.remove("plant") else { return Ok(None) };
    plant.bind(plants);
    if let PlantSpec::Expression(equations) = plant {
        let variables =
            equations.variables().map_err(|error| validate::expression_finding("plant", error))?;
        let is_element = |variable: &Variable| Variable::split_name(&variable.name).is_some();
        let has_arrays = variables.iter().flatten().any(is_element);
        let [states, inputs, mut outputs] = variables.each_ref().map(|of| names(of));
        outputs.retain(|output| !states.contains(output));
        return Ok((by_name || has_arrays).then_some((Some(equations), [states, inputs, outputs])));
    }
    if matches!(plant, PlantSpec::Own(_)) && plant.equations().is_none() {
        return Ok(None);
    }
    let variables = plant.variables();
    let outputs = variables.own_output_names();
    Ok(Some((None, [variables.state_names(), variables.input_names(), outputs])))
}

/// Whether a list is written as a table.
fn has_tables(table: &mut Table) -> bool {
    let lists: [&[&str]; 7] = [
        &PER_STATE,
        &PER_INPUT,
        &PER_OUTPUT,
        &PER_CONTROLLED,
        &PER_MEASURED,
        &PER_DISTURBANCE,
        &PER_IDENTIFIED,
    ];
    let keys: Vec<String> =
        lists.into_iter().flatten().flat_map(|key| places(table, key)).collect();
    keys.iter().any(|key| at(table, key).is_some_and(|value| value.is_table()))
}

/// The keys that `list.*.key` stands for: one per item of the list.
fn places(table: &mut Table, key: &str) -> Vec<String> {
    let Some((list, rest)) = key.split_once(".*.") else { return vec![key.to_owned()] };
    let items = at(table, list).and_then(|list| list.as_array()).map_or(0, Vec::len);
    (0..items).map(|i| format!("{list}.{i}.{rest}")).collect()
}

/// What a list has one number for, with the places of each array among them.
#[derive(Clone, Debug, Default)]
struct Entries {
    names: Vec<String>,
    groups: Vec<Range<usize>>,
}

impl Entries {
    fn of(names: &[String]) -> Self {
        Self { names: names.to_vec(), groups: Variable::groups(names) }
    }
}

/// The number for a name that a table does not have, where there is one.
fn default_of(key: &str) -> Option<f64> {
    match key {
        "control.q" | "control.q_terminal" | "control.r" => Some(0.0),
        _ if BOUNDS.contains(&key) => {
            Some(if key.ends_with("low") { f64::NEG_INFINITY } else { f64::INFINITY })
        }
        _ => None,
    }
}

struct Lists<'a> {
    equations: Option<Equations>,
    table: &'a mut Table,
    written: Vec<(String, Value)>,
}

impl Lists<'_> {
    /// A list of names, in which `T` stands for all elements of an array and `T[n]` or `T[2..n]`
    /// for some: the places that each entry has in the new list. None if there is no such list.
    fn names(&mut self, key: &str, known: &[String]) -> Checked<Option<Entries>> {
        let Some(Value::Array(list)) = at(self.table, key) else { return Ok(None) };
        let (mut all, mut groups) = (Vec::new(), Vec::new());
        for entry in &*list {
            let text = entry.as_str().unwrap_or_default();
            let range = self.equations.as_ref().and_then(|equations| equations.indices(text));
            let is_meant = |name: &&String| {
                Variable::split_name(name).is_some_and(|(array, index)| match &range {
                    Some((of, range)) => array == *of && range.contains(&index),
                    None => array == text,
                })
            };
            let elements = known.iter().filter(is_meant).map(|name| Value::String(name.clone()));
            let elements: Vec<Value> = elements.collect();
            let is_known = match range {
                Some((_, range)) => elements.len() >= range.count().max(1),
                None => !elements.is_empty() || text.is_empty() || known.iter().any(|n| n == text),
            };
            if !is_known {
                let key = in_errors(&format!("{key}.{}", groups.len()));
                return Err((key, Problem::word(text, known)));
            }
            let start = all.len();
            all.extend(if elements.is_empty() { vec![entry.clone()] } else { elements });
            groups.push(start..all.len());
        }
        let names = all.iter().map(|name| name.as_str().unwrap_or_default().to_owned()).collect();
        if all != *list {
            let old = std::mem::replace(list, all);
            self.written.push((key.to_owned(), Value::Array(old)));
        }
        Ok(Some(Entries { names, groups }))
    }

    fn numbers(&mut self, keys: &[&str], entries: &Entries) -> Checked<()> {
        for key in keys {
            for key in places(self.table, key) {
                self.by_name(&key, &entries.names)?;
                self.list(&key, &entries.groups)?;
            }
        }
        Ok(())
    }

    /// Gives each element of an array the value that a table has for the array.
    fn tables(&mut self, keys: &[&str], names: &[String]) {
        for key in keys {
            for key in places(self.table, key) {
                let Some(Value::Table(given)) = at(self.table, &key) else { continue };
                let old = given.clone();
                for name in names {
                    let Some((array, _)) = Variable::split_name(name) else { continue };
                    let Some(value) = old.get(array) else { continue };
                    given.remove(array);
                    given.entry(name.clone()).or_insert_with(|| value.clone());
                }
                if *given != old {
                    self.written.push((key, Value::Table(old)));
                }
            }
        }
    }

    /// Makes a list of a table by name, in which `T` stands for all elements of an array.
    fn by_name(&mut self, key: &str, names: &[String]) -> Checked<()> {
        let Some(Value::Table(given)) = at(self.table, key) else { return Ok(()) };
        let default = default_of(key).map(Value::Float);
        let mut all = vec![default; names.len()];
        for (name, value) in &*given {
            let is_meant = |of: &String| {
                of == name || Variable::split_name(of).is_some_and(|(array, _)| array == name)
            };
            let mut places = (0..names.len()).filter(|i| is_meant(&names[*i])).peekable();
            if places.peek().is_none() {
                return Err((in_errors(key), Problem::word(name, names)));
            }
            for place in places {
                all[place] = Some(value.clone());
            }
        }
        if let Some(missing) = all.iter().position(Option::is_none) {
            let found = format!("a table without `{}`", names[missing]);
            let expected = format!("a value for each of {}", names.join(", "));
            return Err((in_errors(key), Problem::Value { found, expected }));
        }
        let all = Value::Array(all.into_iter().flatten().collect());
        if let Some(table) = at(self.table, key) {
            self.written.push((key.to_owned(), std::mem::replace(table, all)));
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
                    let (per, names) = ("element of the array", Vec::new());
                    let problem = Problem::Length { found, expected, per, names };
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
