//! Files of the repository, and experiments from text.

use pinc_config::{Experiment, Plants};
use std::path::{Path, PathBuf};

/// A file of the repository, by its path from the top.
pub(crate) fn repository(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(path)
}

/// The text of such a file.
pub(crate) fn read(path: &str) -> String {
    std::fs::read_to_string(repository(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// The experiment of a config with other values by `--set`, or why it is refused.
pub(crate) fn parse(text: &str, sets: &[&str]) -> Result<Experiment, String> {
    let sets: Vec<_> = sets.iter().map(|set| (*set).to_owned()).collect();
    let plants = Plants::built_in().allowing_processes();
    let parsed = Experiment::parse(Path::new("test.toml"), text, &sets, &plants);
    parsed.map_err(|error| error.to_string())
}
