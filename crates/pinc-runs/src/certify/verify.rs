//! The certificate in a model file, checked.

use crate::certify::variables;
use crate::invocation::cores;
use crate::proof::{Attempt, Certificate, attempt, matching, tolerances};
use crate::{Options, RunError, read_matching_model};
use pinc_config::Experiment;
use pinc_net::{Domain, PincNet};
use std::path::Path;

/// Boxes that are cut elsewhere, since roundings differ, change bounds by less.
const SLACK: f64 = 1.01;

/// Checks that the certificate in the file `model` is of this net, its domain and this equation and
/// gives what the config asks for, and proves its bounds anew.
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
    agrees(experiment, &net, &found).map_err(&refused)?;
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

/// Checks that a certificate holds in all of the config's `[domain]`, and proves the errors to be within
/// `training.proven_tolerance`.
fn agrees(experiment: &Experiment, net: &PincNet, found: &Certificate) -> Result<(), String> {
    let own = experiment.domain.iter().flat_map(Domain::ends);
    for (name, (low, high)) in variables(net).into_iter().zip(own) {
        if let Some([from, to]) = found.domain.get(&name).filter(|[a, b]| low < *a || high > *b) {
            return Err(format!(
                "the certificate is of {name} from {from} to {to}; [domain] has {low} to {high}"
            ));
        }
    }
    for (state, most) in experiment.training.iter().flat_map(|of| &of.proven_tolerance) {
        if let Some(bound) = found.proven.get(state).filter(|bound| *bound > most) {
            return Err(format!(
                "the error of {state} is proven to be at most {bound:.3e}; \
                 training.proven_tolerance.{state} asks for {most}"
            ));
        }
    }
    Ok(())
}

/// Whether the bounds of `found` equal the bounds of `again`, but for what other instruction sets round
/// otherwise.
fn is_covered(again: &Certificate, found: &Certificate) -> bool {
    let stated = |state: &String| found.proven.get(state).copied().unwrap_or(0.0);
    again.proven.iter().all(|(state, bound)| *bound <= SLACK * stated(state))
}
