//! The preset of a file, and what the file has for it.

use crate::lines::join;
use crate::overrides::Override;
use crate::problem::{ConfigError, Origin, Problem};
use toml::{Table, Value};

/// The name of the table of a file that holds what differs between presets.
pub(crate) const PRESETS: &str = "presets";

/// The presets that a file can choose from.
#[derive(Clone, Copy, Debug)]
pub struct Presets {
    /// Their names, each with its defaults as TOML.
    pub texts: &'static [(&'static str, &'static str)],
    /// What errors say is expected where a file names none.
    pub expected: &'static str,
}

/// A preset with its defaults.
#[derive(Debug)]
pub(crate) struct Preset {
    pub(crate) name: &'static str,
    pub(crate) defaults: Table,
}

/// What a file has for its presets.
pub(crate) struct Differences {
    /// For the chosen one.
    pub(crate) chosen: Table,
    /// The names of the others that it has something for.
    pub(crate) others: Vec<&'static str>,
}

impl Presets {
    /// The name and the defaults of a preset.
    fn named(self, name: &str) -> Option<(&'static str, &'static str)> {
        self.texts.iter().copied().find(|(known, _)| *known == name)
    }

    fn unknown(self, name: &str) -> Problem {
        let known: Vec<_> = self.texts.iter().map(|(known, _)| (*known).to_owned()).collect();
        Problem::word(name, &known)
    }

    /// The preset that an override or the file names.
    ///
    /// # Panics
    ///
    /// If its defaults are no TOML.
    pub(crate) fn chosen(
        self,
        file: &Table,
        sets: &[Override],
        in_file: &dyn Fn(&str) -> Origin,
    ) -> Result<Preset, ConfigError> {
        let set = sets.iter().rev().find(|s| s.key == "preset");
        let (value, origin) = match set {
            Some(set) => (set.value.as_ref(), Some(Origin::Set(set.argument.clone()))),
            None => (file.get("preset"), None),
        };
        let problem = match value {
            None => Problem::Missing(self.expected),
            Some(Value::String(name)) => match self.named(name) {
                Some((name, text)) => {
                    let defaults = text.parse().expect("the defaults of presets are valid TOML");
                    return Ok(Preset { name, defaults });
                }
                None => self.unknown(name),
            },
            Some(other) => Problem::Type(format!(
                "invalid type: {}, expected the name of a preset",
                other.type_str()
            )),
        };
        let origin = origin.unwrap_or_else(|| in_file("preset"));
        Err(ConfigError::Key { origin, key: "preset".to_owned(), problem: Box::new(problem) })
    }

    /// Takes `[presets]` out of the file and returns the tables of the chosen one.
    pub(crate) fn take_differences(
        self,
        file: &mut Table,
        chosen: &str,
        origin: &dyn Fn(&str) -> Origin,
    ) -> Result<Differences, ConfigError> {
        let fail = |key: String, problem| {
            Err(ConfigError::Key { origin: origin(&key), key, problem: Box::new(problem) })
        };
        let wrong_type = |value: &Value| {
            Problem::Type(format!("invalid type: {}, expected a table", value.type_str()))
        };
        let mut found = Differences { chosen: Table::new(), others: Vec::new() };
        let presets = match file.remove(PRESETS) {
            None => return Ok(found),
            Some(Value::Table(presets)) => presets,
            Some(other) => return fail(PRESETS.to_owned(), wrong_type(&other)),
        };
        for (name, value) in presets {
            match (self.named(&name), value) {
                (None, _) => return fail(join(PRESETS, &name), self.unknown(&name)),
                (Some(_), Value::Table(table)) if name == chosen => found.chosen = table,
                (Some((name, _)), Value::Table(_)) => found.others.push(name),
                (Some(_), other) => return fail(join(PRESETS, &name), wrong_type(&other)),
            }
        }
        Ok(found)
    }
}
