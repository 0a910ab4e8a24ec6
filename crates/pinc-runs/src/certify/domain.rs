//! The search over the whole domain: any-time, and resumable.

use super::points::Judged;
use super::subject::Subject;
use crate::invocation::cores;
use crate::progress::Stage;
use crate::{Options, RunError};
use pinc_config::sha256;
use pinc_record::{ByName, DomainCertificate, RunDir, file, read_text};
use pinc_report::{BoxMap, MapLabels, ValuedBox};
use pinc_verify::{Bracket, Leaf, Search, SearchSettings, StepError};
use serde::{Deserialize, Serialize};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Time between two writings of the search.
const WRITE_EVERY: Duration = Duration::from_secs(10);

/// Cells along an axis of the map.
const CELLS: usize = 48;

/// A search to be resumed.
#[derive(Serialize, Deserialize)]
struct Saved {
    /// The hash of model, equation and domain.
    key: String,
    search: Search,
}

/// Searches the domain until its bounds are good enough or the time is up; a reason where that is impossible.
pub(super) fn search(
    subject: &Subject,
    error: &StepError,
    run_dir: &RunDir,
    options: &Options<'_>,
    budget_s: Option<f64>,
) -> Result<Result<DomainCertificate, String>, RunError> {
    let clock = Instant::now();
    let threads = cores();
    let key = sha256(&subject.key);
    let saved = if options.resume { read(run_dir)? } else { None };
    let mut search = match saved.filter(|saved| saved.key == key) {
        Some(saved) => saved.search,
        None => match Search::new(error, &subject.domain, SearchSettings::default(), threads) {
            Ok(search) => search,
            Err(reason) => return Ok(Err(reason.to_string())),
        },
    };
    let mut stage = Stage::begin(options.verbosity, "certify", 0);
    let mut written = Instant::now();
    let in_time = |clock: &Instant| budget_s.is_none_or(|s| clock.elapsed().as_secs_f64() < s);
    while !search.is_over() && in_time(&clock) {
        search.round(error, threads);
        let bracket = search.bracket();
        stage.set_total(bracket.leaves as u64);
        stage.advance(bracket.settled as u64, || progress(subject, &bracket));
        if written.elapsed() > WRITE_EVERY || options.interrupt.load(Ordering::Relaxed) {
            write(run_dir, &key, &search)?;
            written = Instant::now();
        }
        options.check_interrupt(run_dir.dir())?;
    }
    let bracket = search.bracket();
    stage.end(&progress(subject, &bracket));
    write(run_dir, &key, &search)?;
    if let Some(svg) = map(subject, &search) {
        run_dir.write(file::CERTIFY_MAP, svg.as_bytes())?;
    }
    Ok(Ok(certificate(subject, &bracket)))
}

fn read(run_dir: &RunDir) -> Result<Option<Saved>, RunError> {
    let text = read_text(&run_dir.path(file::CERTIFY_SEARCH))?;
    // A file that cannot be read is made anew.
    Ok(text.and_then(|text| serde_json::from_str(&text).ok()))
}

fn write(run_dir: &RunDir, key: &str, search: &Search) -> Result<(), RunError> {
    let saved = Saved { key: key.to_owned(), search: search.clone() };
    Ok(run_dir.write(file::CERTIFY_SEARCH, serde_json::json!(saved).to_string().as_bytes())?)
}

/// The proven bounds over the domain as a picture.
fn map(subject: &Subject, search: &Search) -> Option<String> {
    let widths: Vec<f64> = subject.domain.iter().map(|[low, high]| high - low).collect();
    let in_widths = |leaf: &Leaf| {
        let bounds = leaf.bounds.iter().map(|(state, bound)| Some((*bound)? / widths[*state]));
        bounds.reduce(|a, b| Some(a?.max(b?)))?
    };
    let valued = |leaf: Leaf| ValuedBox { value: in_widths(&leaf), ends: leaf.ends };
    let boxes: Vec<ValuedBox> = search.leaves().map(valued).collect();
    let labels = MapLabels {
        title: "Proven error of one step",
        value: "log₁₀ of the proven bound (widths)",
        unknown: "nothing is proven",
    };
    let map = BoxMap {
        labels,
        variables: &subject.labels(),
        preferred: subject.states.len(),
        domain: &subject.domain,
        boxes: &boxes,
        cells: CELLS,
        mark: None,
    };
    map.figure()?.0.svg()
}

/// The ratios of proven to found errors.
fn progress(subject: &Subject, bracket: &Bracket) -> String {
    let pairs = subject.states.iter().zip(bracket.proven.iter().zip(&bracket.found));
    let ratios =
        pairs.map(|(state, (proven, found))| format!("{state} {:.2}", proven / found.error));
    let ratios: Vec<_> = ratios.collect();
    format!(
        "{} boxes, proven over found: {}; unproven volume {:.2} %",
        bracket.boxes,
        ratios.join(", "),
        100.0 * bracket.unproven_volume
    )
}

/// Counts the errors at points of the domain among the errors found.
pub(super) fn see_points(
    of: &mut DomainCertificate,
    subject: &Subject,
    points: &[Vec<f64>],
    judged: &[Judged],
) {
    let is_inside = |point: &[f64]| {
        point.iter().zip(&subject.domain).all(|(v, [low, high])| (low..=high).contains(&v))
    };
    for (point, judged) in points.iter().zip(judged).filter(|(point, _)| is_inside(point)) {
        for (state, error) in subject.states.iter().zip(&judged.error) {
            let error = error.map_or(0.0, f64::abs);
            if of.found.get(state).is_some_and(|found| error > *found) {
                of.found.insert(state.clone(), error);
                of.at.insert(state.clone(), named(subject, point));
            }
        }
    }
}

fn named(subject: &Subject, values: &[f64]) -> ByName {
    subject.variables().into_iter().zip(values.iter().copied()).collect()
}

fn certificate(subject: &Subject, bracket: &Bracket) -> DomainCertificate {
    let variables = subject.variables();
    let states = subject.states.iter().cloned();
    let proven = states.clone().zip(bracket.proven.iter().copied());
    DomainCertificate {
        proven: proven.filter(|_| bracket.unproven_volume < 1.0).collect(),
        found: states.clone().zip(bracket.found.iter().map(|found| found.error)).collect(),
        at: states.zip(bracket.found.iter().map(|found| named(subject, &found.at))).collect(),
        unproven_volume: bracket.unproven_volume,
        complete: bracket.is_complete,
        leaves: bracket.leaves,
        boxes: bracket.boxes,
        ends: variables.iter().cloned().zip(subject.domain.iter().copied()).collect(),
    }
}
