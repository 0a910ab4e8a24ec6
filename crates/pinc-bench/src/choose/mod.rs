//! `pinc choose`: candidates of pinc-choose, each tried as a trial of a sweep is run and kept.

mod base;
mod in_c;
mod session;
mod until;

use crate::sweep;
use base::Base;
use pinc_choose::{Advice, Search, SearchResult, Tried};
use pinc_config::{Experiment, Plants, trials};
use pinc_record::{RecordError, file, write_atomically};
use pinc_runs::{Options, RunError};
use session::Session;
use std::fs;
use std::path::{Path, PathBuf};

/// The recommended config, and its net.
const RECOMMENDED: &str = "recommended.toml";
const NET: &str = "recommended.safetensors";

/// The directory of the sweep of all that was tried, with its report.
const TRIED: &str = "tried";

/// How good is good enough, and how long may be tried.
#[derive(Clone, Copy, Debug)]
pub struct ChooseOptions {
    /// How much more than the most exact model's a loop's IAE may be, relative.
    pub within: f64,
    /// The time, in s: for trying models, and in the end for measuring the best again, each of
    /// which is measured once at least.
    pub budget_s: f64,
    /// Whose control steps are timed.
    pub timed: Timed,
}

/// The controller whose control steps are timed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Timed {
    /// The program's.
    #[default]
    Program,
    /// The exported one in C, compiled on this machine.
    ExportedC,
}

impl Timed {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Program, Self::ExportedC];

    /// The word for it on command lines.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Program => "program",
            Self::ExportedC => "c",
        }
    }

    /// What there is to say of the times.
    fn note(self) -> Option<&'static str> {
        match self {
            Self::Program => None,
            Self::ExportedC => Some(
                "times are of the exported C, compiled by cc -O2, over the steps of its self-test, each the \
                 least of 30 runs",
            ),
        }
    }

    /// The one of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|of| of.name() == name)
    }
}

/// The result; its `Display` is a short table and the advice.
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
/// one. Results are in `dir`; `options` say whether results of an earlier call are reused.
///
/// # Errors
///
/// [`RunError`] if the config has no closed loop, if no loop succeeds with an integrator or with the
/// black box itself, or if files cannot be written.
pub fn choose(
    experiment: &Experiment,
    dir: &Path,
    plants: &Plants,
    options: &Options<'_>,
    how: ChooseOptions,
) -> Result<Choice, RunError> {
    if experiment.trains_parameters() {
        let problem = "`pinc choose` compares models of one plant, but each training with data.parameters \
                       finds its own: give those of a training in [plant], and remove the key";
        return Err(RunError::usage(&experiment.name, problem));
    }
    let base = Base::of(experiment, plants)?;
    let mut session = Session::open(&base, dir, plants, options, how)?;
    let (control, sources, states) = (base.control(), &base.sources, base.states());
    let has_equation = !experiment.plant.is_black_box();
    let search = Search { control, sources, states, within: how.within, has_equation };
    let mut found = search.run(&mut session)?;
    if let Some(standard) = search.standard(&found.tried) {
        found.prove(&standard, |tried| session.proven(tried));
    }
    let mut notes = base.notes.clone();
    notes.extend(how.timed.note().map(str::to_owned));
    let Some(advice) = Advice::of(&search, &found, &notes) else {
        return Err(nothing(&experiment.name, &found));
    };
    let report = write_report(&session, &found.tried)?;
    let net = copy_net(&mut session, advice.winner())?.then_some(NET);
    let recommended = session.run_dir.path(RECOMMENDED);
    let config = advice.config(experiment, &base.experiment, net);
    write_atomically(&recommended, config.as_bytes())?;
    session.end(found.tried.len());
    Ok(Choice { recommended, report, text: advice.to_string() })
}

/// An error that says how the loops ended that could have been a standard.
fn nothing(name: &str, found: &SearchResult) -> RunError {
    let reason = |tried: &Tried| match &tried.result {
        Err(error) => format!("{}: {error}", tried.candidate),
        Ok(score) => match score.unsound.as_ref().or(score.unexported.as_ref()) {
            Some(objection) => format!("{}: {objection}", tried.candidate),
            None => format!("{}: {:.0} % of its steps fail", tried.candidate, 100.0 * score.failed),
        },
    };
    let reasons: Vec<String> = found.tried.iter().map(reason).collect();
    let so_far = match found.is_out_of_time {
        true => " so far (the time was up; --budget-s gives more)",
        false => "",
    };
    RunError::Failed(format!(
        "{name}: no model can be chosen, since no loop succeeded that others could be compared with{so_far}: {}",
        reasons.join("; ")
    ))
}

/// Makes a sweep of all loops that came to their end, with its tables and its report, and returns
/// the path of the latter.
fn write_report(session: &Session<'_>, tried: &[Tried]) -> Result<PathBuf, RunError> {
    let ended: Vec<&Tried> = tried.iter().filter(|tried| tried.result.is_ok()).collect();
    let iterations = session.base.iterations();
    let cases = ended.iter().map(|tried| tried.candidate.case(tried.repetitions, &iterations));
    let experiment = session.sweep(&cases.collect::<String>())?;
    let mut all = trials(&experiment).expect("the experiment was checked, and its trials with it");
    for (trial, tried) in all.iter_mut().zip(&ended) {
        trial.id.clone_from(&tried.place);
    }
    let dir = session.run_dir.path(TRIED);
    sweep::write_report(&experiment, &all, &dir, &session.sweep_dir, &session.begun)
}

/// Copies the net of the model to use to where the recommended config is; gives whether it has one.
fn copy_net(session: &mut Session<'_>, winner: &Tried) -> Result<bool, RunError> {
    let to = session.run_dir.path(NET);
    let Some(net) = &winner.net else {
        session.run_dir.remove(NET)?;
        return Ok(false);
    };
    let from = session.sweep_dir.net(net).join(file::MODEL);
    fs::copy(&from, &to).map_err(RecordError::unwritable(&to))?;
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;
    use pinc_choose::{Candidate, Score};

    fn tried(substeps: usize, result: Result<Score, String>) -> Tried {
        let integrator = pinc_ode::Integrator::Rk4;
        let candidate = Candidate::Integrator { integrator, substeps };
        Tried { candidate, net: None, repetitions: 1, place: String::new(), result }
    }

    fn score() -> Score {
        Score {
            iae: 1.0,
            violation: 0.0,
            failed: 0.125,
            steps: 16,
            p50_us: 1.0,
            p99_us: 2.0,
            rms: None,
            worst: None,
            proven: None,
            beyond: 0,
            training_s: None,
            instructions: None,
            unexported: None,
            unsound: None,
        }
    }

    /// Where nothing can be chosen, each model is named with its own reason: the error of its loop,
    /// or else what makes it unsound, or why it is not exported, or else its failed steps.
    #[test]
    fn a_choice_of_nothing_has_a_reason_for_each_model() {
        let unexported = Some("no C compiler".to_owned());
        let unsound = Some("unstable at 3 of 9 points".to_owned());
        let all = [
            tried(1, Err("the plant breaks off".to_owned())),
            tried(2, Ok(score())),
            tried(3, Ok(Score { unexported: unexported.clone(), ..score() })),
            tried(4, Ok(Score { unexported, unsound, ..score() })),
        ];
        let found = SearchResult { tried: all.to_vec(), ..SearchResult::default() };
        let head = "tanks: no model can be chosen, since no loop succeeded that others could be \
                    compared with";
        let reasons = "RK4 x1: the plant breaks off; RK4 x2: 12 % of its steps fail; \
                       RK4 x3: no C compiler; RK4 x4: unstable at 3 of 9 points";
        assert_eq!(nothing("tanks", &found).to_string(), format!("{head}: {reasons}"));
        let found = SearchResult { is_out_of_time: true, ..found };
        let said = nothing("tanks", &found).to_string();
        assert_eq!(
            said,
            format!("{head} so far (the time was up; --budget-s gives more): {reasons}")
        );
    }

    #[test]
    fn what_is_timed_is_found_by_its_name() {
        for timed in Timed::ALL {
            assert_eq!(Timed::from_name(timed.name()), Some(timed));
            assert_eq!(timed.note().is_some(), timed == Timed::ExportedC);
        }
        assert_eq!(Timed::from_name("C"), None);
    }
}
