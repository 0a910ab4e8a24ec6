//! An estimate of a sweep's duration.

use crate::sweep_dir::WorkerNote;
use pinc_config::{Experiment, Trial};
use pinc_net::Ansatz;
use std::time::Duration;

/// How long the remaining work will take, judged by finished work. Trainings count by their
/// [`effort`], since they may differ by a factor of hundreds in a grid.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// How much is done at the same time.
    workers: usize,
    trainings: Share,
    trials: Share,
}

/// Work of one kind.
#[derive(Clone, Debug)]
struct Share {
    left: f64,
    over: f64,
    seconds: f64,
}

impl Estimate {
    /// An estimate for so much work, `workers` things at a time.
    #[must_use]
    pub fn new(workers: usize, effort_of_trainings: f64, trials: f64) -> Self {
        Self {
            workers: workers.max(1),
            trainings: Share::new(effort_of_trainings),
            trials: Share::new(trials),
        }
    }

    /// The remaining time of the processes at work, from the notes of several processes, as
    /// [`Estimate::seconds`]; `None` if none is at work.
    #[must_use]
    pub fn together(notes: &[WorkerNote], now_s: f64, trainings: f64, trials: f64) -> Option<f64> {
        let sum = |of: fn(&WorkerNote) -> f64| notes.iter().map(of).sum();
        let share = |left, over, seconds| Share { left, over, seconds };
        let alive = notes.iter().filter(|note| note.is_fresh(now_s));
        let estimate = Self {
            workers: alive.map(|note| note.lanes).sum(),
            trainings: share(trainings, sum(|note| note.trained), sum(|note| note.trained_s)),
            trials: share(trials, sum(|n| n.trials), sum(|n| n.trials_s)),
        };
        if estimate.workers == 0 { None } else { estimate.seconds() }
    }

    /// Notes that a training of this [`effort`] is over.
    pub fn trained(&mut self, effort: f64, time: Duration) {
        self.trainings.over(effort, time);
    }

    /// Notes that a trial is over.
    pub fn ran(&mut self, time: Duration) {
        self.trials.over(1.0, time);
    }

    /// Notes that another process has done a trial.
    pub fn found(&mut self) {
        self.trials.left -= 1.0;
    }

    /// How far this process is, `at_s` seconds after 1970.
    #[must_use]
    pub fn note(&self, at_s: f64) -> WorkerNote {
        let Self { workers, trainings, trials } = self;
        WorkerNote {
            at_s,
            lanes: *workers,
            trained: trainings.over,
            trained_s: trainings.seconds,
            trials: trials.over,
            trials_s: trials.seconds,
        }
    }

    /// In s; `None` as long as nothing of a kind is over of which there is something left.
    #[must_use]
    pub fn seconds(&self) -> Option<f64> {
        let both = self.trainings.seconds()? + self.trials.seconds()?;
        Some(both / self.workers as f64)
    }
}

impl Share {
    fn new(left: f64) -> Self {
        Self { left, over: 0.0, seconds: 0.0 }
    }

    fn over(&mut self, work: f64, time: Duration) {
        self.left -= work;
        self.over += work;
        self.seconds += time.as_secs_f64();
    }

    fn seconds(&self) -> Option<f64> {
        match self.over > 0.0 {
            // A sum of what is left may end beside 0.
            true => Some(self.left.max(0.0) * self.seconds / self.over),
            false => (self.left <= 0.0).then_some(0.0),
        }
    }
}

/// How much work a training is, in visits of a weight.
#[must_use]
pub fn effort(training: &Experiment) -> f64 {
    let (Some(model), Some(spec)) = (&training.model, &training.training) else { return 0.0 };
    let config = &spec.config;
    let weights = model.parameters(training.dims());
    let initial = match model.ansatz {
        Ansatz::HardLinear => 0,
        Ansatz::Direct => config.initial_points,
    };
    let points = config.collocation_points + initial;
    let iterations: u64 = config.phases.iter().map(|phase| phase.iterations).sum();
    weights as f64 * points as f64 * iterations as f64
}

/// Trials that are to be run, and undecided trials of `later`, each with the share of its like that
/// a search runs.
#[must_use]
pub fn expected<'t>(
    experiment: &Experiment,
    now: impl Iterator<Item = &'t Trial>,
    later: impl Iterator<Item = &'t Trial>,
) -> Vec<(&'t Trial, f64)> {
    let search = experiment.sweep.as_ref().and_then(|sweep| sweep.search.as_ref());
    let share = |trial: &Trial| {
        let (search, place) = (search?, trial.search?);
        let survivors = search.halving.as_ref()?.survivors(search.candidates, place.rung);
        Some(survivors as f64 / search.candidates as f64)
    };
    let later = later.map(|trial| (trial, share(trial).unwrap_or(1.0)));
    now.map(|trial| (trial, 1.0)).chain(later).collect()
}

#[cfg(test)]
mod tests;
