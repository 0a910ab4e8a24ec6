//! The threads that work on a sweep.

use super::Session;
use super::progress::Progress;
use pinc_config::Trial;
use pinc_record::work::{Job, Outcome, Queue, effort};
use pinc_record::{Ending, Finished, RecordError, RunDir, SweepDir};
use pinc_runs::{Options, RunError, Threads, run_trial, train_shared, verdict};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Time between two notes of how far this process is.
const NOTE_EVERY: Duration = Duration::from_secs(5);

pub(super) struct Crew<'a, 's> {
    pub(super) session: &'a Session<'s>,
    pub(super) options: Options<'a>,
    pub(super) queue: Queue<'a>,
    pub(super) state: Mutex<Progress>,
}

impl<'a> Crew<'a, '_> {
    /// Does all the work, on so many threads.
    pub(super) fn work(self, workers: usize) -> Result<(), RunError> {
        let (over, ended) = channel::<()>();
        std::thread::scope(|scope| {
            let crew = &self;
            scope.spawn(move || crew.keep_notes(&ended));
            let workers: Vec<_> = (0..workers).map(|_| scope.spawn(|| self.do_jobs())).collect();
            let ends: Vec<_> = workers.into_iter().map(|worker| worker.join()).collect();
            drop(over);
            // What panicked here does so there.
            for end in ends {
                end.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            }
        });
        self.state.into_inner().unwrap_or_else(PoisonError::into_inner).end()
    }

    /// Tells others how far this process is, until there is no more to tell.
    fn keep_notes(&self, ended: &std::sync::mpsc::Receiver<()>) {
        let (dir, name) = (&self.session.sweep_dir, super::worker_name());
        // Failing to write a note is harmless.
        let _ = dir.write_note(&name, &self.state().note());
        while ended.recv_timeout(NOTE_EVERY) == Err(RecvTimeoutError::Timeout) {
            let note = self.state().note();
            let _ = dir.write_note(&name, &note);
        }
        dir.remove_note(&name);
    }

    /// Does one job after the other until there is none.
    fn do_jobs(&self) {
        let _guard = StopIfPanicking(&self.queue);
        while let Some(job) = self.queue.next() {
            let outcome = self.look_up(job.trial()).and_then(|over| match (&job, over) {
                (_, true) => Ok(Outcome::Over),
                (Job::Train(trial), _) => self.train(trial),
                (Job::Run(trial, failure), _) => self.run(trial, failure.clone()),
            });
            match outcome {
                Ok(outcome) => {
                    if matches!(outcome, Outcome::Over) {
                        self.reconsider();
                    }
                    self.queue.over(&job, Some(outcome));
                }
                Err(error) => {
                    self.queue.over(&job, None);
                    self.stop(error);
                }
            }
        }
    }

    /// Lets a search decide who is still in it.
    fn reconsider(&self) {
        if !self.session.halves() {
            return;
        }
        let eligibility = self.session.ledger().eligibility_by_id();
        let dropped = self.queue.reconsider(|trial| eligibility[trial.id.as_str()]);
        self.state().dropped(dropped);
    }

    fn stop(&self, error: RunError) {
        let error = match error {
            RunError::Interrupted { .. } => {
                RunError::Interrupted { dir: self.session.run_dir.dir().to_owned() }
            }
            other => other,
        };
        self.state().error.get_or_insert(error);
        self.queue.stop();
    }

    /// Whether another process has finished the trial.
    fn look_up(&self, trial: &Trial) -> Result<bool, RunError> {
        if !self.session.shared {
            return Ok(false);
        }
        let Some(finished) = self.session.sweep_dir.finished(&trial.id)? else { return Ok(false) };
        if !self.session.ledger().knows(trial) {
            self.session.ledger().note(trial, &finished);
            self.state().found(&finished.ending);
        }
        Ok(true)
    }

    fn train(&self, trial: &'a Trial) -> Result<Outcome, RunError> {
        let Some((id, training)) = &trial.training else { return Ok(Outcome::Trained(Ok(()))) };
        let (sweep_dir, begun) = (&self.session.sweep_dir, Instant::now());
        if sweep_dir.is_trained(id) {
            return Ok(Outcome::Trained(Ok(())));
        }
        let threads = || self.queue.threads(trial);
        let threads = Threads::new(&threads);
        let dir = sweep_dir.net(id);
        let outcome = train_shared(training, &dir, &self.session.begun, &threads, &self.options);
        if self.session.shared
            && matches!(outcome, Err(RunError::Record(RecordError::Locked { .. })))
        {
            return Ok(Outcome::Elsewhere);
        }
        let outcome = result_of_trial(outcome)?;
        self.state().trained(effort(training), begun.elapsed());
        Ok(Outcome::Trained(outcome))
    }

    fn run(&self, trial: &Trial, failure: Option<String>) -> Result<Outcome, RunError> {
        let (session, begun) = (self.session, Instant::now());
        let mut claim = None;
        if session.shared {
            claim = session.sweep_dir.claim(&trial.id, std::process::id())?;
            if claim.is_none() {
                return Ok(Outcome::Elsewhere);
            }
            // It may have been finished before it was claimed.
            if self.look_up(trial)? {
                return Ok(Outcome::Over);
            }
        }
        let how = (session.sweep.keep_traces, failure);
        let finished = finish_trial(&session.sweep_dir, trial, how, &self.options)?;
        session.sweep_dir.finish(&trial.id, &finished)?;
        drop(claim);
        session.ledger().note(trial, &finished);
        let tables_are_due = self.state().finished(&finished.ending, begun.elapsed());
        if tables_are_due && session.tables_are_old(self.state().pause()) {
            let begun = Instant::now();
            session.write_tables()?;
            self.state().wrote_tables(begun.elapsed());
        }
        Ok(Outcome::Over)
    }

    fn state(&self) -> MutexGuard<'_, Progress> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Runs a trial, whose training is over, in its directory, and says how it ended; a training that
/// failed is the trial's own failure.
pub(crate) fn finish_trial(
    sweep_dir: &SweepDir,
    trial: &Trial,
    (keep_traces, failure): (bool, Option<String>),
    options: &Options<'_>,
) -> Result<Finished, RunError> {
    let dir = sweep_dir.begin(&trial.id)?;
    let mut run_dir = RunDir::of_trial(&dir, &trial.experiment, keep_traces);
    let net = trial.training.as_ref().map(|(id, _)| sweep_dir.net(id));
    let outcome = match failure {
        Some(error) => Err(error),
        None => {
            let run = run_trial(&trial.experiment, net.as_deref(), &mut run_dir, options);
            result_of_trial(run)?.and_then(|()| {
                verdict(&trial.experiment, run_dir.metrics()).map_err(|error| error.to_string())
            })
        }
    };
    let ending = match outcome {
        Ok(()) => Ending::Done,
        Err(error) => Ending::Failed { error },
    };
    Ok(Finished { ending, metrics: run_dir.metrics().clone() })
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

/// Tells an error that is the trial's own from one that ends the sweep.
fn result_of_trial(outcome: Result<(), RunError>) -> Result<Result<(), String>, RunError> {
    match outcome {
        Ok(()) => Ok(Ok(())),
        Err(error) if error.is_of_this_run() => Ok(Err(error.to_string())),
        Err(error) => Err(error),
    }
}
