//! The results that a resumed run finds in its directory; those without their files are made again.

use super::Plan;
use crate::RunError;
use pinc_record::{RunDir, file};

/// Forgets those results whose files are missing or not what they were.
pub(super) fn forget_damaged(plan: &Plan, run_dir: &mut RunDir) -> Result<(), RunError> {
    if plan.trains && run_dir.metrics().training.is_some() && !has_training(run_dir) {
        run_dir.update(|all| {
            (all.training, all.validation, all.prediction) = (None, None, None);
            (all.control, all.one_step) = (Vec::new(), Vec::new());
        })?;
        run_dir.remove(file::CHECKPOINT)?;
    }
    if run_dir.metrics().prediction.is_some() && !run_dir.is_as_noted(file::PREDICTION) {
        run_dir.update(|all| all.prediction = None)?;
    }
    if !has_loops(run_dir) {
        run_dir.update(|all| all.control.clear())?;
    }
    Ok(())
}

fn has_training(run_dir: &RunDir) -> bool {
    run_dir.is_as_noted(file::MODEL) && run_dir.is_as_noted(file::TRAINING)
}

/// Whether the loops that are done have their files.
fn has_loops(run_dir: &RunDir) -> bool {
    let done = &run_dir.metrics().control;
    let names = [file::control, file::steps];
    let files = done.iter().flat_map(|of| names.map(|name| name(of.model, done.len())));
    let judged = run_dir.metrics().files.contains_key(file::MODEL_ERROR);
    let mut files = files.chain(judged.then(|| file::MODEL_ERROR.to_owned()));
    files.all(|name| run_dir.is_as_noted(&name))
}
