//! Work that ends at a deadline.

use pinc_runs::clock::Deadline;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// How often a deadline is looked at.
const LOOK_EVERY: Duration = Duration::from_millis(20);

/// Does `work` with a flag that says when to stop: at the `deadline`, if there is one, or when
/// `user` is true.
pub(super) fn until<T>(
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
