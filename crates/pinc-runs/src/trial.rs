//! The parts of a sweep: trainings that trials share, and trials.

use super::{Options, Plan, Stages, Threads, read_model};
use crate::RunError;
use pinc_config::Experiment;
use pinc_record::{Invocation, Provenance, RecordError, RunDir, file};
use std::path::Path;

/// Trains the net of `experiment` in the run directory `dir`, on these threads, or resumes
/// the training that is there; `begun` is the invocation that asks for it.
///
/// # Errors
///
/// [`RunError`] if the training fails or is interrupted, or a file cannot be read or written.
pub fn train_shared(
    experiment: &Experiment,
    dir: &Path,
    begun: &Invocation,
    threads: &Threads<'_>,
    options: &Options<'_>,
) -> Result<(), RunError> {
    let mut run_dir = RunDir::open(dir, experiment, std::process::id())?.without_traces();
    let plan = Plan { trains: true, runs_free: false, loops: Vec::new(), given: None };
    if !plan.is_done(experiment, run_dir.metrics()) {
        run_dir.write_provenance(&Provenance::of(experiment, begun.clone()), true)?;
    }
    let train = |run_dir: &mut RunDir| {
        Stages { experiment, options, plan: &plan, threads: Some(threads), run_dir }.run()
    };
    match train(&mut run_dir) {
        // A checkpoint of no use: nobody asked for it by name, so the training begins anew.
        Err(RunError::Record(RecordError::Checkpoint { .. })) => {
            run_dir.remove(file::CHECKPOINT)?;
            train(&mut run_dir)
        }
        outcome => outcome,
    }
}

/// Runs a trial in its directory, which holds nothing yet, with the net of the run directory `net`
/// if it needs one.
///
/// # Errors
///
/// As [`train_shared`].
pub fn run_trial(
    experiment: &Experiment,
    net: Option<&Path>,
    run_dir: &mut RunDir,
    options: &Options<'_>,
) -> Result<(), RunError> {
    let mut plan = Plan { trains: false, runs_free: false, loops: Vec::new(), given: None };
    if let Some(control) = &experiment.control {
        plan.loops.clone_from(&control.models);
    }
    if let Some(dir) = net {
        let trained = RunDir::existing(dir)?;
        run_dir.update(|all| {
            all.training.clone_from(&trained.metrics().training);
            all.validation.clone_from(&trained.metrics().validation);
        })?;
        plan.runs_free = experiment.prediction.is_some();
        if plan.runs_free || !plan.loops.is_empty() {
            plan.given = Some((Vec::new(), read_model(&trained.path(file::MODEL))?));
        }
    }
    Stages { experiment, options, plan: &plan, threads: None, run_dir }.run()
}
