//! Timing.

use std::time::{Duration, Instant};

/// Repetitions of which a median is taken, at least.
const AT_LEAST: usize = 5;

/// Calls `sample` for `duration_s` seconds, and at least five times.
pub fn for_seconds(duration_s: f64, mut sample: impl FnMut()) {
    let begun = Instant::now();
    let mut samples = 0;
    while samples < AT_LEAST || begun.elapsed().as_secs_f64() < duration_s {
        sample();
        samples += 1;
    }
}

/// How long `work` takes, in s.
pub fn time(work: impl FnOnce()) -> f64 {
    let clock = Instant::now();
    work();
    clock.elapsed().as_secs_f64()
}

/// A moment until which there is time.
#[derive(Clone, Copy, Debug)]
pub struct Deadline {
    begun: Instant,
    length: Duration,
}

impl Deadline {
    /// That which comes in so many seconds; never, if that is too long to be said.
    pub fn in_seconds(seconds: f64) -> Self {
        let length = Duration::try_from_secs_f64(seconds.max(0.0)).unwrap_or(Duration::MAX);
        Self { begun: Instant::now(), length }
    }

    /// Whether it has come.
    pub fn is_over(self) -> bool {
        self.begun.elapsed() >= self.length
    }

    /// The whole seconds of it.
    pub fn whole_s(self) -> u64 {
        self.length.as_secs()
    }

    /// Those that are over.
    pub fn seconds_over(self) -> u64 {
        self.begun.elapsed().min(self.length).as_secs()
    }
}
