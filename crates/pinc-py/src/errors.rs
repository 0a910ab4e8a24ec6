//! From the errors of the libraries to exceptions.

use pinc_config::ConfigError;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::{PyErr, import_exception};

import_exception!(pinc._errors, InputError);
import_exception!(pinc._errors, RunError);

/// Something given that cannot be used.
pub(crate) fn input(message: impl Into<String>) -> PyErr {
    InputError::new_err(message.into())
}

/// An error of a run: `InputError` where the program ends with the exit code 2 for bad input.
pub(crate) fn of_run(error: &pinc_runs::RunError) -> PyErr {
    match error {
        pinc_runs::RunError::Interrupted { .. } => PyKeyboardInterrupt::new_err(error.to_string()),
        _ if error.exit_code() == 2 => input(error.to_string()),
        _ => RunError::new_err(error.to_string()),
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
