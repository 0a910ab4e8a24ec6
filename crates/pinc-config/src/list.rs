//! A file that lists experiments to run one after the other.

use crate::experiment::{Experiment, read};
use crate::plants::Plants;
use crate::presets::Preset;
use crate::validate;
use pinc_toml::{ConfigError, Problem};
use serde::Deserialize;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// A list of experiments, such as all experiments of the paper.
///
/// ```toml
/// name = "both"
/// runs = [
///     { config = "van-der-pol/main.toml", presets = ["ours", "as-printed"] },
///     { config = "four-tanks/main.toml", set = ["training.phases.0.iterations=1000"] },
/// ]
/// ```
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunList {
    /// The name of the list and of the directory of its runs.
    pub name: String,
    /// The runs, in this order.
    pub runs: Vec<ListedRun>,
}

/// An experiment of a list, once for each of its presets.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ListedRun {
    /// The config file, relative to the list.
    pub config: PathBuf,
    /// The presets; the config's own if there are none.
    #[serde(default)]
    pub presets: Vec<Preset>,
    /// Values over the config's, as `--set` has them.
    #[serde(default)]
    pub set: Vec<String>,
}

impl RunList {
    /// The list in a file; none if the file is no list but a config.
    ///
    /// # Errors
    ///
    /// [`ConfigError`], which says where, which key and what was expected.
    pub fn load(path: &Path) -> Result<Option<Self>, ConfigError> {
        let text = read(path)?;
        // What is wrong with its syntax is said when it is read as a config.
        match text.parse::<Table>() {
            Ok(table) if table.contains_key("runs") => {}
            _ => return Ok(None),
        }
        let list = Self::from_text(&text);
        list.map(Some).map_err(|(key, problem)| ConfigError::at_key(path, &text, key, problem))
    }

    fn from_text(text: &str) -> Result<Self, (String, Problem)> {
        let table: Table = text.parse().unwrap_or_default();
        let list: Self = serde_path_to_error::deserialize(Value::Table(table))
            .map_err(|error| pinc_toml::explain(&error))?;
        validate::directory_name(&list.name)?;
        if list.runs.is_empty() {
            let (found, expected) = ("[]".to_owned(), "at least one { config }".to_owned());
            return Err(("runs".to_owned(), Problem::Value { found, expected }));
        }
        Ok(list)
    }

    /// The experiments with their directories in the list's, `sets` over all other values.
    ///
    /// # Errors
    ///
    /// [`ConfigError`] if one cannot be used.
    pub fn experiments(
        &self,
        path: &Path,
        sets: &[String],
        plants: &Plants,
    ) -> Result<Vec<(Experiment, PathBuf)>, ConfigError> {
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut all = Vec::new();
        for (i, run) in self.runs.iter().enumerate() {
            let named = run.presets.iter().map(|preset| Some(format!("preset={}", preset.name())));
            let presets = if run.presets.is_empty() { vec![None] } else { named.collect() };
            for preset in presets {
                let values: Vec<String> =
                    run.set.iter().cloned().chain(preset).chain(sets.iter().cloned()).collect();
                let experiment = Experiment::load(&folder.join(&run.config), &values, plants)?;
                let dir = Path::new(&experiment.name).join(experiment.preset.name());
                if all.iter().any(|(_, other)| *other == dir) {
                    let problem = Problem::Value {
                        found: format!("{} once more", dir.display()),
                        expected: "each pair of name and preset once".to_owned(),
                    };
                    return Err(ConfigError::at_key(path, "", format!("runs[{i}]"), problem));
                }
                all.push((experiment, dir));
            }
        }
        Ok(all)
    }
}
