//! From the errors of the libraries to exceptions.

use pinc_config::ConfigError;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::{PyErr, import_exception};

import_exception!(pinc_nmpc._errors, InputError);
import_exception!(pinc_nmpc._errors, RunError);

/// Something given that cannot be used.
pub(crate) fn input(message: impl Into<String>) -> PyErr {
    InputError::new_err(in_python(&message.into()))
}

/// A message of the libraries, which name options of the command line, with the arguments that
/// they are in Python.
fn in_python(message: &str) -> String {
    const PHRASES: [(&str, &str); 6] = [
        ("--allow-process on the command line", "pinc.allow_processes()"),
        ("--set ", "overrides, "),
        ("--unset ", "overrides, without "),
        ("--resume", "resume=True"),
        ("--model FILE", "model=.."),
        ("--only rk4", "only=\"rk4\""),
    ];
    let told = PHRASES.iter().fold(message.to_owned(), |told, (from, to)| told.replace(from, to));
    let mut parts = told.split("--");
    let mut text = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let end = part.find(|c: char| !(c.is_ascii_lowercase() || c == '-')).unwrap_or(part.len());
        let starts = text.is_empty() || text.ends_with([' ', '`', '(', '\n', '"']);
        if starts && end > 0 {
            text += &part[..end].replace('-', "_");
        } else {
            text += "--";
            text += &part[..end];
        }
        text += &part[end..];
    }
    text
}

/// An error of a run: `InputError` where the program ends with the exit code 2 for bad input.
pub(crate) fn of_run(error: &pinc_runs::RunError) -> PyErr {
    match error {
        pinc_runs::RunError::Interrupted { .. } => {
            PyKeyboardInterrupt::new_err(in_python(&error.to_string()))
        }
        _ if error.exit_code() == 2 => input(error.to_string()),
        _ => RunError::new_err(in_python(&error.to_string())),
    }
}

/// An error of a controller.
pub(crate) fn of_mpc(error: pinc_mpc::MpcError) -> PyErr {
    of_run(&error.into())
}

/// An error of a config.
pub(crate) fn of_config(error: &ConfigError) -> PyErr {
    input(error.to_string())
}
