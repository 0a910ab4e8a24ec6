//! Timing.

use pinc_record::WallTimes;
use std::time::Instant;

/// Repetitions of which a median is taken, at least.
const AT_LEAST: usize = 5;

/// Calls `sample` for `duration_s` seconds, and at least five times.
pub(crate) fn for_seconds(duration_s: f64, mut sample: impl FnMut()) {
    let begun = Instant::now();
    let mut samples = 0;
    while samples < AT_LEAST || begun.elapsed().as_secs_f64() < duration_s {
        sample();
        samples += 1;
    }
}

/// How long `work` takes, in s.
pub(crate) fn time(work: impl FnOnce()) -> f64 {
    let clock = Instant::now();
    work();
    clock.elapsed().as_secs_f64()
}

/// The median of at least one number.
pub(crate) fn median(values: &[f64]) -> f64 {
    WallTimes::of(values.to_vec()).median
}

#[expect(clippy::cast_precision_loss, reason = "numbers of points and operations below 2^53")]
pub(crate) fn to_f64(n: u64) -> f64 {
    n as f64
}
