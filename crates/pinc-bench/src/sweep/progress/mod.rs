//! The progress of a running sweep: finished trials and the time left.

use pinc_record::work::Estimate;
use pinc_record::{Ending, WorkerNote};
use pinc_runs::RunError;
use pinc_runs::progress::{Stage, Verbosity};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Least time between two writings of the tables while trials are running.
const TABLES_EVERY: Duration = Duration::from_secs(10);
/// The time between two writings is at least so many times as long as one takes.
const TABLES_PART: u32 = 50;

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
    pub(super) error: Option<RunError>,
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

    /// Notes that a training of this effort is over.
    pub(super) fn trained(&mut self, effort: f64, time: Duration) {
        self.estimate.trained(effort, time);
        self.show();
    }

    /// Notes that a trial is over; says whether it is time to write the tables.
    pub(super) fn finished(&mut self, ending: &Ending, time: Duration) -> bool {
        self.estimate.ran(time);
        self.over(ending);
        let due = self.tables.elapsed() >= self.pause;
        if due {
            self.tables = Instant::now();
        }
        due
    }

    /// Notes that another process has finished a trial.
    pub(super) fn found(&mut self, ending: &Ending) {
        self.estimate.found();
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
        self.estimate.note(now_s())
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

    pub(super) fn end(self) -> Result<(), RunError> {
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

#[cfg(test)]
mod tests;
