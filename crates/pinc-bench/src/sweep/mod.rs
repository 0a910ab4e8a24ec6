//! Sweeps: an experiment many times over, on all cores, in parts that can be interrupted, spread
//! over machines and merged.

mod crew;
mod progress;
mod sharing;
mod status;

pub use status::{Status, status};

use crew::Crew;
pub(crate) use crew::finish_trial;
use pinc_config::{Experiment, Plants, SweepSpec, Trial, sweep_models, trials};
use pinc_record::work::{Estimate, Ledger, Queue, effort, expected};
use pinc_record::{
    Best, CsvText, Eligibility, Invocation, Provenance, RecordError, RunDir, SummaryTable,
    SweepDir, SweepMetrics, TrialColumn, TrialMetric, TrialTable, file,
};
use pinc_runs::invocation::{cores, invocation};
use pinc_runs::progress::Verbosity;
use pinc_runs::{Options, RunError, console, rebuild_report};
use progress::Progress;
use sharing::nets_of_parameters;
use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A share of a sweep. Trials that need the same net are in one share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Which share, from 1.
    pub number: usize,
    /// The number of shares.
    pub of: usize,
    /// Whether other processes work on the same directory. Each then begins with its own share, and
    /// goes on with what nobody else works on.
    pub shared: bool,
}

impl Shard {
    /// All of it, by this process.
    pub const WHOLE: Self = Self { number: 1, of: 1, shared: false };
}

/// The trials of a sweep that are over, and the nets that are trained.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Kept {
    /// How many trials are over.
    pub trials: usize,
    /// How many nets are trained.
    pub nets: usize,
}

/// The results of a sweep in `dir`, which are lost if the sweep begins afresh; `None` if there are
/// none.
#[must_use]
pub fn kept(experiment: &Experiment, dir: &Path) -> Option<Kept> {
    let (trials, nets) = SweepDir::of(dir).results();
    (trials + nets > 0 && RunDir::is_of(dir, experiment)).then_some(Kept { trials, nets })
}

/// Removes what [`kept`] finds.
///
/// # Errors
///
/// [`RunError`] if the directory holds something else, somebody works in it, or it cannot be
/// written.
pub fn clear(experiment: &Experiment, dir: &Path) -> Result<(), RunError> {
    let _alone = RunDir::open(dir, experiment, std::process::id())?;
    Ok(SweepDir::of(dir).clear()?)
}

/// Runs the trials of a sweep, or a share of them, with their results in `dir`. Trials that failed
/// are in its tables and stop no others. Unless it resumes, what [`kept`] finds is removed.
///
/// # Errors
///
/// [`RunError`] if the sweep could not continue, and [`RunError::Failed`] if it did but
/// trials failed.
pub fn sweep(
    experiment: &Experiment,
    dir: &Path,
    options: &Options<'_>,
    shard: Shard,
) -> Result<RunDir, RunError> {
    let trials = made(experiment)?;
    if !options.resume {
        clear(experiment, dir)?;
    }
    let session = Session::open(experiment, &trials, dir, options, shard.shared)?;
    if let (Some(nets), Verbosity::Shown) = (nets_of_parameters(&trials), options.verbosity) {
        console::note(&nets);
    }
    let worked = session.work(options, shard);
    let closed = session.close();
    // The tables have what was done before it stopped; the reason for stopping matters more.
    worked.and(closed)
}

/// How many units of work of a sweep are left in `dir`: trials that need the same net are one as
/// long as it is not trained.
pub(crate) fn units_left(experiment: &Experiment, dir: &Path) -> Result<usize, RunError> {
    let (trials, sweep_dir) = (made(experiment)?, SweepDir::of(dir));
    let mut ledger = Ledger::new(experiment, &trials);
    if RunDir::is_of(dir, experiment) {
        ledger.look_up(&sweep_dir)?;
    }
    let left = trials.iter().zip(ledger.eligibility());
    let left = left.filter(|(trial, s)| !ledger.knows(trial) && *s != Eligibility::Dropped);
    let left = left.map(|(trial, _)| trial);
    let unit = |trial: &'_ Trial| match sweep_dir.is_trained(trial.unit()) {
        true => trial.id.clone(),
        false => trial.unit().to_owned(),
    };
    Ok(left.map(unit).collect::<HashSet<_>>().len())
}

/// The trials of an experiment that has a sweep.
fn made(experiment: &Experiment) -> Result<Vec<Trial>, RunError> {
    if experiment.sweep.is_none() {
        return Err(RunError::missing_section(experiment, "sweep", "a sweep"));
    }
    TrialMetric::searched(experiment).map_err(|e| RunError::unknown_metric(experiment, &e))?;
    Ok(trials(experiment).expect("the experiment was checked, and its trials with it"))
}

/// Collects the trials of sweeps of the same config, from their directories, in `dir`. The config
/// may name one of `plants`.
///
/// # Errors
///
/// [`RunError`] if a directory holds no sweep or one of another config, or a file cannot be
/// copied; and [`RunError::Failed`] as for [`sweep`].
pub fn merge(
    parts: &[PathBuf],
    dir: &Path,
    plants: &Plants,
    options: &Options<'_>,
) -> Result<RunDir, RunError> {
    let mut experiments = Vec::new();
    for part in parts {
        experiments.push(Experiment::load(&part.join(file::CONFIG), &[], plants)?);
    }
    let Some((experiment, others)) = experiments.split_first() else {
        return Err(RecordError::NoRunDirectory { dir: dir.to_owned() }.into());
    };
    if let Some(i) = others.iter().position(|other| other != experiment) {
        let problem = format!(
            "belongs to another sweep than {} (their config.toml differ)",
            parts[0].display()
        );
        return Err(RunError::usage(parts[i + 1].display(), problem));
    }
    let trials = made(experiment)?;
    let session = Session::open(experiment, &trials, dir, options, false)?;
    for part in parts {
        session.import_trials(&SweepDir::of(part))?;
    }
    session.close()
}

/// How often a directory is tried that another process has for a short while.
const TRIES: u32 = 300;
/// The time between two tries.
const TRY_EVERY: Duration = Duration::from_millis(200);

/// A name for this process that no other one has, on no machine.
fn worker_name() -> String {
    let host = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let host = host.trim().replace(|c: char| !c.is_ascii_alphanumeric(), "-");
    format!("{host}-{}", std::process::id())
}

/// A sweep and its directory.
struct Session<'a> {
    experiment: &'a Experiment,
    sweep: &'a SweepSpec,
    trials: &'a [Trial],
    run_dir: RunDir,
    sweep_dir: SweepDir,
    begun: Invocation,
    /// Whether other processes work in the directory.
    shared: bool,
    ledger: Mutex<Ledger<'a>>,
}

impl<'a> Session<'a> {
    fn open(
        experiment: &'a Experiment,
        trials: &'a [Trial],
        dir: &Path,
        options: &Options<'_>,
        shared: bool,
    ) -> Result<Self, RunError> {
        let sweep = experiment.sweep.as_ref().expect("it has trials");
        let begun = invocation(options.arguments);
        let provenance = Provenance::of(experiment, begun.clone());
        let (run_dir, sweep_dir) = (open_dir(experiment, dir, shared)?, SweepDir::of(dir));
        let counts = run_dir.metrics().sweep.as_ref();
        if !(options.resume && counts.is_some_and(|all| all.pending() == 0)) {
            // One after the other: each adds itself to what is there.
            let mut tries = (0..TRIES).map(|_| sweep_dir.claim("provenance", std::process::id()));
            let _claim = tries.find_map(|claim| {
                let claim = claim.transpose();
                if claim.is_none() {
                    std::thread::sleep(TRY_EVERY / 10);
                }
                claim
            });
            run_dir.write_provenance(&provenance, options.resume || shared)?;
        }
        let mut ledger = Ledger::new(experiment, trials);
        ledger.look_up(&sweep_dir)?;
        let ledger = Mutex::new(ledger);
        Ok(Self { experiment, sweep, trials, run_dir, sweep_dir, begun, shared, ledger })
    }

    fn ledger(&self) -> MutexGuard<'_, Ledger<'a>> {
        self.ledger.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Runs what is left of a share of the trials.
    fn work(&self, options: &Options<'_>, shard: Shard) -> Result<(), RunError> {
        let mine = self.share(shard)?;
        let (left, later) = self.left(&mine);
        let queue = Queue::new(left.iter().copied(), self.sweep.timed, cores());
        let queue = queue.and_later(later.clone());
        let workers = queue.width();
        let expected = expected(self.experiment, left.iter().copied(), later.iter().copied());
        let trials = expected.iter().map(|(_, share)| share).sum();
        let (effort, ..) = effort_of_trainings(&self.sweep_dir, expected);
        let estimate = Estimate::new(workers, effort, trials);
        let (all, left) = (mine.len(), left.len() + later.len());
        let progress = Progress::begin(options.verbosity, all, left, estimate);
        let crew = Crew {
            session: self,
            // The sweep shows the progress of its trials, which are resumed from what is there.
            options: Options { resume: true, verbosity: Verbosity::Quiet, ..*options },
            queue,
            state: Mutex::new(progress),
        };
        crew.work(workers)
    }

    /// Which of these trials are to be run, and of which that is not known yet.
    fn left(&self, mine: &[&'a Trial]) -> (Vec<&'a Trial>, Vec<&'a Trial>) {
        let ledger = self.ledger();
        let eligibility = ledger.eligibility_by_id();
        let mut known = HashSet::new();
        // Cases may be equal in some preset.
        let left = mine.iter().filter(|trial| !ledger.knows(trial) && known.insert(&trial.id));
        let left = left.filter(|trial| eligibility[trial.id.as_str()] != Eligibility::Dropped);
        left.partition(|trial| eligibility[trial.id.as_str()] == Eligibility::Open)
    }

    /// Whether a search drops trials.
    fn halves(&self) -> bool {
        self.sweep.search.as_ref().is_some_and(|search| search.halving.is_some())
    }

    /// The trials of a share, in the order in which they are begun. If the directory is shared, the
    /// other shares follow.
    fn share(&self, shard: Shard) -> Result<Vec<&'a Trial>, RunError> {
        let Shard { number, of, shared } = shard;
        let mut units = HashMap::new();
        let of_trial = |trial: &'a Trial| {
            let next = units.len();
            let unit = *units.entry(trial.unit()).or_insert(next);
            // How many shares after its own the trial's share is.
            ((unit + of - (number - 1)) % of, trial)
        };
        let mut trials: Vec<_> = self.trials.iter().map(of_trial).collect();
        let keeps_others_out = self.run_dir.keeps_others_out();
        if shared && !keeps_others_out && of == 1 {
            let problem = "its file system has no locks, so processes cannot share the sweep's \
                           trials; give each process its own with --shard K/N";
            return Err(RunError::usage(self.run_dir.dir().display(), problem));
        }
        if !(shared && keeps_others_out) {
            trials.retain(|(distance, _)| *distance == 0);
        }
        // At equal distance in their own order.
        trials.sort_by_key(|(distance, _)| *distance);
        Ok(trials.into_iter().map(|(_, trial)| trial).collect())
    }

    fn import_trials(&self, part: &SweepDir) -> Result<(), RunError> {
        let mut ledger = self.ledger();
        for trial in self.trials {
            let net = trial.training.as_ref().map(|(id, _)| id.as_str());
            if !ledger.knows(trial)
                && let Some(finished) = part.finished(&trial.id)?
            {
                self.sweep_dir.import_trial(part, &trial.id, net)?;
                ledger.note(trial, &finished);
            }
        }
        Ok(())
    }

    /// Whether nobody has written the tables for so long.
    fn tables_are_old(&self, pause: Duration) -> bool {
        let written = std::fs::metadata(self.run_dir.path(file::SWEEP)).and_then(|m| m.modified());
        let age = written.ok().and_then(|written| written.elapsed().ok());
        !self.shared || age.is_none_or(|age| age >= pause)
    }

    /// Writes the tables of what has been done so far, and counts it.
    fn write_tables(&self) -> Result<SweepMetrics, RunError> {
        let mut ledger = self.ledger();
        if self.shared {
            ledger.look_up(&self.sweep_dir)?;
        }
        let tables = tables(self.experiment, self.trials, &ledger);
        let (mut counts, best) = (ledger.counts(), ledger.best());
        drop(ledger);
        if let Some(best) = best {
            counts.best = Some(self.write_best(best)?);
        }
        for (name, table) in tables {
            self.run_dir.write(name, table.as_bytes())?;
        }
        Ok(counts)
    }

    /// Writes the config of the best candidate, and returns what it is in words.
    fn write_best(&self, best: Best) -> Result<String, RunError> {
        let place = self.trials[best.trial].search.expect("the best is a candidate");
        let (names, mut experiment) =
            pinc_config::candidate(self.experiment, place).expect("all candidates were checked");
        let minimize = self.sweep.search.as_ref().map_or("", |search| search.minimize.as_str());
        let names = names.iter().map(|(column, name)| match column.as_str() {
            pinc_config::CANDIDATE => format!("candidate {name}"),
            _ => format!("{column} = {name}"),
        });
        let words = names.collect::<Vec<_>>().join(", ");
        let words = format!("{words}: {minimize} = {:.4e}", best.score);
        experiment.name += "-best";
        let text = format!("# The best of the sweep {}.\n# {words}\n\n", self.experiment.name);
        self.run_dir.write(file::BEST, (text + &experiment.to_toml()).as_bytes())?;
        Ok(words)
    }

    /// Writes the tables and the report, unless others are still at work, who will.
    fn close(mut self) -> Result<RunDir, RunError> {
        let (dir, metrics) = (self.run_dir.dir().to_owned(), self.run_dir.clone().released());
        let Some(run_dir) = self.run_dir.alone()? else { return Ok(metrics) };
        self.run_dir = run_dir;
        let counts = self.write_tables()?;
        self.run_dir.update(|all| all.sweep = Some(counts.clone()))?;
        rebuild_report(&dir)?;
        self.sweep_dir.remove_leftovers()?;
        if counts.failed > 0 {
            let SweepMetrics { trials, failed, .. } = counts;
            let table = self.run_dir.path(file::SWEEP);
            return Err(RunError::Failed(format!(
                "{failed} of {trials} trials failed; {} says which and why",
                table.display()
            )));
        }
        let is_over = counts.done + counts.dropped == counts.trials;
        if let (Some(search), None, true) = (&self.sweep.search, &counts.best, is_over) {
            return Err(RunError::Failed(format!(
                "`sweep.search.minimize`: no trial has a value of {}; name another column of {}",
                search.minimize,
                self.run_dir.path(file::SWEEP).display()
            )));
        }
        Ok(self.run_dir.released())
    }
}

/// Opens the directory of a sweep, which the last of several processes has to itself for a while
/// when it writes the report.
fn open_dir(experiment: &Experiment, dir: &Path, shared: bool) -> Result<RunDir, RunError> {
    let id = std::process::id();
    if !shared {
        return Ok(RunDir::open(dir, experiment, id)?);
    }
    for _ in 0..TRIES {
        match RunDir::open_shared(dir, experiment, id) {
            Err(RecordError::Locked { .. }) => std::thread::sleep(TRY_EVERY),
            opened => return Ok(opened?),
        }
    }
    Ok(RunDir::open_shared(dir, experiment, id)?)
}

/// Writes the tables and the report of a sweep into `dir`, in place of what is there, from the
/// results of its `trials` in `sweep_dir`; returns the report's path.
pub(crate) fn write_report(
    experiment: &Experiment,
    trials: &[Trial],
    dir: &Path,
    sweep_dir: &SweepDir,
    begun: &Invocation,
) -> Result<PathBuf, RunError> {
    match std::fs::remove_dir_all(dir) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            return Err(RecordError::unwritable(dir)(error).into());
        }
        _ => {}
    }
    let mut run_dir = RunDir::open(dir, experiment, std::process::id())?;
    run_dir.write_provenance(&Provenance::of(experiment, begun.clone()), false)?;
    let mut ledger = Ledger::new(experiment, trials);
    ledger.look_up(sweep_dir)?;
    for (name, table) in tables(experiment, trials, &ledger) {
        run_dir.write(name, table.as_bytes())?;
    }
    run_dir.update(|metrics| metrics.sweep = Some(ledger.counts()))?;
    rebuild_report(dir)
}

/// The tables of a sweep, with the names of their files.
fn tables(
    experiment: &Experiment,
    trials: &[Trial],
    ledger: &Ledger<'_>,
) -> [(&'static str, CsvText); 3] {
    let sweep = experiment.sweep.as_ref().expect("a sweep has the section");
    let (results, eligibility) = (ledger.results(), ledger.eligibility());
    let models = sweep_models(experiment, trials);
    let table = |columns| TrialTable::new(columns, sweep, trials, results, &eligibility).to_csv();
    [
        (file::SWEEP, table(TrialColumn::of_sweep(experiment, sweep, &models))),
        (file::SUMMARY, SummaryTable::new(experiment, sweep, trials, results).to_csv()),
        (file::TIMINGS, table(TrialColumn::of_timings(experiment, &models))),
    ]
}

/// The effort of the trainings that are left for these trials, of which shares are run, how many
/// these are, and how many there are in all.
fn effort_of_trainings<'t>(
    dir: &SweepDir,
    trials: impl IntoIterator<Item = (&'t Trial, f64)>,
) -> (f64, usize, usize) {
    let mut known = HashSet::new();
    let shares = trials.into_iter();
    let trainings = shares.filter_map(|(trial, share)| Some((trial.training.as_ref()?, share)));
    let trainings: Vec<_> = trainings.filter(|((id, _), _)| known.insert(id)).collect();
    let left: Vec<_> = trainings.iter().filter(|((id, _), _)| !dir.is_trained(id)).collect();
    let sum = left.iter().map(|((_, training), share)| share * effort(training)).sum();
    (sum, left.len(), trainings.len())
}

#[cfg(test)]
mod tests;
