//! Running a config.

use crate::config::experiment;
use crate::errors::{input, of_run};
use pinc_runs::{Options, Verbosity};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

/// How often signals are looked for.
const PAUSE: Duration = Duration::from_millis(20);

/// Runs a config, with the results in a directory, which is returned.
#[pyfunction]
#[pyo3(signature = (config, out=None, overrides=None, resume=false, verbose=false))]
pub(crate) fn run_into(
    py: Python<'_>,
    config: &Bound<'_, PyAny>,
    out: Option<PathBuf>,
    overrides: Option<&Bound<'_, PyAny>>,
    resume: bool,
    verbose: bool,
) -> PyResult<PathBuf> {
    let experiment = experiment(config, overrides)?;
    if experiment.sweep.is_some() {
        return Err(input(
            "sweep: a config without this section expected; `pinc run` takes sweeps",
        ));
    }
    let dir = out.unwrap_or_else(|| PathBuf::from("runs").join(&experiment.name));
    let interrupt = AtomicBool::new(false);
    let arguments = ["pinc.run".to_owned(), experiment.name.clone()];
    let verbosity = if verbose { Verbosity::Shown } else { Verbosity::Quiet };
    let options = Options { resume, verbosity, interrupt: &interrupt, arguments: &arguments };
    // This thread looks for Ctrl-C while another works: an interrupted run can be resumed.
    let ended = py.detach(|| {
        thread::scope(|scope| {
            let work = scope.spawn(|| {
                let done = pinc_runs::run(&experiment, &dir, &options)?;
                pinc_runs::verdict(&experiment, done.metrics())
            });
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
    match ended {
        (_, Some(signal)) => Err(signal),
        (Ok(outcome), None) => outcome.map(|()| dir).map_err(|error| of_run(&error)),
        (Err(panic), None) => std::panic::resume_unwind(panic),
    }
}
