//! Options of a command, Ctrl-C, and the question before results are discarded.

use pinc_bench::Kept;
use pinc_config::{Experiment, Plants};
use pinc_runs::{Options, RunError, Verbosity, console};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Set by Ctrl-C.
static INTERRUPT: AtomicBool = AtomicBool::new(false);

/// The command line without the program's name.
pub(crate) fn arguments() -> Vec<String> {
    std::env::args().skip(1).collect()
}

/// What `--quiet` asks for.
pub(crate) fn verbosity(quiet: bool) -> Verbosity {
    if quiet { Verbosity::Quiet } else { Verbosity::Shown }
}

pub(crate) fn options(resume: bool, quiet: bool, arguments: &[String]) -> Options<'_> {
    Options { resume, verbosity: verbosity(quiet), interrupt: catch_interrupts(), arguments }
}

/// From now on, the first Ctrl-C asks the run to stop, and a second ends the program.
fn catch_interrupts() -> &'static AtomicBool {
    // If no handler can be set, Ctrl-C ends the program and leaves the last checkpoint.
    let _ = ctrlc::set_handler(|| {
        if INTERRUPT.swap(true, Ordering::Relaxed) {
            std::process::exit(1);
        }
        console::note("stopping after this iteration (press Ctrl-C again to stop at once)");
    });
    &INTERRUPT
}

/// With `errors`, the experiment that the net in the file `model` is judged against: from `config`, or
/// else from `config.toml` beside the model.
pub(crate) fn judged(
    errors: bool,
    model: &Path,
    config: Option<&Path>,
    plants: &Plants,
) -> Result<Option<Experiment>, RunError> {
    let beside = || model.with_file_name(pinc_record::file::CONFIG);
    let path = errors.then(|| config.map_or_else(beside, Path::to_owned));
    Ok(path.map(|path| Experiment::load(&path, &[], plants)).transpose()?)
}

/// Returns an error if starting this sweep would discard results and the user does not agree.
pub(crate) fn may_begin_afresh(experiment: &Experiment, dir: &Path) -> Result<(), RunError> {
    let Some(Kept { trials, nets }) = pinc_bench::kept(experiment, dir) else { return Ok(()) };
    let place = dir.display();
    let question = format!("{place} holds {trials} finished trials and {nets} nets. Remove them?");
    match console::confirmed(&question) {
        Some(true) => Ok(()),
        _ => Err(RunError::usage(
            place,
            format!(
                "holds results of this sweep ({trials} trials, {nets} nets); --resume continues with \
                 them, --fresh discards them"
            ),
        )),
    }
}
