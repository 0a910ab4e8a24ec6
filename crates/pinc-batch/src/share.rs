//! Items of work, shared by threads.

use std::num::NonZero;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

/// How many items a thread takes at a time.
const AT_ONCE: usize = 16;

/// How many threads there are to be: all cores for 0.
pub(crate) fn threads(wanted: usize) -> usize {
    match wanted {
        0 => thread::available_parallelism().map_or(1, NonZero::get),
        wanted => wanted,
    }
}

/// Returns what `job` makes of each item, in their order; each worker is used by one thread.
/// Threads take items as they come, so that `job` must not depend on what its worker did before.
/// If `interrupted`, which this thread asks from time to time, some of the last are missing.
pub(crate) fn share<W: Send, R: Send>(
    workers: &mut [W],
    items: usize,
    interrupted: impl Fn() -> bool,
    job: impl Fn(&mut W, usize) -> R + Sync,
) -> Vec<R> {
    let next = AtomicUsize::new(0);
    let work = |worker: &mut W, begin: &dyn Fn()| {
        let mut done = Vec::new();
        loop {
            begin();
            let first = next.fetch_add(AT_ONCE, Ordering::Relaxed);
            if first >= items {
                return done;
            }
            let last = items.min(first + AT_ONCE);
            done.push((first, (first..last).map(|item| job(worker, item)).collect::<Vec<R>>()));
        }
    };
    let most = items.div_ceil(AT_ONCE).clamp(1, workers.len());
    let mut parts = thread::scope(|scope| {
        let (own, others) = workers[..most].split_at_mut(1);
        let others: Vec<_> =
            others.iter_mut().map(|worker| scope.spawn(|| work(worker, &|| ()))).collect();
        let stop = || {
            if interrupted() {
                next.store(items, Ordering::Relaxed);
            }
        };
        let mut parts: Vec<_> = own.iter_mut().flat_map(|worker| work(worker, &stop)).collect();
        for other in others {
            match other.join() {
                Ok(part) => parts.extend(part),
                Err(panic) => std::panic::resume_unwind(panic),
            }
        }
        parts
    });
    parts.sort_by_key(|(first, _)| *first);
    parts.into_iter().flat_map(|(_, part)| part).collect()
}
