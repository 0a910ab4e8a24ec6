//! Sweeps: an experiment many times over, on all cores, in parts that can be interrupted, spread
//! over machines and merged.

mod progress;
mod queue;

use crate::BenchError;
use crate::invocation::invocation;
use crate::progress::Verbosity;
use crate::runs::{Options, rebuild_report, run_trial, train_shared};
use pinc_config::{Experiment, Plants, SweepSpec, Trial, trials};
use pinc_net::NetError;
use pinc_record::{
    Ending, Provenance, RecordError, RunDir, SummaryTable, SweepDir, SweepMetrics, TrialColumn,
    TrialTable, file,
};
use progress::{Estimate, Progress, effort};
use queue::{Job, Queue};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// A share of a sweep: every `of`-th trial, beginning with number `number`, from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// Which share.
    pub number: usize,
    /// Of how many.
    pub of: usize,
}

impl Shard {
    /// All of it.
    pub const WHOLE: Self = Self { number: 1, of: 1 };

    fn has(self, index: usize) -> bool {
        index % self.of == self.number - 1
    }
}

/// Runs the trials of a sweep, or a share of them, with their results in `dir`. Trials that failed
/// are in its tables and stop no others.
///
/// # Errors
///
/// [`BenchError`] if the sweep could not continue, and [`BenchError::FailedTrials`] if it did but
/// trials failed.
pub fn sweep(
    experiment: &Experiment,
    dir: &Path,
    options: &Options<'_>,
    shard: Shard,
) -> Result<RunDir, BenchError> {
    let session = Session::open(experiment, dir, options)?;
    if !options.resume {
        session.sweep_dir.clear()?;
    }
    let worked = session.work(options, shard);
    let closed = session.close();
    // What was done before it stopped is in the tables; why it stopped matters more.
    worked.and(closed)
}

/// Collects the trials of sweeps of the same config, from their directories, in `dir`. The config
/// may name one of `plants`.
///
/// # Errors
///
/// [`BenchError`] if a directory holds no sweep or one of another config, or a file cannot be
/// copied; and [`BenchError::FailedTrials`] as for [`sweep`].
pub fn merge(
    parts: &[PathBuf],
    dir: &Path,
    plants: &Plants,
    options: &Options<'_>,
) -> Result<RunDir, BenchError> {
    let mut experiments = Vec::new();
    for part in parts {
        experiments.push(Experiment::load(&part.join(file::CONFIG), &[], plants)?);
    }
    let Some((experiment, others)) = experiments.split_first() else {
        return Err(RecordError::NoRunDirectory { dir: dir.to_owned() }.into());
    };
    if let Some(i) = others.iter().position(|other| other != experiment) {
        return Err(BenchError::OtherSweep { dir: parts[i + 1].clone(), first: parts[0].clone() });
    }
    let session = Session::open(experiment, dir, options)?;
    for part in parts {
        session.import_trial(&SweepDir::of(part))?;
    }
    session.close()
}

/// A sweep and its directory.
struct Session<'a> {
    experiment: &'a Experiment,
    sweep: &'a SweepSpec,
    trials: Vec<Trial>,
    run_dir: RunDir,
    sweep_dir: SweepDir,
    provenance: Provenance,
}

impl<'a> Session<'a> {
    fn open(
        experiment: &'a Experiment,
        dir: &Path,
        options: &Options<'_>,
    ) -> Result<Self, BenchError> {
        let Some(sweep) = &experiment.sweep else {
            let name = experiment.name.clone();
            return Err(BenchError::MissingSection { name, section: "sweep", command: "a sweep" });
        };
        let trials = trials(experiment);
        let trials = trials.expect("the experiment was checked, and its trials with it");
        let provenance = Provenance::of(experiment, invocation(options.arguments));
        let run_dir = RunDir::open(dir, experiment, std::process::id())?;
        let counts = run_dir.metrics().sweep.as_ref();
        if !(options.resume && counts.is_some_and(|all| all.done + all.failed == all.trials)) {
            run_dir.write_provenance(&provenance, options.resume)?;
        }
        Ok(Self { experiment, sweep, trials, run_dir, sweep_dir: SweepDir::of(dir), provenance })
    }

    /// Runs what is left of a share of the trials.
    fn work(&self, options: &Options<'_>, shard: Shard) -> Result<(), BenchError> {
        let mine = self.trials.iter().enumerate().filter(|(i, _)| shard.has(*i));
        let mine: Vec<_> = mine.map(|(_, trial)| trial).collect();
        let mut left: Vec<&Trial> = Vec::new();
        for &trial in &mine {
            // Cases may be equal in some preset.
            let twice = left.iter().any(|other| other.id == trial.id);
            if !twice && self.sweep_dir.finished(&trial.id)?.is_none() {
                left.push(trial);
            }
        }
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let queue = Queue::new(left.iter().copied(), self.sweep.timed);
        let workers = queue.width().min(cores);
        let estimate = Estimate::new(workers, self.effort_of_trainings(&left), left.len());
        let crew = Crew {
            session: self,
            // The sweep shows the progress of its trials, which are resumed from what is there.
            options: Options { resume: true, verbosity: Verbosity::Quiet, ..*options },
            queue,
            threads: (cores / workers.max(1)).max(1),
            state: Mutex::new(Progress::begin(options.verbosity, mine.len(), left.len(), estimate)),
        };
        std::thread::scope(|scope| {
            for _ in 0..workers {
                scope.spawn(|| crew.work());
            }
        });
        let progress = crew.state.into_inner().unwrap_or_else(PoisonError::into_inner);
        progress.end()
    }

    /// What has to be trained for these trials.
    fn effort_of_trainings(&self, trials: &[&Trial]) -> f64 {
        let trainings = trials.iter().filter_map(|trial| trial.training.as_ref());
        let mut trainings: Vec<_> =
            trainings.filter(|(id, _)| !self.sweep_dir.is_trained(id)).collect();
        trainings.sort_by(|a, b| a.0.cmp(&b.0));
        trainings.dedup_by(|a, b| a.0 == b.0);
        trainings.into_iter().map(|(_, training)| effort(training)).sum()
    }

    fn import_trial(&self, part: &SweepDir) -> Result<(), BenchError> {
        for trial in &self.trials {
            let net = trial.training.as_ref().map(|(id, _)| id.as_str());
            if self.sweep_dir.finished(&trial.id)?.is_none() && part.finished(&trial.id)?.is_some()
            {
                self.sweep_dir.import_trial(part, &trial.id, net)?;
            }
        }
        Ok(())
    }

    /// Writes the tables of what has been done so far, and counts it.
    fn write_tables(&self) -> Result<SweepMetrics, BenchError> {
        write_tables(self.experiment, &self.trials, &self.run_dir, &self.sweep_dir)
    }

    /// Writes the tables and the report.
    fn close(mut self) -> Result<RunDir, BenchError> {
        let counts = self.write_tables()?;
        self.run_dir.update(|all| all.sweep = Some(counts.clone()))?;
        rebuild_report(self.run_dir.dir())?;
        if counts.failed > 0 {
            let SweepMetrics { trials, failed, .. } = counts;
            let table = self.run_dir.path(file::SWEEP);
            return Err(BenchError::FailedTrials { failed, trials, table });
        }
        Ok(self.run_dir.released())
    }
}

/// Writes the tables of a sweep, as far as its `trials` in `sweep_dir` are done, and counts these.
pub(crate) fn write_tables(
    experiment: &Experiment,
    trials: &[Trial],
    run_dir: &RunDir,
    sweep_dir: &SweepDir,
) -> Result<SweepMetrics, BenchError> {
    let sweep = experiment.sweep.as_ref().expect("a sweep has the section");
    let finished = trials.iter().map(|trial| sweep_dir.finished(&trial.id));
    let finished = finished.collect::<Result<Vec<_>, _>>()?;
    let table = |columns| TrialTable::new(columns, sweep, trials, &finished);
    let summary = SummaryTable::new(experiment, sweep, trials, &finished);
    let results = table(TrialColumn::of_sweep(experiment, sweep));
    let timings = table(TrialColumn::of_timings(experiment));
    run_dir.write(file::SWEEP, results.to_csv().as_bytes())?;
    run_dir.write(file::SUMMARY, summary.to_csv().as_bytes())?;
    run_dir.write(file::TIMINGS, timings.to_csv().as_bytes())?;
    let over = finished.iter().flatten();
    let failed = over.clone().filter(|finished| finished.ending != Ending::Done).count();
    let done = over.count() - failed;
    Ok(SweepMetrics { trials: trials.len(), done, failed })
}

/// The threads that work on a sweep.
struct Crew<'a> {
    session: &'a Session<'a>,
    options: Options<'a>,
    queue: Queue<'a>,
    /// Threads for one training.
    threads: usize,
    state: Mutex<Progress>,
}

impl<'a> Crew<'a> {
    /// Does one job after the other until there is none.
    fn work(&self) {
        let _guard = StopIfPanicking(&self.queue);
        while let Some(job) = self.queue.next() {
            let outcome = match job {
                Job::Train(trial) => self.train(trial),
                Job::Run(trial, failure) => self.run(trial, failure),
            };
            self.queue.over();
            if let Err(error) = outcome {
                let error = match error {
                    BenchError::Interrupted { .. } => {
                        BenchError::Interrupted { dir: self.session.run_dir.dir().to_owned() }
                    }
                    other => other,
                };
                self.state().error.get_or_insert(error);
                self.queue.stop();
            }
        }
    }

    fn train(&self, trial: &'a Trial) -> Result<(), BenchError> {
        let Some((id, training)) = &trial.training else { return Ok(()) };
        let (sweep_dir, begun) = (&self.session.sweep_dir, Instant::now());
        let (dir, was_trained) = (sweep_dir.net(id), sweep_dir.is_trained(id));
        let provenance = Provenance { seed: training.seed, ..self.session.provenance.clone() };
        let provenance = Provenance { config_sha256: training.fingerprint(), ..provenance };
        let outcome = train_shared(training, &dir, &provenance, self.threads, &self.options);
        let outcome = result_of_trial(outcome)?;
        if !was_trained {
            self.state().trained(effort(training), begun.elapsed());
        }
        self.queue.trained(trial, outcome);
        Ok(())
    }

    fn run(&self, trial: &Trial, failure: Option<String>) -> Result<(), BenchError> {
        let (sweep_dir, begun) = (&self.session.sweep_dir, Instant::now());
        let dir = sweep_dir.begin(&trial.id)?;
        let net = trial.training.as_ref().map(|(id, _)| sweep_dir.net(id));
        let outcome = match failure {
            Some(error) => Err(error),
            None => {
                let keep_traces = self.session.sweep.keep_traces;
                let run =
                    run_trial(&trial.experiment, net.as_deref(), &dir, keep_traces, &self.options);
                result_of_trial(run)?
            }
        };
        let ending = match outcome {
            Ok(()) => Ending::Done,
            Err(error) => Ending::Failed { error },
        };
        sweep_dir.finish(&trial.id, &ending)?;
        let tables_are_due = self.state().finished(&ending, begun.elapsed());
        if tables_are_due {
            self.session.write_tables()?;
        }
        Ok(())
    }

    fn state(&self) -> MutexGuard<'_, Progress> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Lets no thread wait for one that will never be done.
struct StopIfPanicking<'a, 'b>(&'a Queue<'b>);

impl Drop for StopIfPanicking<'_, '_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.stop();
        }
    }
}

/// Tells an error that is the trial's own, and the same every time, from one that ends the sweep.
fn result_of_trial(outcome: Result<(), BenchError>) -> Result<Result<(), String>, BenchError> {
    match outcome {
        Ok(()) => Ok(Ok(())),
        Err(BenchError::Net(error @ NetError::Threads(_))) => Err(BenchError::Net(error)),
        Err(error @ (BenchError::Net(_) | BenchError::Control(_) | BenchError::Plant(_))) => {
            Ok(Err(error.to_string()))
        }
        Err(error) => Err(error),
    }
}
