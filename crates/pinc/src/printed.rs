//! Results, help and errors on the terminal, with the exit codes that they mean.

use pinc_config::ConfigError;
use pinc_runs::{Finding, RunError, Severity, console, findings_json};
use std::io::Write;
use std::path::Path;
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

/// What `pinc check --json` prints of a config that cannot be used: one finding, at the key that is
/// wrong, or else at the file.
pub(crate) fn unusable(config: &Path, error: &ConfigError) -> String {
    let place = match error {
        ConfigError::Key { key, .. } => key.clone(),
        _ => config.display().to_string(),
    };
    findings_json(&[Finding {
        severity: Severity::Error,
        place,
        what: error.to_string(),
        why: "the config cannot be used, and nothing else was examined".to_owned(),
        change: "correct this, then check again".to_owned(),
    }])
}
