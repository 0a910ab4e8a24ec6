//! `pinc choose`: which model should be in a loop.
//!
//! Integrators by their substeps and nets by their size are tried in the loop itself, the best
//! guesses first, and judged by it: by the IAE and the violations of bounds, against those of the
//! most exact integrator, and by the time of a control step. What is tried is a trial of a sweep,
//! run and kept as those are.

mod base;
mod candidate;
mod judge;
mod ladder;
mod recommended;
mod session;
mod summary;

use crate::BenchError;
use crate::runs::{Options, rebuild_report};
use crate::sweep::write_tables;
use base::Base;
use candidate::{Candidate, SHAPES};
use judge::{Standard, Tried};
use ladder::Rung;
use pinc_config::{Experiment, ModelKind, Plants, trials};
use pinc_net::TrainingTarget;
use pinc_record::{RecordError, RunDir, file, write_atomically};
use session::Session;
use std::fs;
use std::path::{Path, PathBuf};

/// The recommended config, and its net.
const RECOMMENDED: &str = "recommended.toml";
const NET: &str = "recommended.safetensors";

/// The directory of the sweep of all that was tried, with its report.
const TRIED: &str = "tried";

/// How many of the cheapest good models have their times measured as often as the config says.
const FINALISTS: usize = 3;

/// The place in [`SHAPES`] of the first net that is tried.
const FIRST_NET: usize = 1;

/// From so many substeps on, the method for stiff plants may be cheaper.
const STIFF: usize = 8;

/// A larger net is not tried where the last one's control step is this many times longer than that
/// of the cheapest good integrator.
const HOPELESS: f64 = 2.0;

/// How good is good enough, and how long may be tried.
#[derive(Clone, Copy, Debug)]
pub struct ChooseOptions {
    /// How much more than the most exact model's a loop's IAE may be, relative.
    pub within: f64,
    /// The time for trying, in s. The last measurements of the best take a little longer.
    pub budget_s: f64,
}

/// What was found; its `Display` is a short table and the advice.
#[derive(Clone, Debug)]
pub struct Choice {
    /// The config with the model to use, in words why.
    pub recommended: PathBuf,
    /// Charts of all that was tried.
    pub report: PathBuf,
    text: String,
}

impl std::fmt::Display for Choice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (config, report) = (self.recommended.display(), self.report.display());
        write!(f, "{}config: {config}\nreport: {report}", self.text)
    }
}

/// Tries models in the closed loop of `experiment`, which may name one of `plants`, and chooses
/// one. Results are in `dir`; those of an earlier call are taken up where `options` say so.
///
/// # Errors
///
/// [`BenchError`] if the config has no closed loop, no loop with an integrator stands, or files
/// cannot be written.
pub fn choose(
    experiment: &Experiment,
    dir: &Path,
    plants: &Plants,
    options: &Options<'_>,
    how: ChooseOptions,
) -> Result<Choice, BenchError> {
    let base = Base::of(experiment, plants)?;
    let mut session = Session::open(&base, dir, plants, options, how.budget_s)?;
    integrators(&mut session, how.within)?;
    let Some(standard) = session.standard(how.within) else { return Err(nothing(&session)) };
    nets(&mut session, &standard)?;
    let standard = finals(&mut session, standard, how.within)?;
    let is_out_of_time = session.is_out_of_time;
    let report = write_report(&session)?;
    let winner = standard.winner(&session.tried).map(|(tried, _)| tried.clone());
    let Some(winner) = winner else { return Err(nothing(&session)) };
    let found = summary::Found {
        tried: &session.tried,
        standard: &standard,
        winner: &winner,
        notes: &base.notes,
        within: how.within,
        is_out_of_time,
    };
    let text = found.to_string();
    let has_net = copy_net(&session, &winner)?;
    let content = recommended::config(experiment, &base, &found, has_net);
    let (_, run_dir) = session.end();
    let recommended = run_dir.path(RECOMMENDED);
    write_atomically(&recommended, content.as_bytes())?;
    Ok(Choice { recommended, report, text })
}

impl Session<'_> {
    fn standard(&self, within: f64) -> Option<Standard> {
        let control = self.base.experiment.control.as_ref()?;
        Standard::of(&self.tried, control, within)
    }

    /// What was tried of an integrator, judged by what is the most exact one so far.
    fn rungs(&self, of: ModelKind, within: f64) -> Vec<Rung> {
        let standard = self.standard(within);
        let max_failed = self.max_failed();
        let rung = |tried: &Tried| match (tried.candidate, &tried.result) {
            (Candidate::Integrator { kind, substeps }, result) if kind == of => {
                let score = result.as_ref().ok();
                let stands = score.filter(|score| score.stands(max_failed));
                let good = score.zip(standard.as_ref()).is_some_and(|(s, to)| to.is_good(s));
                Some(Rung { substeps, iae: stands.map(|score| score.iae), good })
            }
            _ => None,
        };
        self.tried.iter().filter_map(rung).collect()
    }

    fn max_failed(&self) -> f64 {
        self.base.experiment.control.as_ref().map_or(0.0, |control| control.max_failed_share)
    }

    /// The substeps that the config has for an integrator.
    fn own_substeps(&self, kind: ModelKind) -> usize {
        let control = self.base.experiment.control.as_ref();
        control.map_or(1, |control| control.substeps(kind, 1.0, 1.0))
    }

    /// Tries what `next` says, until that is nothing or the time is up.
    fn climb(
        &mut self,
        kind: ModelKind,
        within: f64,
        next: impl Fn(&[Rung]) -> Option<usize>,
    ) -> Result<(), BenchError> {
        while let Some(substeps) = next(&self.rungs(kind, within)) {
            if !self.attempt(Candidate::Integrator { kind, substeps })? {
                break;
            }
        }
        Ok(())
    }
}

/// First a model that is exact, then the fewest substeps that are good of each method.
fn integrators(session: &mut Session<'_>, within: f64) -> Result<(), BenchError> {
    let tolerance = 0.1 * within;
    for kind in [ModelKind::Rk4, ModelKind::Rodas4] {
        let start = session.own_substeps(kind);
        session.climb(kind, within, |tried| ladder::finer(start, tried, tolerance))?;
        if ladder::is_exact(&session.rungs(kind, within), tolerance) {
            break;
        }
    }
    if session.standard(within).is_none() {
        return Ok(());
    }
    for kind in [ModelKind::Rk4, ModelKind::Rk5, ModelKind::Rodas4] {
        let of_rk4 = session.rungs(ModelKind::Rk4, within);
        let fewest = of_rk4.iter().filter(|rung| rung.good).map(|rung| rung.substeps).min();
        let is_stiff = fewest.is_none_or(|fewest| fewest >= STIFF);
        if kind == ModelKind::Rodas4 && !is_stiff {
            continue;
        }
        let start = session.own_substeps(kind);
        session.climb(kind, within, |tried| ladder::fewer(start, tried))?;
    }
    Ok(())
}

/// Nets from the first guess to the smallest that is good, of each source.
fn nets(session: &mut Session<'_>, standard: &Standard) -> Result<(), BenchError> {
    let cheapest = standard.ranking(&session.tried).first().map(|(_, score)| score.p50_us);
    let hopeless = cheapest.map_or(f64::INFINITY, |cheapest| HOPELESS * cheapest);
    let mut start = FIRST_NET;
    for source in session.base.sources.clone() {
        loop {
            let tried = net_places(session, standard, source);
            let Some(place) = ladder::size(start, SHAPES.len(), &tried) else { break };
            let is_larger = tried.iter().all(|(other, _)| *other < place) && !tried.is_empty();
            if is_larger && last_time(session) > hopeless {
                break;
            }
            if !session.attempt(Candidate::Net { shape: SHAPES[place], source })? {
                return Ok(());
            }
        }
        let tried = net_places(session, standard, source);
        let good = tried.iter().filter(|(_, good)| *good).map(|(place, _)| *place).min();
        start = good.unwrap_or(FIRST_NET);
    }
    Ok(())
}

/// The nets of a source that were tried, as places in [`SHAPES`], and whether they are good.
fn net_places(
    session: &Session<'_>,
    standard: &Standard,
    source: TrainingTarget,
) -> Vec<(usize, bool)> {
    let place = |(place, &shape): (usize, &candidate::Shape)| {
        let tried = session.known(Candidate::Net { shape, source })?;
        Some((place, tried.result.as_ref().is_ok_and(|score| standard.is_good(score))))
    };
    SHAPES.iter().enumerate().filter_map(place).collect()
}

/// The time of a control step of what was tried last, in us; 0 if there is none.
fn last_time(session: &Session<'_>) -> f64 {
    let last = session.tried.last().and_then(|tried| tried.result.as_ref().ok());
    last.map_or(0.0, |score| score.p50_us)
}

/// Measures the times of the best as often as the config says.
fn finals(
    session: &mut Session<'_>,
    standard: Standard,
    within: f64,
) -> Result<Standard, BenchError> {
    let control = session.base.experiment.control.as_ref();
    let repetitions = control.map_or(1, |control| control.repetitions);
    let best = standard.ranking(&session.tried).into_iter().take(FINALISTS);
    let best: Vec<Candidate> = best.map(|(tried, _)| tried.candidate).collect();
    for candidate in best {
        let place = session.tried.iter().position(|tried| tried.candidate == candidate);
        if let Some(place) = place.filter(|_| repetitions > 1) {
            session.measure(place, repetitions)?;
        }
    }
    Ok(session.standard(within).unwrap_or(standard))
}

/// An error that says how the loops with integrators ended.
fn nothing(session: &Session<'_>) -> BenchError {
    let mut reasons: Vec<String> = Vec::new();
    for tried in &session.tried {
        let reason = match &tried.result {
            Err(error) => error.clone(),
            Ok(score) => format!("{:.0} % of its steps fail", 100.0 * score.failed),
        };
        reasons.push(format!("{}: {reason}", tried.candidate));
    }
    BenchError::NothingToChoose {
        name: session.base.experiment.name.clone(),
        out_of_time: session.is_out_of_time,
        reasons: reasons.join("; "),
    }
}

/// Makes a sweep of all that was tried, with its tables and its report, and returns the path of
/// the latter.
fn write_report(session: &Session<'_>) -> Result<PathBuf, BenchError> {
    let cases = session.tried.iter().map(|tried| tried.candidate.case(tried.repetitions));
    let experiment = session.sweep(&cases.collect::<String>())?;
    let dir = session.run_dir.path(TRIED);
    match fs::remove_dir_all(&dir) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            return Err(RecordError::unwritable(&dir)(error).into());
        }
        _ => {}
    }
    let mut run_dir = RunDir::open(&dir, &experiment, std::process::id())?;
    let all = trials(&experiment).expect("the experiment was checked, and its trials with it");
    let counts = write_tables(&experiment, &all, &run_dir, &session.sweep_dir)?;
    run_dir.update(|metrics| metrics.sweep = Some(counts))?;
    rebuild_report(&dir)
}

/// Copies the net of the model to use to where the recommended config is; gives whether it has one.
fn copy_net(session: &Session<'_>, winner: &Tried) -> Result<bool, BenchError> {
    let to = session.run_dir.path(NET);
    let Some(net) = &winner.net else {
        session.run_dir.remove(NET)?;
        return Ok(false);
    };
    let from = session.sweep_dir.net(net).join(file::MODEL);
    fs::copy(&from, &to).map_err(RecordError::unwritable(&to))?;
    Ok(true)
}
