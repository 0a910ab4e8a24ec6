//! From what a caller gives for a config to an experiment.

use crate::errors::of_config;
use pinc_config::{Experiment, Plants};
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether configs may start programs.
static PROCESSES: AtomicBool = AtomicBool::new(false);

#[doc = doc!("allow_processes")]
#[pyfunction]
pub(crate) fn allow_processes() {
    PROCESSES.store(true, Ordering::Relaxed);
}

/// The plants that configs may name.
pub(crate) fn plants() -> Plants {
    match PROCESSES.load(Ordering::Relaxed) {
        true => Plants::built_in().allowing_processes(),
        false => Plants::built_in(),
    }
}

/// Path, text and overrides of a config.
pub(crate) type Parts = (String, Option<String>, Vec<String>);

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
        let helpers = config.py().import("pinc_nmpc._config")?;
        let resolved = helpers.call_method1("resolve", (config, overrides))?;
        let (path, text, sets) = resolved.extract()?;
        Ok(Self { path, text, sets })
    }

    /// This one with every value spelled out: its files, those of schedules too, may be gone or others
    /// later.
    pub(crate) fn pinned(self) -> PyResult<Self> {
        Ok(Self::from_parts(self.parts_of(&self.experiment()?)))
    }

    /// What `experiment`, which is this one's, consists of, for a pickle.
    pub(crate) fn parts_of(&self, experiment: &Experiment) -> Parts {
        let path = self.path.to_string_lossy().into_owned();
        (path, Some(experiment.to_toml()), Vec::new())
    }

    /// What it consists of, for a pickle.
    pub(crate) fn parts(&self) -> Parts {
        let path = self.path.to_string_lossy().into_owned();
        (path, self.text.clone(), self.sets.clone())
    }

    /// Makes a config of its parts.
    pub(crate) fn from_parts((path, text, sets): Parts) -> Self {
        Self { path: path.into(), text, sets }
    }

    /// Reads the experiment.
    pub(crate) fn experiment(&self) -> PyResult<Experiment> {
        let Self { path, text, sets } = self;
        let plants = plants();
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

#[doc = doc!("resolved")]
#[pyfunction]
#[pyo3(signature = (config, overrides=None))]
pub(crate) fn resolved(
    config: &Bound<'_, PyAny>,
    overrides: Option<&Bound<'_, PyAny>>,
) -> PyResult<String> {
    Ok(experiment(config, overrides)?.to_toml())
}
