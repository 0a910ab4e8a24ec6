//! Who does what next: trials in their order, each after the training that it shares with others.

use pinc_config::Trial;
use std::collections::{HashMap, VecDeque};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// Work for one thread.
#[derive(Clone, Debug)]
pub(crate) enum Job<'a> {
    /// Train the net of this trial, which others may want too.
    Train(&'a Trial),
    /// Run this trial. If its training failed, how.
    Run(&'a Trial, Option<String>),
}

#[derive(Clone, Debug)]
enum Net {
    Untrained,
    InTraining,
    Trained,
    Failed(String),
}

/// The work that is left.
#[derive(Debug)]
pub(crate) struct Queue<'a> {
    state: Mutex<State<'a>>,
    /// Somebody has done something.
    changed: Condvar,
}

#[derive(Debug)]
struct State<'a> {
    /// Whether trials are run one at a time, after all trainings.
    timed: bool,
    /// How many jobs are being done.
    busy: usize,
    waiting: VecDeque<&'a Trial>,
    nets: HashMap<&'a str, Net>,
    stopped: bool,
}

impl<'a> Queue<'a> {
    /// The work for these trials.
    pub(crate) fn new(trials: impl IntoIterator<Item = &'a Trial>, timed: bool) -> Self {
        let waiting: VecDeque<_> = trials.into_iter().collect();
        let ids = waiting.iter().filter_map(|trial| trial.training.as_ref());
        let nets = ids.map(|(id, _)| (id.as_str(), Net::Untrained)).collect();
        let state = Mutex::new(State { timed, busy: 0, waiting, nets, stopped: false });
        Self { state, changed: Condvar::new() }
    }

    /// How many things can be done at the same time, at most.
    pub(crate) fn width(&self) -> usize {
        let state = self.lock();
        if state.nets.is_empty() { state.waiting.len() } else { state.nets.len() }
    }

    /// The next job; none when there is nothing left to begin.
    pub(crate) fn next(&self) -> Option<Job<'a>> {
        let mut state = self.lock();
        loop {
            if state.stopped || state.waiting.is_empty() {
                return None;
            }
            if let Some(job) = state.first() {
                state.busy += 1;
                return Some(job);
            }
            state = self.changed.wait(state).unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Notes that a job is over, however it ended.
    pub(crate) fn over(&self) {
        self.lock().busy -= 1;
        self.changed.notify_all();
    }

    /// Notes how a training ended.
    pub(crate) fn trained(&self, trial: &'a Trial, outcome: Result<(), String>) {
        if let Some((id, _)) = &trial.training {
            let net = outcome.map_or_else(Net::Failed, |()| Net::Trained);
            self.lock().nets.insert(id, net);
        }
        self.changed.notify_all();
    }

    /// Gives out no more work.
    pub(crate) fn stop(&self) {
        self.lock().stopped = true;
        self.changed.notify_all();
    }

    fn lock(&self) -> MutexGuard<'_, State<'a>> {
        // A thread that panicked has left the queue as it was: it changes in single steps.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<'a> State<'a> {
    /// Whether nothing would disturb a measurement of time, now or soon.
    fn is_quiet(&self) -> bool {
        let trained = |net: &Net| matches!(net, Net::Trained | Net::Failed(_));
        self.busy == 0 && self.nets.values().all(trained)
    }

    /// The first trial that can be run, or whose training can be begun.
    fn first(&mut self) -> Option<Job<'a>> {
        for i in 0..self.waiting.len() {
            let trial = self.waiting[i];
            let net = trial.training.as_ref().map(|(id, _)| (id.as_str(), &self.nets[id.as_str()]));
            let failure = match net {
                Some((_, Net::InTraining)) => continue,
                Some((id, Net::Untrained)) => {
                    self.nets.insert(id, Net::InTraining);
                    return Some(Job::Train(trial));
                }
                Some((_, Net::Failed(error))) => Some(error.clone()),
                Some((_, Net::Trained)) | None => None,
            };
            if self.timed && !self.is_quiet() {
                continue;
            }
            self.waiting.remove(i);
            return Some(Job::Run(trial, failure));
        }
        None
    }
}
