//! `pinc check`: the examinations of pinc-check, with the closed loop and the files that they ask
//! for.

mod cost;

use super::control::rehearse;
use super::data;
use pinc_check::{Evidence, Finding};
use pinc_config::Experiment;
use pinc_ode::DynPlant;
use std::path::PathBuf;

/// Examines the plant of a config (which is itself valid, or it would not have loaded) on the
/// training domain, or else within the controller's bounds.
#[must_use]
pub fn check(experiment: &Experiment) -> Vec<Finding> {
    examine(&*experiment.plant.dyn_plant(), experiment)
}

fn examine(plant: &dyn DynPlant, experiment: &Experiment) -> Vec<Finding> {
    let step_s = experiment.sample_time_s();
    let rehearsal = experiment
        .control
        .as_ref()
        .zip(step_s)
        .map(|(spec, step_s)| rehearse(plant, spec, step_s).map_err(|error| error.to_string()));
    let cost = cost::measure(plant, experiment);
    let read = |files: &[PathBuf]| {
        let variables = experiment.plant.variables();
        let step_s = experiment.net_step_s().unwrap_or(1.0);
        let data = data::read(&variables, step_s, files);
        data.map(|data| data.measurements).map_err(|error| error.to_string())
    };
    pinc_check::check(plant, experiment, &Evidence { rehearsal, cost, read: &read })
}

#[cfg(test)]
mod tests;
