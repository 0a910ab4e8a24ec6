//! `pinc check`: the examinations of pinc-check, with the closed loop and the files that they ask
//! for.

mod cost;
mod rehearsal;

use super::data;
use crate::progress::{Stage, Verbosity};
use pinc_check::{Evidence, Finding, Metered, Work};
use pinc_config::Experiment;
use pinc_ode::DynPlant;
use std::cell::RefCell;
use std::path::PathBuf;

/// Examines the plant of a config (which is itself valid, or it would not have loaded) on the
/// training domain, or else within the controller's bounds.
///
/// Its work is limited by counting, so that a config has the same findings on each machine; one of
/// them names what was left out.
#[must_use]
pub fn check(experiment: &Experiment) -> Vec<Finding> {
    check_watched(experiment, Verbosity::Quiet)
}

/// [`check`] with its progress on standard error.
#[must_use]
pub fn check_watched(experiment: &Experiment, verbosity: Verbosity) -> Vec<Finding> {
    examine(&*experiment.plant.dyn_plant(), experiment, verbosity)
}

fn examine(plant: &dyn DynPlant, experiment: &Experiment, verbosity: Verbosity) -> Vec<Finding> {
    let stage = RefCell::new(Stage::begin_late(verbosity, "check"));
    stage.borrow_mut().advance(0, || "the closed loop".to_owned());
    let work = Work::of_a_check();
    let metered = Metered::new(plant, experiment, &work);
    let step_s = experiment.sample_time_s();
    work.begin();
    let rehearsal = experiment.control.as_ref().zip(step_s).map(|(spec, step_s)| {
        rehearsal::rehearse((plant, &metered), (experiment, spec), step_s, &work)
            .map_err(|error| error.to_string())
    });
    work.begin();
    let cost = cost::measure((plant, &metered), experiment);
    let read = |files: &[PathBuf]| {
        let variables = experiment.plant.variables();
        let step_s = experiment.net_step_s().unwrap_or(1.0);
        let data = data::read(&variables, step_s, files);
        data.map(|data| data.measurements).map_err(|error| error.to_string())
    };
    let progress = |topic: &str, done: usize, of: usize| {
        let mut stage = stage.borrow_mut();
        stage.set_total(of as u64);
        stage.advance(done as u64, || topic.to_owned());
    };
    let evidence = Evidence { rehearsal, cost, read: &read, work, progress: &progress };
    let findings = pinc_check::check(plant, experiment, &evidence);
    stage.into_inner().end_late();
    findings
}

#[cfg(test)]
mod tests;
