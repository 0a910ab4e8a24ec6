//! The plant's variables: states, inputs, and which states are controlled.

use crate::data::Run;

/// The plant's variables, as the files name them.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Variables {
    /// The states, in the plant's order.
    pub(crate) states: Vec<String>,
    /// The inputs, in the plant's order.
    pub(crate) inputs: Vec<String>,
    /// The states that follow a reference.
    pub(crate) controlled: Vec<String>,
}

impl Variables {
    /// The variables of a run: those of its closed loop, or else of its free run.
    pub(crate) fn of(run: &Run) -> Self {
        if let Some(of) = run.control.first() {
            let (states, inputs) = (of.table.states.clone(), of.table.inputs.clone());
            return Self { states, inputs, controlled: of.table.controlled.clone() };
        }
        let prediction = run.prediction.as_ref();
        prediction.map_or_else(Self::default, |table| Self {
            states: table.states.clone(),
            inputs: table.inputs.clone(),
            controlled: Vec::new(),
        })
    }

    /// The place of a state in the plant's order.
    pub(crate) fn index_of(&self, state: &str) -> usize {
        self.states.iter().position(|s| s == state).unwrap_or(0)
    }

    /// The states divided into panels: the controlled ones, and the others.
    pub(crate) fn panels_of(&self, states: &[String]) -> Vec<(String, Vec<String>)> {
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
