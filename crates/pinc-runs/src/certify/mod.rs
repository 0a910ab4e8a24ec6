//! `pinc certify`: what is known, and what is proven, of the errors of one step of a model.

mod domain;
mod points;
mod subject;
mod verify;

use super::Options;
use crate::RunError;
use crate::invocation::{cores, invocation};
use pinc_config::{Experiment, ModelKind};
use pinc_net::{Domain, PincNet};
use pinc_record::{CertificateMetrics, CsvText, Provenance, RunDir, file, number};
use points::{Judged, random, read_points};
use std::path::{Path, PathBuf};
use subject::Subject;
pub use verify::verify_certificate;

/// The settings of `pinc certify`.
#[derive(Clone, Debug)]
pub struct Certify {
    /// Random points of the domain; none for a default, which is 0 with other points.
    pub points: Option<usize>,
    /// A CSV file whose rows are points.
    pub data: Option<PathBuf>,
    /// The directory of a run, whose closed loop gives points.
    pub run: Option<PathBuf>,
    /// Whether the whole domain is searched.
    pub domain: bool,
    /// The time for that in s; none for as long as it takes.
    pub budget_s: Option<f64>,
}

/// The ends of the states, inputs and parameters of a domain.
pub(crate) fn ends(domain: &Domain) -> Vec<[f64; 2]> {
    domain.ends().map(|(low, high)| [low, high]).collect()
}

/// The names of a net's states, inputs and parameters.
pub(crate) fn variables(net: &PincNet) -> Vec<String> {
    let names = net.state_names().iter().chain(net.input_names()).map(String::as_str);
    names.chain(net.parameter_names()).map(str::to_owned).collect()
}

/// Random points if nothing else is asked for.
const POINTS: usize = 1000;

/// Points that are judged between two looks at Ctrl-C.
const AT_ONCE: usize = 1024;

/// The most points.
const MOST_POINTS: usize = 1_000_000;

/// With what probability a statistical bound holds.
const CONFIDENCE: f64 = 0.99;

/// The quantiles that are bounded.
const QUANTILES: [(&str, f64); 3] = [("0.5", 0.5), ("0.9", 0.9), ("0.99", 0.99)];

/// Judges one step of the net in the file `model`, or of the integrator `only`, and writes
/// `certify.csv` and `certify.json` to `dir`.
///
/// # Errors
///
/// [`RunError`], naming the file, the key or the reason.
pub fn certify(
    experiment: &Experiment,
    dir: &Path,
    options: &Options<'_>,
    (model, only): (Option<&Path>, Option<ModelKind>),
    what: &Certify,
) -> Result<CertificateMetrics, RunError> {
    let subject = Subject::of(experiment, model, only)?;
    let others = what.data.is_some() || what.run.is_some();
    let count = what.points.unwrap_or(if others { 0 } else { POINTS });
    if count > MOST_POINTS {
        let problem = format!("certify: {count} points given, expected {MOST_POINTS} at most");
        return Err(RunError::usage(&experiment.name, problem));
    }
    let drawn = random(&subject.domain, count, experiment.seed);
    let mut all = drawn.clone();
    if let Some(path) = &what.data {
        all.extend(read_points(path, &subject.variables())?);
    }
    if let Some(run) = &what.run {
        all.extend(subject.along(experiment, run)?);
    }
    let mut run_dir = RunDir::open(dir, experiment, std::process::id())?;
    let provenance = Provenance::of(experiment, invocation(options.arguments));
    run_dir.write_provenance(&provenance, options.resume)?;
    let threads = cores();
    let mut judged = Vec::new();
    for points in all.chunks(AT_ONCE) {
        options.check_interrupt(run_dir.dir())?;
        judged.extend(subject.judge(points, threads)?);
    }
    run_dir.write(file::CERTIFY_POINTS, table(&subject, &all, &judged).as_bytes())?;
    let mut metrics = metrics(experiment, &subject, &judged, drawn.len());
    let differences = subject.estimate_differences(&all, &judged)?;
    let quantile = |share: usize| differences.get(differences.len() * share / 100).copied();
    metrics.estimate_difference_median = quantile(50);
    metrics.estimate_difference_p99 = quantile(99);
    if let (true, Ok(error)) = (what.domain, &subject.error) {
        match domain::search(&subject, error, &run_dir, options, what.budget_s)? {
            Ok(mut found) => {
                domain::see_points(&mut found, &subject, &all, &judged);
                metrics.domain = Some(found);
            }
            Err(reason) => metrics.refused = Some(reason),
        }
    }
    if let (true, true, Some(reason)) = (what.domain, all.is_empty(), &metrics.refused) {
        return Err(RunError::usage(&experiment.name, format!("certify: {reason}")));
    }
    run_dir.write(file::CERTIFY, metrics.to_json().as_bytes())?;
    run_dir.update(|_| {})?;
    Ok(metrics)
}

/// One row per point: states, inputs and parameters, then error and bound of each state.
fn table(subject: &Subject, points: &[Vec<f64>], judged: &[Judged]) -> CsvText {
    let results = subject.states.iter().flat_map(|s| [format!("{s}_err"), format!("{s}_bound")]);
    let mut table = CsvText::new(subject.variables().into_iter().chain(results));
    for (point, judged) in points.iter().zip(judged) {
        let cell = |value: Option<f64>| value.map_or(String::new(), number);
        let pairs = judged.error.iter().zip(&judged.bound);
        let results = pairs.flat_map(|(error, bound)| [cell(*error), cell(*bound)]);
        table.push(point.iter().map(|value| number(*value)).chain(results));
    }
    table
}

fn metrics(
    experiment: &Experiment,
    subject: &Subject,
    judged: &[Judged],
    drawn: usize,
) -> CertificateMetrics {
    let ratios = judged.iter().flat_map(|of| of.error.iter().zip(&of.bound));
    let mut ratios: Vec<f64> = ratios
        .filter_map(|(error, bound)| Some(bound.as_ref()? / error.as_ref()?.abs()))
        .filter(|ratio| ratio.is_finite())
        .collect();
    ratios.sort_by(f64::total_cmp);
    let of_state = |i: usize, quantile: f64| {
        let errors = judged[..drawn].iter().map(|of| of.largest(i)).collect();
        pinc_verify::quantile_bound(errors, quantile, CONFIDENCE)
    };
    let of_quantile = |(name, quantile): (&str, f64)| {
        let states = subject.states.iter().enumerate();
        (name.to_owned(), states.map(|(i, state)| (state.clone(), of_state(i, quantile))).collect())
    };
    CertificateMetrics {
        experiment: experiment.name.clone(),
        model: subject.kind.name().to_owned(),
        step_s: subject.sample_time_s,
        points: judged.len(),
        seed: experiment.seed,
        unproven_points: judged.iter().filter(|of| of.bound.contains(&None)).count(),
        bound_over_error_median: ratios.get(ratios.len() / 2).copied(),
        estimate_difference_median: None,
        estimate_difference_p99: None,
        quantiles: QUANTILES.map(of_quantile).into_iter().collect(),
        confidence: CONFIDENCE,
        refused: subject.error.as_ref().err().cloned(),
        domain: None,
    }
}
