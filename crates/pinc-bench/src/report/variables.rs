//! Which columns of a run's files are states and inputs, and which states are controlled.

use super::data::Run;
use super::table::Table;

/// The plant's variables, as the files name them.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Variables {
    /// The states, in the plant's order.
    pub(super) states: Vec<String>,
    /// The inputs, in the plant's order.
    pub(super) inputs: Vec<String>,
    /// The states that follow a reference.
    pub(super) controlled: Vec<String>,
}

impl Variables {
    /// Finds the variables of a run: the closed loop's columns are the states, the inputs, the
    /// references; the free run's have a truth for each state.
    pub(super) fn of(run: &Run) -> Self {
        let predicted = run.prediction.as_ref().map(states_of_prediction);
        let Some(table) = run.control.first().map(|run| &run.table) else {
            let states = predicted.unwrap_or_default();
            return Self { states, ..Self::default() };
        };
        let headers = table.headers().iter();
        let references = headers.clone().filter_map(|h| h.strip_suffix("_ref"));
        let controlled: Vec<String> = references.map(str::to_owned).collect();
        let plain = headers.filter(|h| *h != "t" && !h.ends_with("_ref"));
        let plain: Vec<String> = plain.cloned().collect();
        let states = match predicted {
            Some(states) if !states.is_empty() => states.len(),
            _ => plain.len().saturating_sub(input_count(run, &plain)),
        };
        let (states, inputs) = plain.split_at(states.min(plain.len()));
        Self { states: states.to_vec(), inputs: inputs.to_vec(), controlled }
    }

    /// The place of a state in the plant's order.
    pub(super) fn index_of(&self, state: &str) -> usize {
        self.states.iter().position(|s| s == state).unwrap_or(0)
    }

    /// The states divided into panels: the controlled ones, and the others.
    pub(super) fn panels_of(&self, states: &[String]) -> Vec<(String, Vec<String>)> {
        let is_controlled = |s: &&String| self.controlled.contains(s);
        let (first, rest): (Vec<_>, Vec<_>) = states.iter().partition(is_controlled);
        let owned = |group: Vec<&String>| group.into_iter().cloned().collect::<Vec<_>>();
        if first.is_empty() || rest.is_empty() {
            return vec![("States".to_owned(), states.to_vec())];
        }
        vec![
            ("Controlled states".to_owned(), owned(first)),
            ("Other states".to_owned(), owned(rest)),
        ]
    }
}

/// The columns that have a `<column>_truth` beside them.
pub(super) fn states_of_prediction(table: &Table) -> Vec<String> {
    let states = table.headers().iter();
    states.filter(|h| table.has(&format!("{h}_truth"))).cloned().collect()
}

/// The number of inputs: what the config's bounds say, or else the columns at the end that begin
/// with u.
fn input_count(run: &Run, columns: &[String]) -> usize {
    let bounds = run.setting(&["control", "input_low"]);
    let listed = bounds.and_then(toml::Value::as_array).map(Vec::len);
    listed.unwrap_or_else(|| columns.iter().rev().take_while(|c| c.starts_with('u')).count())
}
