//! From what a caller gives for a config to an experiment.

use crate::errors::of_config;
use pinc_config::{Experiment, Plants};
use pyo3::prelude::*;
use std::path::PathBuf;

/// The experiment of a path, or of a text in TOML, with some values over its own.
pub(crate) fn experiment(
    config: &Bound<'_, PyAny>,
    overrides: Option<&Bound<'_, PyAny>>,
) -> PyResult<Experiment> {
    let helpers = config.py().import("pinc._config")?;
    let resolved = helpers.call_method1("resolve", (config, overrides))?;
    let (path, text, sets): (PathBuf, Option<String>, Vec<String>) = resolved.extract()?;
    let plants = Plants::built_in();
    let experiment = match text {
        Some(text) => Experiment::parse(&path, &text, &sets, &plants),
        None => Experiment::load(&path, &sets, &plants),
    };
    experiment.map_err(|error| of_config(&error))
}
