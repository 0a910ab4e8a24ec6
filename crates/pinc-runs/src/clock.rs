//! Timing.

use pinc_record::WallTimes;
use std::sync::atomic::{AtomicBool, Ordering};
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

/// The median of at least one number.
pub fn median(values: &[f64]) -> f64 {
    WallTimes::of(values.to_vec()).median
}

/// A number of points or operations.
#[must_use]
#[expect(clippy::cast_precision_loss, reason = "numbers of points and operations below 2^53")]
pub fn to_f64(n: u64) -> f64 {
    n as f64
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

/// How often a deadline is looked at.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// Does `work` with a flag that says when to stop: at the `deadline`, if there is one, or when
/// `user` is true.
pub fn until<T>(
    deadline: Option<Deadline>,
    user: &AtomicBool,
    work: impl FnOnce(&AtomicBool) -> T,
) -> T {
    let Some(deadline) = deadline else { return work(user) };
    let (stop, is_done) = (AtomicBool::new(false), AtomicBool::new(false));
    std::thread::scope(|scope| {
        let watch = scope.spawn(|| {
            while !is_done.load(Ordering::Relaxed) {
                if user.load(Ordering::Relaxed) || deadline.is_over() {
                    stop.store(true, Ordering::Relaxed);
                }
                std::thread::park_timeout(LOOK_EVERY);
            }
        });
        // Also if the work panics, or the watch would wait for ever.
        let _done = WhenDropped(|| {
            is_done.store(true, Ordering::Relaxed);
            watch.thread().unpark();
        });
        work(&stop)
    })
}

/// Does something when it is dropped.
struct WhenDropped<F: Fn()>(F);

impl<F: Fn()> Drop for WhenDropped<F> {
    fn drop(&mut self) {
        (self.0)();
    }
}
