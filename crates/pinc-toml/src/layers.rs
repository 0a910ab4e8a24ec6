//! From a TOML file, a preset's defaults, `--set` and `--unset` to one table of values, every one of
//! which knows where it was written.

use crate::lines::{LineEnds, around, join, keys_in_order, line_of};
use crate::overrides::Override;
use crate::preset::{Differences, PRESETS, Preset, Presets};
use crate::problem::{ConfigError, Origin, Problem, SetProblem};
use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// A resolved table and the origin of each of its values.
#[derive(Debug)]
pub struct Layers {
    /// The table.
    pub table: Table,
    origins: Origins,
    path: PathBuf,
    text: String,
    preset: Preset,
    others: Vec<&'static str>,
    /// The overrides, as they were given.
    arguments: Vec<String>,
}

/// The origin of each value, by its key. An element of a list has the origin of the list, unless it
/// was set by itself.
type Origins = HashMap<String, Source>;

/// An [`Origin`] without its texts. In which line something stands is looked up when it is asked
/// for: a config may have very many values.
#[derive(Clone, Copy, Debug)]
enum Source {
    /// The config file.
    Text,
    /// The part of the file that is the preset's own.
    Difference,
    /// The override of this number.
    Set(usize),
    /// The defaults of the preset.
    Preset,
}

impl Layers {
    /// Lays over one another: the defaults of the chosen preset for those sections that the file or
    /// a `--set` mentions, the file's own tables, its `[presets.<chosen>]` tables, the overrides in
    /// their order. Tables are merged, everything else is replaced.
    ///
    /// An override is `key.path=value`, as TOML, or `--unset key.path`.
    ///
    /// # Errors
    ///
    /// [`ConfigError`] if the text is no TOML, names no preset, or an override cannot be applied.
    pub fn resolve(
        path: &Path,
        text: &str,
        sets: &[String],
        presets: Presets,
    ) -> Result<Self, ConfigError> {
        let mut file = parse(path, text)?;
        let sets = sets.iter().map(|s| Override::parse(s)).collect::<Result<Vec<_>, _>>()?;
        let origin = |key: &str| Origin::Line { path: path.to_owned(), line: line_of(text, key) };
        not_a_list(path, text, &file)?;
        let preset = presets.chosen(&file, &sets, &origin)?;
        let Differences { chosen: differences, others } =
            presets.take_differences(&mut file, preset.name, &origin)?;

        let mentioned: BTreeSet<&str> = (file.keys().chain(differences.keys()).map(String::as_str))
            .chain(sets.iter().filter_map(Override::section))
            .collect();
        let mut defaults = preset.defaults.clone();
        defaults.retain(|section, _| mentioned.contains(section));

        let mut layers = Self {
            table: Table::new(),
            origins: Origins::new(),
            path: path.to_owned(),
            text: text.to_owned(),
            preset,
            others,
            arguments: sets.iter().map(|set| set.argument.clone()).collect(),
        };
        lay(&mut layers.table, defaults, "", &mut layers.origins, Source::Preset);
        lay(&mut layers.table, file, "", &mut layers.origins, Source::Text);
        lay(&mut layers.table, differences, "", &mut layers.origins, Source::Difference);
        for (number, Override { argument, key, value }) in sets.into_iter().enumerate() {
            let problem = match value {
                Some(value) => layers.assign(number, &key, value).map_err(SetProblem::Path),
                None => layers.take_away(&key).map_err(SetProblem::Absent),
            };
            problem.map_err(|problem| ConfigError::Set { argument, problem })?;
        }
        Ok(layers)
    }

    /// An error about `key`, at the place where it or the nearest table around it was written.
    pub fn error(&self, key: impl Into<String>, problem: Problem) -> ConfigError {
        let mut key = key.into();
        let origin = match around(&key, |place| self.origins.get(place)) {
            Some(source) => self.origin(*source, &key),
            None => Origin::Line { path: self.path.clone(), line: 1 },
        };
        let list = key.split('[').next().unwrap_or_default();
        if matches!(self.origins.get(list), Some(Source::Difference)) {
            key = self.in_differences(&key);
        }
        ConfigError::Key { origin, key, problem: Box::new(problem) }
    }

    /// The presets that the file has tables for, besides the chosen one.
    #[must_use]
    pub fn other_presets(&self) -> &[&'static str] {
        &self.others
    }

    /// The keys of a table in the order in which the file has them, those of the preset's own part
    /// among them. Keys of defaults and overrides are none of them: their order is not known.
    pub(crate) fn keys_as_written(&self, table: &str) -> Vec<String> {
        let mut keys = keys_in_order(&self.text, &[table.to_owned(), self.in_differences(table)]);
        keys.retain(|key| {
            let origin = self.origins.get(&join(table, key));
            matches!(origin, Some(Source::Text | Source::Difference))
        });
        keys
    }

    /// A key among the differences of the preset.
    fn in_differences(&self, key: &str) -> String {
        format!("{}{key}", differences_of(self.preset.name))
    }

    fn origin(&self, source: Source, key: &str) -> Origin {
        let in_file =
            |key: &str| Origin::Line { path: self.path.clone(), line: line_of(&self.text, key) };
        match source {
            Source::Text => in_file(key),
            Source::Difference => in_file(&self.in_differences(key)),
            Source::Set(number) => Origin::Set(self.arguments[number].clone()),
            Source::Preset => Origin::Preset(self.preset.name),
        }
    }

    /// Puts a value in place of what is there; a table has the preset's defaults beneath it. Returns
    /// as much of the path as leads to something that holds no keys, if it does.
    fn assign(&mut self, number: usize, key: &str, value: Value) -> Result<(), String> {
        let mut beneath =
            Some(Value::Table(self.preset.defaults.clone())).filter(|_| value.is_table());
        for key in key.split('.') {
            beneath = beneath.and_then(|value| match value {
                Value::Table(mut table) => table.remove(key),
                _ => None,
            });
        }
        let mut whole = value.clone();
        if let (Value::Table(whole), Some(Value::Table(beneath))) = (&mut whole, beneath) {
            let over = std::mem::replace(whole, beneath);
            lay(whole, over, "", &mut Origins::new(), Source::Preset);
        }
        let (path, old) = assign(&mut self.table, key, whole.clone())?;
        forget(&mut self.origins, &path, &old);
        note(&mut self.origins, &path, &whole, Source::Preset);
        note(&mut self.origins, &path, &value, Source::Set(number));
        Ok(())
    }

    /// Takes a key away, wherever it was written. Returns the key if there is none.
    fn take_away(&mut self, key: &str) -> Result<(), String> {
        let (parents, last) = key.rsplit_once('.').unwrap_or(("", key));
        let mut path = String::new();
        let mut root = Value::Table(std::mem::take(&mut self.table));
        let mut place = Some(&mut root);
        for key in parents.split('.').filter(|key| !key.is_empty()) {
            place = place.and_then(|value| existing(value, key, &mut path));
        }
        let old = place.and_then(Value::as_table_mut).and_then(|table| table.remove(last));
        if let Value::Table(table) = root {
            self.table = table;
        }
        forget(&mut self.origins, &join(&path, last), &old.ok_or_else(|| key.to_owned())?);
        Ok(())
    }
}

/// What the keys of a file begin with that differ for a preset.
#[must_use]
pub fn differences_of(preset: &str) -> String {
    format!("{PRESETS}.{preset}.")
}

/// Puts a value under a key path as `training.phases.0.iterations`, with the tables that lack for
/// it. Returns the path as errors write it and the value that was there. The plant in the loop is the config's own unless the table
/// has another: a key in it changes a copy.
///
/// # Errors
///
/// As much of the path as leads to something that holds no keys.
pub fn assign(table: &mut Table, key: &str, value: Value) -> Result<(String, Value), String> {
    if let Some(own) = key.strip_prefix("control.plant.")
        && let Some(Value::Table(plant)) = table.get("plant").cloned()
        && own.split('.').next().is_some_and(|kind| plant.contains_key(kind))
        && let Some(Value::Table(control)) = table.get_mut("control")
    {
        control.entry("plant").or_insert(Value::Table(plant));
    }
    let mut path = String::new();
    let mut root = Value::Table(std::mem::take(table));
    let mut place = Some(&mut root);
    let mut keys = key.split('.').peekable();
    while let Some(key) = keys.next() {
        let element = keys.peek().and_then(|index| index.parse::<usize>().ok());
        let element = element.map(|index| format!("{key}[{}]", index + 1));
        // A list of parameters is written out under the names of its elements.
        let element = element.filter(|element| {
            let table = place.as_ref().and_then(|value| value.as_table());
            table.is_some_and(|table| !table.contains_key(key) && table.contains_key(element))
        });
        if element.is_some() {
            keys.next();
        }
        let key = element.as_deref().unwrap_or(key);
        place = place.and_then(|value| child(value, key, &mut path));
    }
    let old = place.map(|place| std::mem::replace(place, value));
    if let Value::Table(changed) = root {
        *table = changed;
    }
    match old {
        Some(old) => Ok((path, old)),
        None => Err(path),
    }
}

/// The value under `key`, made if it is not there; adds the key to `path`.
fn child<'a>(parent: &'a mut Value, key: &str, path: &mut String) -> Option<&'a mut Value> {
    match parent {
        Value::Table(table) => {
            *path = join(path, key);
            Some(table.entry(key).or_insert_with(|| Value::Table(Table::new())))
        }
        Value::Array(items) => {
            let item = items.get_mut(key.parse::<usize>().ok()?)?;
            *path = format!("{path}[{key}]");
            Some(item)
        }
        _ => None,
    }
}

/// The value under `key`, if it is there; adds the key to `path`.
fn existing<'a>(parent: &'a mut Value, key: &str, path: &mut String) -> Option<&'a mut Value> {
    match parent {
        Value::Table(table) => {
            *path = join(path, key);
            table.get_mut(key)
        }
        other => child(other, key, path),
    }
}

/// `top` over `base`.
fn lay(base: &mut Table, top: Table, prefix: &str, origins: &mut Origins, source: Source) {
    for (key, value) in top {
        let path = join(prefix, &key);
        match (base.get_mut(&key), value) {
            (Some(Value::Table(under)), Value::Table(over)) => {
                origins.insert(path.clone(), source);
                lay(under, over, &path, origins, source);
            }
            (old, value) => {
                if let Some(old) = old {
                    forget(origins, &path, old);
                }
                note(origins, &path, &value, source);
                base.insert(key, value);
            }
        }
    }
}

/// Notes the origin of a value and of everything in it, except in lists.
fn note(origins: &mut Origins, path: &str, value: &Value, source: Source) {
    origins.insert(path.to_owned(), source);
    if let Value::Table(table) = value {
        table.iter().for_each(|(key, value)| note(origins, &join(path, key), value, source));
    }
}

/// Drops the origins of a value that is replaced, and of all in it.
fn forget(origins: &mut Origins, path: &str, old: &Value) {
    origins.remove(path);
    match old {
        Value::Table(table) => {
            table.iter().for_each(|(key, value)| forget(origins, &join(path, key), value));
        }
        Value::Array(items) => {
            let items = items.iter().enumerate();
            items.for_each(|(i, item)| forget(origins, &format!("{path}[{i}]"), item));
        }
        _ => {}
    }
}

/// The file as a table.
fn parse(path: &Path, text: &str) -> Result<Table, ConfigError> {
    text.parse::<Table>().map_err(|error| ConfigError::Syntax {
        path: path.to_owned(),
        line: LineEnds::of(text).line_at(error.span().map_or(0, |span| span.start)),
        message: error.message().to_owned(),
    })
}

/// Refuses a list of runs in the place of an experiment.
fn not_a_list(path: &Path, text: &str, file: &Table) -> Result<(), ConfigError> {
    if !file.contains_key("runs") {
        return Ok(());
    }
    let problem = Problem::Value {
        found: "a list of runs".to_owned(),
        expected: "an experiment: one of the configs of the list (`pinc run` takes lists)"
            .to_owned(),
    };
    Err(ConfigError::at_key(path, text, "runs", problem))
}
