//! How a command is called and interrupted.

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

pub(crate) fn options(resume: bool, quiet: bool, arguments: &[String]) -> Options<'_> {
    let verbosity = if quiet { Verbosity::Quiet } else { Verbosity::Shown };
    Options { resume, verbosity, interrupt: catch_interrupts(), arguments }
}

/// From now on, the first Ctrl-C asks the run to stop, and a second ends the program.
fn catch_interrupts() -> &'static AtomicBool {
    // Without a handler (there is one already, or the system has none) Ctrl-C ends the program: the
    // last checkpoint is then what is left.
    let _ = ctrlc::set_handler(|| {
        if INTERRUPT.swap(true, Ordering::Relaxed) {
            std::process::exit(1);
        }
        console::note("stopping after this iteration (once more: at once)");
    });
    &INTERRUPT
}

/// The experiment that the net in the file `model` is judged against, if it is: of a config that is
/// given, or of the one beside it.
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

/// Whether nothing of a sweep is lost if it begins now, or whoever is asked agrees.
pub(crate) fn may_begin_afresh(experiment: &Experiment, dir: &Path) -> Result<(), RunError> {
    let Some(Kept { trials, nets }) = pinc_bench::kept(experiment, dir) else { return Ok(()) };
    let place = dir.display();
    let question = format!("{place} holds {trials} finished trials and {nets} nets. Remove them?");
    match console::confirmed(&question) {
        Some(true) => Ok(()),
        _ => Err(RunError::usage(
            place,
            format!(
                "holds results of this sweep ({trials} trials, {nets} nets); --resume goes on with \
                 them, --fresh throws them away"
            ),
        )),
    }
}
