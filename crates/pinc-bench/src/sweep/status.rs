//! The status of a sweep, from its directory alone.

use super::progress::{now_s, span};
use super::{effort_of_trainings, made};
use crate::slurm::queue_in_words;
use pinc_config::{Experiment, Plants};
use pinc_record::work::{Estimate, Ledger, expected};
use pinc_record::{Eligibility, Ending, RunDir, SweepDir, SweepMetrics, file, rfc3339};
use pinc_runs::RunError;
use std::fmt;
use std::path::Path;
use std::time::Duration;

/// How many failed trials are named.
const NAMED: usize = 5;

/// How far a sweep is.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Status {
    /// The sweep's name.
    pub name: String,
    /// How many trials there are, and how many are over.
    pub counts: SweepMetrics,
    /// How many nets are to be trained, and how many of them are not.
    pub nets: (usize, usize),
    /// The processes at work.
    pub processes: usize,
    /// How many things these do at a time.
    pub lanes: usize,
    /// How long they will take for what is left, in s, if that is known.
    pub seconds_left: Option<f64>,
    /// The first failed trials: hash and error.
    pub failures: Vec<(String, String)>,
    /// Which jobs of the sweep are in Slurm's queue.
    pub queue: Option<String>,
}

/// How far the sweep in `dir` is, whose config may name one of `plants`.
///
/// # Errors
///
/// [`RunError`] if the directory holds no sweep.
pub fn status(dir: &Path, plants: &Plants) -> Result<Status, RunError> {
    RunDir::expect(dir)?;
    let experiment = Experiment::load(&dir.join(file::CONFIG), &[], plants)?;
    let trials = made(&experiment)?;
    let sweep_dir = SweepDir::of(dir);
    let mut ledger = Ledger::new(&experiment, &trials);
    ledger.look_up(&sweep_dir)?;
    let counts = ledger.counts();
    let eligibility = ledger.eligibility();
    let left = trials.iter().zip(&eligibility);
    let left = left.filter(|(t, s)| !ledger.knows(t) && **s != Eligibility::Dropped);
    let (now, later): (Vec<_>, Vec<_>) = left.partition(|(_, s)| **s == Eligibility::Open);
    let (now, later) = (now.into_iter().map(|left| left.0), later.into_iter().map(|left| left.0));
    let left = expected(&experiment, now, later);
    let trials_left = left.iter().map(|(_, share)| share).sum();
    let (_, _, nets) = effort_of_trainings(&sweep_dir, trials.iter().map(|trial| (trial, 1.0)));
    let (effort, untrained, _) = effort_of_trainings(&sweep_dir, left);
    // Where a file system has no locks, the notes are all that is known.
    let notes = sweep_dir.notes();
    let alive = notes.iter().filter(|note| note.is_fresh(now_s()));
    let is_in_use = RunDir::is_in_use(dir) || !cfg!(unix);
    let alive: Vec<_> = alive.filter(|_| is_in_use).collect();
    let failures = trials.iter().zip(ledger.results()).filter_map(|(trial, result)| match &result
        .as_ref()?
        .ending
    {
        Ending::Done => None,
        Ending::Failed { error } => Some((trial.id.clone(), error.clone())),
    });
    let estimate = Estimate::together(&notes, now_s(), effort, trials_left);
    Ok(Status {
        name: experiment.name.clone(),
        nets: (nets, untrained),
        processes: alive.len(),
        lanes: alive.iter().map(|note| note.lanes).sum(),
        seconds_left: estimate.filter(|_| !alive.is_empty() && trials_left > 0.0),
        failures: failures.take(NAMED).collect(),
        queue: queue_in_words(dir)?,
        counts,
    })
}

impl Status {
    /// Who is at work, and how long that will take.
    pub(crate) fn at_work(&self) -> String {
        let mut text = match (self.counts.pending(), self.processes) {
            (0, 0) => return "over".to_owned(),
            (_, 0) => return "no process works on it".to_owned(),
            (_, 1) => "at work: 1 process".to_owned(),
            (_, n) => format!("at work: {n} processes"),
        };
        text += &format!(" with {} at a time", self.lanes);
        if let Some(seconds) = self.seconds_left {
            let end = Duration::from_secs_f64(now_s() + seconds);
            text += &format!("; about {} left, until {}", span(seconds), rfc3339(end));
        }
        text
    }
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let SweepMetrics { trials, done, failed, dropped, .. } = self.counts;
        let left = self.counts.pending();
        writeln!(f, "{}: {trials} trials: {done} done, {failed} failed, {left} left", self.name)?;
        if dropped > 0 {
            writeln!(f, "dropped by the search: {dropped}")?;
        }
        if let (1.., untrained) = self.nets {
            writeln!(f, "nets: {} trained, {untrained} left", self.nets.0 - untrained)?;
        }
        for (trial, error) in &self.failures {
            writeln!(f, "failed: {trial}: {error}")?;
        }
        if failed > self.failures.len() {
            writeln!(f, "failed: {} more", failed - self.failures.len())?;
        }
        if let Some(queue) = &self.queue {
            writeln!(f, "{queue}")?;
        }
        write!(f, "{}", self.at_work())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(counts: SweepMetrics) -> Status {
        Status {
            name: "tanks".to_owned(),
            counts,
            nets: (0, 0),
            processes: 0,
            lanes: 0,
            seconds_left: None,
            failures: Vec::new(),
            queue: None,
        }
    }

    fn counts(done: usize, failed: usize, dropped: usize) -> SweepMetrics {
        SweepMetrics { trials: 12, done, failed, dropped, broken_bounds: Vec::new(), best: None }
    }

    /// Each count has its own line, and there is none of what is not there.
    #[test]
    fn a_status_says_what_is_done_and_what_is_left() {
        assert_eq!(
            of(counts(5, 0, 0)).to_string(),
            "tanks: 12 trials: 5 done, 0 failed, 7 left\nno process works on it"
        );
        let failure = |trial: &str| (trial.to_owned(), "it fell over".to_owned());
        let busy = Status {
            nets: (4, 1),
            processes: 2,
            lanes: 6,
            failures: vec![failure("a1"), failure("b2")],
            queue: Some("in Slurm's queue: 7".to_owned()),
            ..of(counts(3, 3, 4))
        };
        assert_eq!(
            busy.to_string(),
            "tanks: 12 trials: 3 done, 3 failed, 2 left\ndropped by the search: 4\n\
             nets: 3 trained, 1 left\nfailed: a1: it fell over\nfailed: b2: it fell over\n\
             failed: 1 more\nin Slurm's queue: 7\nat work: 2 processes with 6 at a time"
        );
        // All failures are named.
        let named = Status { failures: vec![failure("a1")], ..of(counts(3, 1, 0)) }.to_string();
        assert!(named.contains("failed: a1: ") && !named.contains("more"), "{named}");
    }

    /// A sweep without anything left is over once nobody works on it; the time left is said with a
    /// process at work.
    #[test]
    fn a_sweep_is_over_once_nothing_is_left_and_nobody_works() {
        assert_eq!(of(counts(9, 1, 2)).at_work(), "over");
        let last = Status { processes: 1, lanes: 3, ..of(counts(9, 1, 2)) };
        assert_eq!(last.at_work(), "at work: 1 process with 3 at a time");
        let said = Status { seconds_left: Some(7200.0), ..last }.at_work();
        assert!(said.starts_with("at work: 1 process with 3 at a time; about 2.0 h left, until "));
    }
}
