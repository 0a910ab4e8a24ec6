//! Results, help and errors on the terminal, with the exit codes that they mean.

use pinc_runs::{RunError, console};
use std::io::Write;
use std::process::ExitCode;

/// Prints results, unless nothing is to be shown.
///
/// # Errors
///
/// [`RunError::StandardOutput`] if they cannot be written.
pub(crate) fn show(quiet: bool, text: &str) -> Result<(), RunError> {
    if quiet { Ok(()) } else { console::line(text) }
}

/// Prints what clap has to say: help, the version, or what is wrong with the arguments.
pub(crate) fn usage(error: &clap::Error) -> ExitCode {
    match console::written(error.print().and_then(|()| std::io::stdout().flush())) {
        Ok(()) => ExitCode::from(u8::try_from(error.exit_code()).unwrap_or(2)),
        Err(error) => failure(&error),
    }
}

/// Prints an error.
pub(crate) fn failure(error: &RunError) -> ExitCode {
    console::note(&format!("error: {error}"));
    ExitCode::from(error.exit_code())
}
