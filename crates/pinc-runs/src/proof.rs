//! Training until the error of a step is proven, and the certificate of it in the model file.

use crate::RunError;
use crate::certify::{ends, hash, variables};
use crate::progress::{Stage, Verbosity};
use pinc_check::step_error;
use pinc_config::Experiment;
use pinc_net::{PincNet, Points};
use pinc_record::ByName;
use pinc_verify::{Bracket, Search, SearchSettings, StepError, StepModel};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The key of the certificate in a model file's metadata.
const KEY: &str = "certificate";

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
    Some(hash(format!("{listing:?}").as_bytes()))
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
    let mut search = found.map_err(|error| RunError::NotProven {
        name: experiment.name.clone(),
        reason: error.to_string(),
    })?;
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
        net: hash(&net.to_bytes()),
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
            #[expect(clippy::cast_precision_loss, reason = "a few")]
            let share = k as f64 / TIMES as f64;
            points.push(share * net.sample_time_s(), x, u, p);
        }
    }
    Ok(points)
}

/// The model file of `net` with a certificate in its metadata.
///
/// # Panics
///
/// Never: what [`PincNet::to_bytes`] writes can be read.
#[must_use]
pub fn certified(net: &PincNet, certificate: &Certificate) -> Vec<u8> {
    let bytes = net.to_bytes();
    let (mut header, data) = split(&bytes).expect("a model file that was just made");
    header["__metadata__"][KEY] = serde_json::json!(certificate).to_string().into();
    let mut text = header.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(8), b' ');
    let mut all = (text.len() as u64).to_le_bytes().to_vec();
    all.extend(text);
    all.extend_from_slice(data);
    all
}

/// The header of a safetensors file, and the rest.
fn split(bytes: &[u8]) -> Option<(serde_json::Value, &[u8])> {
    let (length, rest) = bytes.split_first_chunk::<8>()?;
    let length = usize::try_from(u64::from_le_bytes(*length)).ok()?;
    let (header, data) = rest.split_at_checked(length)?;
    Some((serde_json::from_slice(header).ok()?, data))
}

/// The certificate in the bytes of a model file, if there is one that can be read.
#[must_use]
pub fn certificate(bytes: &[u8]) -> Option<Certificate> {
    let (header, _) = split(bytes)?;
    serde_json::from_str(header["__metadata__"][KEY].as_str()?).ok()
}
