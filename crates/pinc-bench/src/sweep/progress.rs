//! What a sweep shows while it works: how many trials are over, and how long the rest will take.

use crate::BenchError;
use crate::clock::to_f64;
use crate::progress::{Stage, Verbosity};
use pinc_config::Experiment;
use pinc_record::Ending;
use std::time::{Duration, Instant};

/// Least time between two writings of the tables while trials are running.
const TABLES_EVERY: Duration = Duration::from_secs(10);

/// How far a sweep is, and what ended it early.
pub(super) struct Progress {
    stage: Stage,
    begun: Instant,
    tables: Instant,
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
        Self { stage, begun: now, tables: now, trials, left, failed: 0, estimate, error: None }
    }

    /// Notes that a training of this [`effort`] is over.
    pub(super) fn trained(&mut self, effort: f64, time: Duration) {
        self.estimate.trainings.over(effort, time);
        self.show();
    }

    /// Notes that a trial is over; says whether it is time to write the tables.
    pub(super) fn finished(&mut self, ending: &Ending, time: Duration) -> bool {
        self.left -= 1;
        self.failed += usize::from(*ending != Ending::Done);
        self.estimate.trials.over(1.0, time);
        self.show();
        let due = self.tables.elapsed() >= TABLES_EVERY;
        if due {
            self.tables = Instant::now();
        }
        due
    }

    fn show(&mut self) {
        let message = self.message();
        self.stage.advance((self.trials - self.left) as u64, || message);
    }

    /// What is shown beside the count.
    fn message(&self) -> String {
        let failed = (self.failed > 0).then(|| format!("{} failed", self.failed));
        let left = self.estimate.seconds().map(|seconds| match seconds {
            s if s < 100.0 => format!("about {s:.0} s left"),
            s if s < 6000.0 => format!("about {:.0} min left", s / 60.0),
            s => format!("about {:.1} h left", s / 3600.0),
        });
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
    pub(super) fn new(workers: usize, effort_of_trainings: f64, trials: usize) -> Self {
        Self {
            workers: workers.max(1),
            trainings: Share::new(effort_of_trainings),
            trials: Share::new(to_f64(trials as u64)),
        }
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
        let mut estimate = Estimate::new(2, 10.0 + 90.0, 302);
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
        let mut estimate = Estimate::new(1, 0.0, 3);
        estimate.trials.over(1.0, Duration::from_secs(2));
        assert!((estimate.seconds().unwrap() - 4.0).abs() < 1e-9);
    }
}
