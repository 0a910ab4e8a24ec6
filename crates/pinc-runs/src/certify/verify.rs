//! The certificate in a model file, checked.

use crate::invocation::cores;
use crate::proof::{Attempt, Certificate, attempt, matching, tolerances};
use crate::{Options, RunError, read_matching_model};
use pinc_config::Experiment;
use std::path::Path;

/// Boxes that are cut elsewhere, since roundings differ, change bounds by less.
const SLACK: f64 = 1.01;

/// Checks that the certificate in the file `model` is of this net, this domain and this equation,
/// and proves its bounds anew.
///
/// # Errors
///
/// [`RunError`] if there is no certificate, something has changed, or the proof fails.
pub fn verify_certificate(
    experiment: &Experiment,
    model: &Path,
    options: &Options<'_>,
) -> Result<Certificate, RunError> {
    let refused = |reason: String| {
        let problem = format!("certify --verify: {}: {reason}", model.display());
        RunError::usage(&experiment.name, problem)
    };
    let (_, net) = read_matching_model(experiment, model)?;
    let found = matching(experiment, &net).map_err(&refused)?;
    let check = || match options.interrupt.load(std::sync::atomic::Ordering::Relaxed) {
        true => Err(refused("interrupted".to_owned())),
        false => Ok(()),
    };
    let tolerance = tolerances(&net, &found.tolerance);
    match attempt(experiment, &net, &tolerance, (cores(), options.verbosity), &check)? {
        Attempt::Proven(again) if is_covered(&again, &found) => Ok(found),
        Attempt::Proven(_) | Attempt::Refuted | Attempt::Open(_) => {
            Err(refused("the bounds of the certificate cannot be proven again".to_owned()))
        }
    }
}

/// Whether the bounds of `found` equal the bounds of `again`, but for what other instruction sets round
/// otherwise.
fn is_covered(again: &Certificate, found: &Certificate) -> bool {
    let stated = |state: &String| found.proven.get(state).copied().unwrap_or(0.0);
    again.proven.iter().all(|(state, bound)| *bound <= SLACK * stated(state))
}
