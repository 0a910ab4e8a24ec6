//! Who does what next: trials in their order, each after the training that it shares with others.
//! Work that another process has taken is put aside and looked at again later.

use crate::search::Eligibility;
use pinc_config::Trial;
use std::collections::{BTreeMap, HashMap, HashSet, VecDeque};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Time between two looks at what others work on.
const LOOK_EVERY: Duration = Duration::from_secs(2);
/// How many looks at others' trials in vain are enough.
const PATIENCE: usize = 60;

/// Work for one thread.
#[derive(Clone, Debug)]
pub enum Job<'a> {
    /// Train the net of this trial, which others may want too.
    Train(&'a Trial),
    /// Run this trial. If its training failed, how.
    Run(&'a Trial, Option<String>),
}

impl<'a> Job<'a> {
    /// The trial that it is about.
    #[must_use]
    pub fn trial(&self) -> &'a Trial {
        match self {
            Self::Train(trial) | Self::Run(trial, _) => trial,
        }
    }
}

/// How a job ended for the queue.
#[derive(Clone, Debug)]
pub enum Outcome {
    /// The net is trained, or the training failed and how.
    Trained(Result<(), String>),
    /// The trial is over.
    Over,
    /// Another process works on it.
    Elsewhere,
}

#[derive(Clone, Debug)]
enum Net {
    Untrained,
    InTraining,
    Trained,
    Failed(String),
    /// Another process trains it.
    Elsewhere,
}

/// The work that is left.
#[derive(Debug)]
pub struct Queue<'a> {
    state: Mutex<State<'a>>,
    /// Somebody has done something.
    changed: Condvar,
    /// Threads of this process.
    cores: usize,
    look_every: Duration,
}

#[derive(Debug)]
struct State<'a> {
    /// Whether trials are run one at a time, after all trainings.
    timed: bool,
    /// How many trials are being run.
    running: usize,
    waiting: VecDeque<&'a Trial>,
    /// Trials that may be dropped, depending on what others give.
    later: Vec<&'a Trial>,
    nets: HashMap<&'a str, Net>,
    /// The nets in training here, in the order of their beginnings.
    training: BTreeMap<usize, &'a str>,
    begun: usize,
    /// How many nets nobody has begun to train.
    untrained: usize,
    /// Trials on which, or on whose nets, others work.
    elsewhere: Vec<&'a Trial>,
    /// Looks at these since anything was done.
    looks: usize,
    stopped: bool,
}

impl<'a> Queue<'a> {
    /// The work for these trials, on as many threads.
    #[must_use]
    pub fn new(trials: impl IntoIterator<Item = &'a Trial>, timed: bool, cores: usize) -> Self {
        let mut state = State {
            timed,
            running: 0,
            waiting: VecDeque::new(),
            later: Vec::new(),
            untrained: 0,
            nets: HashMap::new(),
            training: BTreeMap::new(),
            begun: 0,
            elsewhere: Vec::new(),
            looks: 0,
            stopped: false,
        };
        trials.into_iter().for_each(|trial| state.enqueue(trial));
        Self { state: Mutex::new(state), changed: Condvar::new(), cores, look_every: LOOK_EVERY }
    }

    /// This work, followed by the part that `later` trials turn out to be.
    #[must_use]
    pub fn and_later(self, later: Vec<&'a Trial>) -> Self {
        self.lock().later = later;
        self
    }

    /// Takes up trials of which it was not known whether they are to be run, and forgets those that
    /// are not. Returns the number of these.
    pub fn reconsider(&self, eligibility: impl Fn(&Trial) -> Eligibility) -> usize {
        let mut state = self.lock();
        let (before, later) = (state.later.len(), std::mem::take(&mut state.later));
        let mut begun = 0;
        for trial in later {
            match eligibility(trial) {
                Eligibility::Open => {
                    state.enqueue(trial);
                    begun += 1;
                }
                Eligibility::Waiting => state.later.push(trial),
                Eligibility::Dropped => {}
            }
        }
        let dropped = before - begun - state.later.len();
        drop(state);
        self.changed.notify_all();
        dropped
    }

    /// How many things can be done at the same time.
    #[must_use]
    pub fn width(&self) -> usize {
        let state = self.lock();
        (state.waiting.len() + state.later.len()).min(self.cores)
    }

    /// The next job; none when there is nothing left to begin.
    pub fn next(&self) -> Option<Job<'a>> {
        let mut state = self.lock();
        loop {
            if state.stopped || state.is_over() {
                return None;
            }
            if let Some(job) = state.first() {
                return Some(job);
            }
            let waited = self.changed.wait_timeout(state, self.look_every);
            let (locked, timeout) = waited.unwrap_or_else(PoisonError::into_inner);
            state = locked;
            if timeout.timed_out() {
                state.look_elsewhere();
            }
        }
    }

    /// Notes how a job ended; without an outcome, it ended the work.
    pub fn over(&self, job: &Job<'a>, outcome: Option<Outcome>) {
        let mut state = self.lock();
        let trial = job.trial();
        match (job, &trial.training) {
            (Job::Train(_), Some((id, _))) => {
                state.training.retain(|_, other| other != id);
                let net = match outcome {
                    Some(Outcome::Trained(Ok(()))) => Net::Trained,
                    Some(Outcome::Trained(Err(error))) => Net::Failed(error),
                    Some(Outcome::Elsewhere) => Net::Elsewhere,
                    // The trial is over without it.
                    Some(Outcome::Over) | None => {
                        state.waiting.retain(|other| other.id != trial.id);
                        match state.waiting.iter().any(|other| other.unit() == id) {
                            true => {
                                state.untrained += 1;
                                Net::Untrained
                            }
                            false => Net::Trained,
                        }
                    }
                };
                state.nets.insert(id, net);
            }
            _ => {
                state.running -= 1;
                match outcome {
                    Some(Outcome::Elsewhere) => state.elsewhere.push(trial),
                    _ => state.looks = 0,
                }
            }
        }
        drop(state);
        self.changed.notify_all();
    }

    /// How many threads the training of this trial's net may use now: its share of those that
    /// nothing else needs.
    #[must_use]
    pub fn threads(&self, trial: &Trial) -> usize {
        let state = self.lock();
        let free = self.cores.saturating_sub(state.running);
        let trainings = (state.training.len() + state.untrained).min(free).max(1);
        let id = trial.training.as_ref().map(|(id, _)| id.as_str());
        let place = state.training.values().position(|other| Some(*other) == id).unwrap_or(0);
        (free / trainings + usize::from(place < free % trainings)).max(1)
    }

    /// Gives out no more work.
    pub fn stop(&self) {
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
        self.running == 0 && self.training.is_empty() && self.untrained == 0
    }

    /// Whether there is nothing left to begin, nor to wait for.
    fn is_over(&self) -> bool {
        let is_waiting = !self.elsewhere.is_empty();
        let is_working = self.running > 0 || !self.training.is_empty();
        self.waiting.is_empty()
            && match self.later.is_empty() {
                true => !is_waiting || self.looks > PATIENCE,
                // Other processes decide; if none does anything, nothing is decided any more.
                false => !is_waiting && !is_working,
            }
    }

    /// The first trial that can be run, or whose training can be begun.
    fn first(&mut self) -> Option<Job<'a>> {
        let mut i = 0;
        while i < self.waiting.len() {
            let trial = self.waiting[i];
            let net = trial.training.as_ref().map(|(id, _)| (id.as_str(), &self.nets[id.as_str()]));
            let failure = match net {
                Some((_, Net::InTraining)) => {
                    i += 1;
                    continue;
                }
                Some((_, Net::Elsewhere)) => {
                    self.elsewhere.extend(self.waiting.remove(i));
                    continue;
                }
                Some((id, Net::Untrained)) => {
                    self.begin_training(id);
                    return Some(Job::Train(trial));
                }
                Some((_, Net::Failed(error))) => Some(error.clone()),
                Some((_, Net::Trained)) | None => None,
            };
            if self.timed && !self.is_quiet() {
                i += 1;
                continue;
            }
            self.waiting.remove(i);
            self.running += 1;
            return Some(Job::Run(trial, failure));
        }
        None
    }

    fn enqueue(&mut self, trial: &'a Trial) {
        if let Some((id, _)) = &trial.training
            && !self.nets.contains_key(id.as_str())
        {
            self.nets.insert(id, Net::Untrained);
            self.untrained += 1;
        }
        self.waiting.push_back(trial);
    }

    fn begin_training(&mut self, id: &'a str) {
        self.nets.insert(id, Net::InTraining);
        self.untrained -= 1;
        self.training.insert(self.begun, id);
        self.begun += 1;
    }

    /// Puts what others work on back in the queue, if there is nothing else to do.
    fn look_elsewhere(&mut self) {
        if !self.waiting.is_empty() || self.elsewhere.is_empty() {
            return;
        }
        let nets: HashSet<_> = self.elsewhere.iter().map(|trial| trial.unit()).collect();
        // A net that several trials wait for will be work for all.
        let alone = self.elsewhere.len() <= nets.len();
        self.looks += usize::from(alone && self.running == 0 && self.training.is_empty());
        for net in self.nets.values_mut() {
            if matches!(net, Net::Elsewhere) {
                *net = Net::Untrained;
                self.untrained += 1;
            }
        }
        self.waiting.extend(self.elsewhere.drain(..));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pinc_config::{Experiment, Plants, trials};
    use std::path::Path;

    /// Trials of two nets, three of each.
    fn six() -> Vec<Trial> {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../configs/smoke/one-tank.toml");
        let sweep = "sweep={ seeds = [1, 2], grid = [{ key = \"control.n2\", also = [\"control.nu\"], values = [2, 3, 4] }] }";
        let sets = [sweep.to_owned()];
        let experiment = Experiment::load(Path::new(path), &sets, &Plants::built_in()).unwrap();
        trials(&experiment).unwrap()
    }

    fn train(queue: &Queue<'_>) {
        let Some(job @ Job::Train(_)) = queue.next() else { panic!("no training") };
        queue.over(&job, Some(Outcome::Trained(Ok(()))));
    }

    #[test]
    fn the_last_training_takes_the_free_threads() {
        let trials = six();
        let queue = Queue::new(&trials, false, 5);
        let (Some(a), Some(b)) = (queue.next(), queue.next()) else { panic!("two trainings") };
        assert!(matches!((&a, &b), (Job::Train(_), Job::Train(_))));
        assert_eq!((queue.threads(a.trial()), queue.threads(b.trial())), (3, 2));
        queue.over(&a, Some(Outcome::Trained(Ok(()))));
        assert_eq!(queue.threads(b.trial()), 5);
        let runs: Vec<_> = (0..3).map(|_| queue.next().unwrap()).collect();
        assert_eq!(queue.threads(b.trial()), 2);
        runs.iter().for_each(|job| queue.over(job, Some(Outcome::Over)));
        assert_eq!(queue.threads(b.trial()), 5);
        // More trainings than threads have one each.
        let queue = Queue::new(&trials, false, 1);
        let first = queue.next().unwrap();
        assert_eq!(queue.threads(first.trial()), 1);
    }

    #[test]
    fn what_others_do_is_looked_at_again() {
        let trials = six();
        let queue = Queue { look_every: Duration::from_millis(1), ..Queue::new(&trials, false, 2) };
        let first = queue.next().unwrap();
        queue.over(&first, Some(Outcome::Elsewhere));
        train(&queue);
        let mine: Vec<_> = (0..3).map(|_| queue.next().unwrap()).collect();
        for job in &mine {
            assert!(matches!(job, Job::Run(trial, None) if trial.unit() != first.trial().unit()));
            queue.over(job, Some(Outcome::Over));
        }
        // Three trials are worth waiting for the other's net.
        for _ in 0..2 * PATIENCE {
            let job = queue.next().unwrap();
            assert_eq!(job.trial().unit(), first.trial().unit());
            queue.over(&job, Some(Outcome::Elsewhere));
        }
        train(&queue);
        for _ in 0..3 {
            let job = queue.next().unwrap();
            queue.over(&job, Some(Outcome::Over));
        }
        assert!(queue.next().is_none());
        // A trial that another process has is left to it in the end.
        let queue =
            Queue { look_every: Duration::from_millis(1), ..Queue::new(&trials[..1], false, 2) };
        train(&queue);
        let mut tried = 0;
        while let Some(job) = queue.next() {
            queue.over(&job, Some(Outcome::Elsewhere));
            tried += 1;
        }
        assert_eq!(tried, PATIENCE + 2);
    }
}
