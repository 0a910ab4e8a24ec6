//! Sweeps: an experiment many times over, on all cores, in parts that can be interrupted, spread over
//! machines and merged.

mod queue;
mod spread;
mod store;
mod table;
mod trial;

pub(crate) use spread::Spread;
pub(crate) use trial::trials;

use crate::progress::{Stage, Verbosity};
use crate::record::{Record, SweepMetrics, file};
use crate::runs::{Options, rebuild_report, run_trial, train_shared};
use crate::spec::{Experiment, SweepSpec};
use crate::{BenchError, Provenance};
use pinc_net::NetError;
use queue::{Job, Queue};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use store::{Ending, Store};
use trial::Trial;

/// Least time between two writings of the tables while trials are running.
const TABLES_EVERY: Duration = Duration::from_secs(10);

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

/// Runs the trials of a sweep, or a share of them, with their results in `dir`. Trials that failed are
/// in its tables and stop no others.
///
/// # Errors
///
/// [`BenchError`] if the sweep could not go on, and [`BenchError::FailedTrials`] if it did but trials
/// failed.
pub fn sweep(
    experiment: &Experiment,
    dir: &Path,
    options: &Options<'_>,
    shard: Shard,
) -> Result<Record, BenchError> {
    let session = Session::open(experiment, dir, options)?;
    if !options.resume {
        session.store.clear()?;
    }
    let worked = session.work(options, shard);
    let closed = session.close();
    // What was done before it stopped is in the tables; why it stopped matters more.
    worked.and(closed)
}

/// Collects the trials of sweeps of the same config, from their directories, in `dir`.
///
/// # Errors
///
/// [`BenchError`] if a directory holds no sweep or one of another config, or a file cannot be copied;
/// and [`BenchError::FailedTrials`] as for [`sweep`].
pub fn merge(parts: &[PathBuf], dir: &Path, options: &Options<'_>) -> Result<Record, BenchError> {
    let mut experiments = Vec::new();
    for part in parts {
        experiments.push(Experiment::load(&part.join(file::CONFIG), &[])?);
    }
    let Some((experiment, others)) = experiments.split_first() else {
        return Err(BenchError::NoRunDirectory { dir: dir.to_owned() });
    };
    if let Some(i) = others.iter().position(|other| other != experiment) {
        return Err(BenchError::OtherSweep { dir: parts[i + 1].clone(), first: parts[0].clone() });
    }
    let session = Session::open(experiment, dir, options)?;
    for part in parts {
        session.take_over(&Store::of(part))?;
    }
    session.close()
}

/// A sweep and its directory.
struct Session<'a> {
    experiment: &'a Experiment,
    sweep: &'a SweepSpec,
    trials: Vec<Trial>,
    record: Record,
    store: Store,
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
        let provenance = Provenance::now(experiment, options.arguments);
        let record = Record::open(dir, experiment)?;
        let counts = record.metrics().sweep.as_ref();
        if !(options.resume && counts.is_some_and(|all| all.done + all.failed == all.trials)) {
            record.sign(&provenance, options.resume)?;
        }
        Ok(Self { experiment, sweep, trials, record, store: Store::of(dir), provenance })
    }

    /// Runs what is left of a share of the trials.
    fn work(&self, options: &Options<'_>, shard: Shard) -> Result<(), BenchError> {
        let mine = self.trials.iter().enumerate().filter(|(i, _)| shard.has(*i));
        let mine: Vec<_> = mine.map(|(_, trial)| trial).collect();
        let mut left: Vec<&Trial> = Vec::new();
        for &trial in &mine {
            // Cases may come to the same in some preset.
            let twice = left.iter().any(|other| other.id == trial.id);
            if !twice && self.store.finished(&trial.id)?.is_none() {
                left.push(trial);
            }
        }
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let queue = Queue::new(left.iter().copied(), self.sweep.timed);
        let workers = queue.width().min(cores);
        let crew = Crew {
            session: self,
            // The trials' progress is the sweep's, and they go on with what is there.
            options: Options { resume: true, verbosity: Verbosity::Quiet, ..*options },
            queue,
            threads: (cores / workers.max(1)).max(1),
            state: Mutex::new(Progress::begin(options, mine.len(), left.len())),
        };
        std::thread::scope(|scope| {
            for _ in 0..workers {
                scope.spawn(|| crew.work());
            }
        });
        let progress = crew.state.into_inner().unwrap_or_else(PoisonError::into_inner);
        progress.end()
    }

    fn take_over(&self, part: &Store) -> Result<(), BenchError> {
        for trial in &self.trials {
            let net = trial.training.as_ref().map(|(id, _)| id.as_str());
            if self.store.finished(&trial.id)?.is_none() && part.finished(&trial.id)?.is_some() {
                self.store.take_over(part, &trial.id, net)?;
            }
        }
        Ok(())
    }

    /// Writes the tables of what has been done so far, and counts it.
    fn write_tables(&self) -> Result<SweepMetrics, BenchError> {
        let finished = self.trials.iter().map(|trial| self.store.finished(&trial.id));
        let finished = finished.collect::<Result<Vec<_>, _>>()?;
        let results = table::Results {
            experiment: self.experiment,
            sweep: self.sweep,
            trials: &self.trials,
            finished: &finished,
        };
        self.record.write(file::SWEEP, &results.trials())?;
        self.record.write(file::SUMMARY, &results.summary())?;
        self.record.write(file::TIMINGS, &results.timings())?;
        let over = finished.iter().flatten();
        let failed = over.clone().filter(|finished| finished.ending != Ending::Done).count();
        let done = over.count() - failed;
        Ok(SweepMetrics { trials: self.trials.len(), done, failed })
    }

    /// Writes the tables and the report.
    fn close(mut self) -> Result<Record, BenchError> {
        let counts = self.write_tables()?;
        self.record.update(|all| all.sweep = Some(counts.clone()))?;
        rebuild_report(self.record.dir())?;
        if counts.failed > 0 {
            let SweepMetrics { trials, failed, .. } = counts;
            let table = self.record.path(file::SWEEP);
            return Err(BenchError::FailedTrials { failed, trials, table });
        }
        Ok(self.record)
    }
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
                        BenchError::Interrupted { dir: self.session.record.dir().to_owned() }
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
        let dir = self.session.store.net(id);
        let provenance = Provenance { seed: training.seed, ..self.session.provenance.clone() };
        let provenance = Provenance { config_sha256: training.fingerprint(), ..provenance };
        let outcome = train_shared(training, &dir, &provenance, self.threads, &self.options);
        let outcome = result_of_trial(outcome)?;
        self.queue.trained(trial, outcome);
        Ok(())
    }

    fn run(&self, trial: &Trial, failure: Option<String>) -> Result<(), BenchError> {
        let store = &self.session.store;
        let dir = store.begin(&trial.id)?;
        let net = trial.training.as_ref().map(|(id, _)| store.net(id));
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
        store.finish(&trial.id, &ending)?;
        let tables_are_due = self.state().finished(&ending);
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

/// How far a sweep is, and what ended it early.
struct Progress {
    stage: Stage,
    begun: Instant,
    tables: Instant,
    trials: usize,
    left_at_begin: usize,
    left: usize,
    failed: usize,
    error: Option<BenchError>,
}

impl Progress {
    fn begin(options: &Options<'_>, trials: usize, left: usize) -> Self {
        let mut stage = Stage::begin(options.verbosity, "trials", trials as u64);
        stage.advance((trials - left) as u64, String::new);
        let now = Instant::now();
        Self {
            stage,
            begun: now,
            tables: now,
            trials,
            left_at_begin: left,
            left,
            failed: 0,
            error: None,
        }
    }

    /// Notes that a trial is over; says whether it is time to write the tables.
    fn finished(&mut self, ending: &Ending) -> bool {
        self.left -= 1;
        self.failed += usize::from(*ending != Ending::Done);
        let message = self.message();
        self.stage.advance((self.trials - self.left) as u64, || message);
        let due = self.tables.elapsed() >= TABLES_EVERY;
        if due {
            self.tables = Instant::now();
        }
        due
    }

    /// What is shown beside the count.
    fn message(&self) -> String {
        #[expect(clippy::cast_precision_loss, reason = "far fewer than 2^53 trials")]
        let (done, left) = ((self.left_at_begin - self.left) as f64, self.left as f64);
        let seconds = self.begun.elapsed().as_secs_f64() / done * left;
        let time = match seconds {
            s if s < 100.0 => format!("about {s:.0} s left"),
            s if s < 6000.0 => format!("about {:.0} min left", s / 60.0),
            s => format!("about {:.1} h left", s / 3600.0),
        };
        match self.failed {
            0 => time,
            failed => format!("{failed} failed, {time}"),
        }
    }

    fn end(self) -> Result<(), BenchError> {
        match self.error {
            None => {
                let seconds = self.begun.elapsed().as_secs_f64();
                self.stage
                    .end(&format!("{} done, {} failed, {seconds:.1} s", self.trials, self.failed));
                Ok(())
            }
            Some(error) => Err(error),
        }
    }
}
