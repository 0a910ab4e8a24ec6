//! What a sweep shows while it works: how many trials are over, and how long the rest will take.

use crate::BenchError;
use crate::clock::to_f64;
use crate::progress::{Stage, Verbosity};
use pinc_config::Experiment;
use pinc_record::{Ending, WorkerNote};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Least time between two writings of the tables while trials are running.
const TABLES_EVERY: Duration = Duration::from_secs(10);
/// The time between two writings is at least so many times as long as one takes.
const TABLES_PART: u32 = 50;

/// A process that says nothing for so long, in s, is not at work.
pub(super) const SILENCE_S: f64 = 60.0;

/// How far a sweep is, and what ended it early.
pub(super) struct Progress {
    stage: Stage,
    begun: Instant,
    tables: Instant,
    pause: Duration,
    trials: usize,
    left: usize,
    failed: usize,
    estimate: Estimate,
    pub(super) error: Option<BenchError>,
}

impl Progress {
    /// The beginning of a sweep of so many trials, `left` of which have to be run.
    pub(super) fn begin(
        verbosity: Verbosity,
        trials: usize,
        left: usize,
        estimate: Estimate,
    ) -> Self {
        let mut stage = Stage::begin(verbosity, "trials", trials as u64);
        stage.advance((trials - left) as u64, String::new);
        let now = Instant::now();
        let (tables, pause) = (now, TABLES_EVERY);
        let (begun, failed, error) = (now, 0, None);
        Self { stage, begun, tables, pause, trials, left, failed, estimate, error }
    }

    /// Notes that a training of this [`effort`] is over.
    pub(super) fn trained(&mut self, effort: f64, time: Duration) {
        self.estimate.trainings.over(effort, time);
        self.show();
    }

    /// Notes that a trial is over; says whether it is time to write the tables.
    pub(super) fn finished(&mut self, ending: &Ending, time: Duration) -> bool {
        self.estimate.trials.over(1.0, time);
        self.over(ending);
        let due = self.tables.elapsed() >= self.pause;
        if due {
            self.tables = Instant::now();
        }
        due
    }

    /// Notes that another process has finished a trial.
    pub(super) fn found(&mut self, ending: &Ending) {
        self.estimate.trials.left -= 1.0;
        self.over(ending);
    }

    /// Notes that so many trials are not run, since others are better.
    pub(super) fn dropped(&mut self, count: usize) {
        self.left = self.left.saturating_sub(count);
    }

    fn over(&mut self, ending: &Ending) {
        self.left = self.left.saturating_sub(1);
        self.failed += usize::from(*ending != Ending::Done);
        self.show();
    }

    /// Notes how long it took to write the tables: with many trials that is done less often.
    pub(super) fn wrote_tables(&mut self, time: Duration) {
        self.tables = Instant::now();
        self.pause = TABLES_EVERY.max(TABLES_PART * time);
    }

    /// The time between two writings of the tables.
    pub(super) fn pause(&self) -> Duration {
        self.pause
    }

    /// How far this process is.
    pub(super) fn note(&self) -> WorkerNote {
        let Estimate { workers, trainings, trials } = &self.estimate;
        WorkerNote {
            at_s: now_s(),
            lanes: *workers,
            trained: trainings.over,
            trained_s: trainings.seconds,
            trials: trials.over,
            trials_s: trials.seconds,
        }
    }

    fn show(&mut self) {
        let message = self.message();
        self.stage.advance((self.trials - self.left) as u64, || message);
    }

    /// What is shown beside the count.
    fn message(&self) -> String {
        let failed = (self.failed > 0).then(|| format!("{} failed", self.failed));
        let left = self.estimate.seconds().map(|seconds| format!("about {} left", span(seconds)));
        failed.into_iter().chain(left).collect::<Vec<_>>().join(", ")
    }

    pub(super) fn end(self) -> Result<(), BenchError> {
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

/// A span of time in words.
pub(super) fn span(seconds: f64) -> String {
    match seconds {
        s if s < 100.0 => format!("{s:.0} s"),
        s if s < 6000.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

/// The time in s since 1970.
pub(super) fn now_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |time| time.as_secs_f64())
}

/// How long what is left will take, judged by what is over. Trainings count by their [`effort`],
/// since those of a grid may differ by a factor of hundreds.
pub(super) struct Estimate {
    /// How much is done at the same time.
    workers: usize,
    trainings: Share,
    trials: Share,
}

/// Work of one kind.
struct Share {
    left: f64,
    over: f64,
    seconds: f64,
}

impl Estimate {
    pub(super) fn new(workers: usize, effort_of_trainings: f64, trials: f64) -> Self {
        Self {
            workers: workers.max(1),
            trainings: Share::new(effort_of_trainings),
            trials: Share::new(trials),
        }
    }

    /// What is known from several processes, if any is at work, of what is left for them.
    pub(super) fn together(notes: &[WorkerNote], trainings: f64, trials: f64) -> Option<f64> {
        let sum = |of: fn(&WorkerNote) -> f64| notes.iter().map(of).sum();
        let share = |left, over, seconds| Share { left, over, seconds };
        let alive = notes.iter().filter(|note| now_s() - note.at_s < SILENCE_S);
        let estimate = Self {
            workers: alive.map(|note| note.lanes).sum(),
            trainings: share(trainings, sum(|note| note.trained), sum(|note| note.trained_s)),
            trials: share(trials, sum(|n| n.trials), sum(|n| n.trials_s)),
        };
        if estimate.workers == 0 { None } else { estimate.seconds() }
    }

    /// In s; `None` as long as nothing of a kind is over of which there is something left.
    fn seconds(&self) -> Option<f64> {
        let both = self.trainings.seconds()? + self.trials.seconds()?;
        Some(both / to_f64(self.workers as u64))
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
pub(super) fn effort(training: &Experiment) -> f64 {
    let (Some(model), Some(spec)) = (&training.model, &training.training) else { return 0.0 };
    let config = &spec.config;
    let weights = model.parameters(training.dims());
    let points = config.collocation_points + config.initial_points;
    let iterations: u64 = config.phases.iter().map(|phase| phase.iterations).sum();
    to_f64(weights as u64) * to_f64(points as u64) * to_f64(iterations)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trainings_are_estimated_by_their_effort_and_trials_by_their_number() {
        let mut estimate = Estimate::new(2, 10.0 + 90.0, 302.0);
        assert_eq!(estimate.seconds(), None);
        estimate.trainings.over(10.0, Duration::from_secs(60));
        assert_eq!(estimate.seconds(), None, "no trial is over yet");
        estimate.trials.over(1.0, Duration::from_millis(20));
        let left = 0.5 * (9.0 * 60.0 + 301.0 * 0.02);
        assert!((estimate.seconds().unwrap() - left).abs() < 1e-9);
        estimate.trainings.over(90.0, Duration::from_secs(540));
        (0..301).for_each(|_| estimate.trials.over(1.0, Duration::from_millis(20)));
        assert!(estimate.seconds().unwrap() < 1e-9);
        // Numerical models alone: nothing is trained.
        let mut estimate = Estimate::new(1, 0.0, 3.0);
        estimate.trials.over(1.0, Duration::from_secs(2));
        assert!((estimate.seconds().unwrap() - 4.0).abs() < 1e-9);
    }
}
