//! Training until the error of a step is proven, and the certificate of it in the model file.

use crate::RunError;
use crate::certify::{ends, variables};
use crate::progress::{Stage, Verbosity};
use pinc_check::step_error;
use pinc_config::{Experiment, NetErrorSpec, sha256};
use pinc_net::{PincNet, Points};
use pinc_record::ByName;
use pinc_verify::{Bracket, Search, SearchSettings, StepError, StepModel};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// An error found that is larger than this part of its tolerance asks for more training: a proof
/// would take long.
const MARGIN: f64 = 0.9;

/// The worst points that are added to the sample in a round, each at so many times.
const WORST: usize = 128;
const TIMES: usize = 4;

/// What is proven of the net in a model file, over its whole domain.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Certificate {
    /// The version of the program that proved it.
    pub version: String,
    /// SHA-256 of the model file without the certificate, in hexadecimal digits.
    pub net: String,
    /// SHA-256 of the equation, as a list of operations, in hexadecimal digits.
    pub equation: String,
    /// What was asked for, by state in its unit.
    pub tolerance: ByName,
    /// The absolute error of one step, by state in its unit, is nowhere larger.
    pub proven: ByName,
    /// The domain: the ends of each state, input and parameter.
    pub domain: BTreeMap<String, [f64; 2]>,
    /// Boxes that were enclosed for the proof.
    pub boxes: u64,
}

impl std::fmt::Display for Certificate {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "proven: one step is off by at most")?;
        for (i, (state, bound)) in self.proven.iter().enumerate() {
            write!(f, "{} {state} {bound:.3e}", if i == 0 { "" } else { "," })?;
        }
        write!(f, " everywhere in")?;
        for (i, (name, [low, high])) in self.domain.iter().enumerate() {
            write!(f, "{} {name} {low} to {high}", if i == 0 { "" } else { "," })?;
        }
        Ok(())
    }
}

/// The step of `net` beside the flow of the experiment's equation; an error that names `command` if
/// it cannot be enclosed.
fn net_error(
    experiment: &Experiment,
    net: &PincNet,
    command: &'static str,
) -> Result<StepError, RunError> {
    let varying: Vec<&str> = net.parameter_names().collect();
    let error = step_error(&experiment.plant, &varying, StepModel::Net(net), net.sample_time_s());
    error.map_err(|reason| RunError::usage(&experiment.name, format!("{command}: {reason}")))
}

/// SHA-256 of the equation that `net` stands for, as a list of operations; none for a plant that
/// cannot be listed.
pub(crate) fn equation(experiment: &Experiment, net: &PincNet) -> Option<String> {
    let varying: Vec<&str> = net.parameter_names().collect();
    let listing = experiment.plant.equations()?.listing(&varying).ok()?;
    Some(sha256(format!("{listing:?}")))
}

/// A tolerance per state of the net; infinite for states that are not named.
pub(crate) fn tolerances(net: &PincNet, named: &BTreeMap<String, f64>) -> Vec<f64> {
    let of = |state: &String| named.get(state).copied().unwrap_or(f64::INFINITY);
    net.state_names().iter().map(of).collect()
}

/// What an attempt to prove has come to.
pub(crate) enum Attempt {
    Proven(Box<Certificate>),
    /// There are errors beyond the tolerance, or nearly.
    Refuted,
    /// The boxes have become as small as they may: nothing is proven in this share of the domain.
    Open(f64),
}

/// Tries to prove that no error of `net` is larger than `tolerance` anywhere in its domain.
pub(crate) fn attempt(
    experiment: &Experiment,
    net: &PincNet,
    tolerance: &[f64],
    (threads, verbosity): (usize, Verbosity),
    is_interrupted: &dyn Fn() -> Result<(), RunError>,
) -> Result<Attempt, RunError> {
    let error = net_error(experiment, net, "training.proven_tolerance")?;
    let domain = ends(net.domain());
    let settings =
        SearchSettings { tolerance: Some(tolerance.to_vec()), ..SearchSettings::default() };
    let found = Search::new(&error, &domain, settings, threads);
    let mut search = found.map_err(|error| not_proven(experiment, &error.to_string()))?;
    let is_near = |bracket: &Bracket| {
        let mut pairs = bracket.found.iter().zip(tolerance);
        pairs.any(|(found, most)| found.error > MARGIN * most)
    };
    if is_near(&search.bracket()) {
        return Ok(Attempt::Refuted);
    }
    let mut stage = Stage::begin(verbosity, "proof", 0);
    while !search.is_over() && !search.is_refuted() {
        is_interrupted()?;
        search.round(&error, threads);
        let bracket = search.bracket();
        stage.set_total(bracket.leaves as u64);
        stage.advance(bracket.settled as u64, || format!("{} boxes", bracket.boxes));
    }
    let bracket = search.bracket();
    stage.end(&format!("{} boxes", bracket.boxes));
    if search.is_refuted() {
        return Ok(Attempt::Refuted);
    }
    if !bracket.is_complete {
        return Ok(Attempt::Open(bracket.unproven_volume));
    }
    let states = net.state_names().iter().cloned();
    let asked = states.clone().zip(tolerance.iter().copied());
    Ok(Attempt::Proven(Box::new(Certificate {
        version: crate::VERSION.to_owned(),
        net: hash_of(net),
        equation: equation(experiment, net).unwrap_or_default(),
        tolerance: asked.filter(|(_, most)| most.is_finite()).collect(),
        proven: states.zip(bracket.proven).collect(),
        domain: variables(net).into_iter().zip(domain).collect(),
        boxes: bracket.boxes,
    })))
}

/// Points of the sample where the errors of `net` are worst, at times over the whole step.
pub(crate) fn worst_points(
    experiment: &Experiment,
    net: &PincNet,
    tolerance: &[f64],
    seed: u64,
    threads: usize,
) -> Result<Points, RunError> {
    let error = net_error(experiment, net, "training.proven_tolerance")?;
    let domain = ends(net.domain());
    let (n, m) = (net.state_names().len(), net.input_names().len());
    let mut points = Points::new(net.dims());
    for point in error.worst_points(&domain, WORST, tolerance, seed, threads) {
        let (x, rest) = point.split_at(n);
        let (u, p) = rest.split_at(m);
        for k in 1..=TIMES {
            let share = k as f64 / TIMES as f64;
            points.push(share * net.sample_time_s(), x, u, p);
        }
    }
    Ok(points)
}

/// SHA-256 of the model file of `net` without a certificate, in hexadecimal digits.
fn hash_of(net: &PincNet) -> String {
    let mut bare = net.clone();
    bare.certificate = None;
    sha256(bare.to_bytes())
}

/// `net` with a certificate.
///
/// # Panics
///
/// Never: a certificate has a JSON text.
#[must_use]
pub(crate) fn certified(mut net: PincNet, certificate: &Certificate) -> PincNet {
    let text = serde_json::to_string(certificate).expect("a certificate has a JSON text");
    net.certificate = Some(text);
    net
}

/// The certificate of a net, if it has one that can be read and is of this net.
#[must_use]
pub fn certificate(net: &PincNet) -> Option<Certificate> {
    let found: Certificate = serde_json::from_str(net.certificate.as_deref()?).ok()?;
    (found.net == hash_of(net)).then_some(found)
}

/// The certificate of `net`, which must be of this net, of its domain and of the experiment's
/// equation; why there is none otherwise.
pub(crate) fn matching(experiment: &Experiment, net: &PincNet) -> Result<Certificate, String> {
    let found = certificate(net).ok_or_else(|| match &net.certificate {
        None => "the net has no certificate; training.proven_tolerance makes one".to_owned(),
        Some(_) => "the certificate is of another net".to_owned(),
    })?;
    let domain: BTreeMap<String, [f64; 2]> =
        variables(net).into_iter().zip(ends(net.domain())).collect();
    for (what, same) in [
        ("equation", equation(experiment, net).as_ref() == Some(&found.equation)),
        ("domain", found.domain == domain),
    ] {
        if !same {
            return Err(format!("the certificate is of another {what}"));
        }
    }
    Ok(found)
}

/// Whether the config asks for the proven error of its net.
fn is_wanted(experiment: &Experiment) -> bool {
    let uncertainty = experiment.control.as_ref().and_then(|control| control.uncertainty.as_ref());
    uncertainty.is_some_and(|of| of.net_error == NetErrorSpec::PROVEN)
}

fn refused(experiment: &Experiment, reason: &str) -> RunError {
    let problem = format!("control.uncertainty.net_error = \"proven\": {reason}");
    RunError::usage(&experiment.name, problem)
}

/// Checks that there is a proven error where the config asks for it, of the net that is `given` or
/// else trained.
pub(crate) fn check_ahead(
    experiment: &Experiment,
    given: Option<&PincNet>,
) -> Result<(), RunError> {
    let training = experiment.training.as_ref().filter(|_| given.is_none());
    if is_wanted(experiment) && training.is_some_and(|of| of.proven_tolerance.is_empty()) {
        return Err(refused(experiment, "it needs training.proven_tolerance"));
    }
    limits(experiment, given).map(|_| ())
}

/// The error that a net is not proven to be within `training.proven_tolerance`.
pub(crate) fn not_proven(experiment: &Experiment, reason: &str) -> RunError {
    RunError::Failed(format!("{}: training.proven_tolerance: {reason}", experiment.name))
}

/// The error of a step of `net`, by state in its unit, that `net_error = "proven"` takes from its
/// certificate; none where the config does not ask for it.
///
/// # Errors
///
/// [`RunError`] if the net has no such certificate.
pub(crate) fn limits(
    experiment: &Experiment,
    net: Option<&PincNet>,
) -> Result<Option<Vec<f64>>, RunError> {
    let Some(net) = net.filter(|_| is_wanted(experiment)) else { return Ok(None) };
    let found = matching(experiment, net).map_err(|reason| refused(experiment, &reason))?;
    let bound = |state: &String| found.proven.get(state).copied().unwrap_or(f64::INFINITY);
    Ok(Some(net.state_names().iter().map(bound).collect()))
}
