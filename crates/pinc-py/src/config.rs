//! From what a caller gives for a config to an experiment.

use crate::errors::of_config;
use pinc_config::{Experiment, Plants};
use pyo3::prelude::*;
use std::path::PathBuf;

/// What a caller gives for a config, with some values over its own.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Source {
    path: PathBuf,
    /// The config in TOML, if it is not in the file.
    text: Option<String>,
    sets: Vec<String>,
}

impl Source {
    pub(crate) fn of(
        config: &Bound<'_, PyAny>,
        overrides: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let helpers = config.py().import("pinc._config")?;
        let resolved = helpers.call_method1("resolve", (config, overrides))?;
        let (path, text, sets) = resolved.extract()?;
        Ok(Self { path, text, sets })
    }

    /// Reads the experiment.
    pub(crate) fn experiment(&self) -> PyResult<Experiment> {
        let Self { path, text, sets } = self;
        let plants = Plants::built_in();
        let experiment = match text {
            Some(text) => Experiment::parse(path, text, sets, &plants),
            None => Experiment::load(path, sets, &plants),
        };
        experiment.map_err(|error| of_config(&error))
    }
}

/// The experiment of a path, or of a text in TOML, with some values over its own.
pub(crate) fn experiment(
    config: &Bound<'_, PyAny>,
    overrides: Option<&Bound<'_, PyAny>>,
) -> PyResult<Experiment> {
    Source::of(config, overrides)?.experiment()
}
