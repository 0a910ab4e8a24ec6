//! The state of a live controller, to be kept while its process is not there.

use super::live::LiveController;
use crate::RunError;
use pinc_ode::{Memory, Variable};
use serde::{Deserialize, Serialize};

/// What a [`LiveController`] knows from its past: the plan, the inputs under way, the estimate. A
/// controller of the same config that takes it goes on where the other was.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LiveState {
    /// The names of the states.
    states: Vec<String>,
    /// The names of the inputs.
    inputs: Vec<String>,
    /// The names of the disturbances and parameters that are estimated.
    unknowns: Vec<String>,
    /// All numbers; those that are NaN, of missing measurements, are `null` in JSON.
    pub(super) numbers: Vec<Option<f64>>,
}

impl LiveState {
    /// The state as a JSON object.
    #[must_use]
    #[expect(clippy::missing_panics_doc, reason = "names and numbers are JSON")]
    pub fn to_json(&self) -> String {
        serde_json::to_string(self).expect("names and numbers")
    }

    /// The state that [`LiveState::to_json`] gave as `json`.
    ///
    /// # Errors
    ///
    /// [`RunError::Usage`] if it is not of that form.
    pub fn from_json(json: &str) -> Result<Self, RunError> {
        serde_json::from_str(json)
            .map_err(|error| RunError::usage("state", format!("{error}; expected a saved state")))
    }
}

impl LiveController {
    /// What the next step starts from.
    pub fn state(&mut self) -> LiveState {
        let mut numbers = Vec::new();
        self.remember(&mut Memory::save(&mut numbers));
        LiveState {
            states: names(&self.variables().states),
            inputs: names(&self.variables().inputs),
            unknowns: self.unknowns().to_vec(),
            numbers: numbers
                .into_iter()
                .map(|number| Some(number).filter(|n| !n.is_nan()))
                .collect(),
        }
    }

    /// Goes on from the state of another controller of the same config.
    ///
    /// # Errors
    ///
    /// [`RunError::Usage`] if the state is of a controller of other states, inputs, unknowns or
    /// another horizon, or damaged: nothing has happened then.
    pub fn set_state(&mut self, state: &LiveState) -> Result<(), RunError> {
        let before = self.state();
        for (what, found, expected) in [
            ("states", &state.states, &before.states),
            ("inputs", &state.inputs, &before.inputs),
            ("unknowns", &state.unknowns, &before.unknowns),
        ] {
            if found != expected {
                let (found, expected) = (found.join(", "), expected.join(", "));
                let problem = format!("of a controller with the {what} {found}, not {expected}");
                return Err(RunError::usage("state", problem));
            }
        }
        if self.take(state) {
            return Ok(());
        }
        self.take(&before);
        let problem = "of a controller with another horizon or estimator, or damaged";
        Err(RunError::usage("state", problem.to_owned()))
    }

    fn take(&mut self, state: &LiveState) -> bool {
        let numbers = state.numbers.iter().map(|number| number.unwrap_or(f64::NAN));
        let numbers: Vec<_> = numbers.collect();
        let mut memory = Memory::restore(&numbers);
        self.made = None;
        self.remember(&mut memory);
        memory.is_complete()
    }
}

fn names(variables: &[Variable]) -> Vec<String> {
    variables.iter().map(|variable| variable.name.to_string()).collect()
}
