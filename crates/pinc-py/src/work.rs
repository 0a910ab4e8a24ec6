//! Work that takes long: in a thread of its own, while this one looks for Ctrl-C.

use crate::errors::of_run;
use pinc_runs::clock::Deadline;
use pinc_runs::{Options, RunError, Verbosity};
use pyo3::prelude::*;
use pyo3::sync::MutexExt;
use std::cell::{Cell, RefCell};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::Duration;

/// How often signals are looked for.
const PAUSE: Duration = Duration::from_millis(20);

thread_local! {
    /// When to look for signals next, and what one of them raises.
    static NEXT: Cell<Option<Deadline>> = const { Cell::new(None) };
    static RAISED: RefCell<Option<PyErr>> = const { RefCell::new(None) };
}

/// Whether there was Ctrl-C: what [`watched`] work on this thread asks, as often as it likes.
pub(crate) fn interrupted() -> bool {
    if NEXT.get().is_none_or(Deadline::is_over) {
        NEXT.set(Some(Deadline::in_seconds(PAUSE.as_secs_f64())));
        let signal = Python::attach(|py| py.check_signals()).err();
        RAISED.with_borrow_mut(|raised| *raised = raised.take().or(signal));
    }
    RAISED.with_borrow(Option::is_some)
}

/// Locks `mutex`, with the interpreter released while others hold it: they may need it to look for
/// signals.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    let locked = Python::attach(|py| mutex.lock_py_attached(py));
    locked.unwrap_or_else(PoisonError::into_inner)
}

/// Does `work` with the interpreter released, on this thread; it asks [`interrupted`], and if so what
/// it returns is of no use.
pub(crate) fn watched<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> PyResult<T> {
    let done = py.detach(work);
    RAISED.take().map_or(Ok(done), Err)
}

/// How a command is called.
pub(crate) struct Call {
    /// The function's name with what it works on, for the provenance.
    pub(crate) arguments: [String; 2],
    /// Whether it goes on from what its directory holds.
    pub(crate) resume: bool,
    /// Whether progress goes to standard error.
    pub(crate) verbose: bool,
}

impl Call {
    /// Does `work` with the interpreter released. Ctrl-C asks it to stop, in a state that can be
    /// resumed, and is raised once it has.
    pub(crate) fn run<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&Options<'_>) -> Result<T, RunError> + Send,
    ) -> PyResult<T> {
        let interrupt = AtomicBool::new(false);
        let verbosity = if self.verbose { Verbosity::Shown } else { Verbosity::Quiet };
        let options = Options {
            resume: self.resume,
            verbosity,
            interrupt: &interrupt,
            arguments: &self.arguments,
        };
        let (outcome, signal) = py.detach(|| {
            thread::scope(|scope| {
                let work = scope.spawn(|| work(&options));
                let mut signal = None;
                while !work.is_finished() {
                    thread::sleep(PAUSE);
                    if let Err(error) = Python::attach(|py| py.check_signals()) {
                        interrupt.store(true, Ordering::Relaxed);
                        signal = Some(error);
                    }
                }
                (work.join(), signal)
            })
        });
        match (outcome, signal) {
            (_, Some(signal)) => Err(signal),
            (Ok(outcome), None) => outcome.map_err(|error| of_run(&error)),
            (Err(panic), None) => std::panic::resume_unwind(panic),
        }
    }
}
