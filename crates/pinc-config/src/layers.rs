//! From a TOML file, a preset's defaults, `--set` and `--unset` to one table of values, every one of
//! which knows where it was written.

use crate::presets::Preset;
use crate::problem::{ConfigError, Origin, Problem, SetProblem};
use std::collections::{BTreeSet, HashMap};
use std::path::{Path, PathBuf};
use toml::de::{DeTable, DeValue};
use toml::{Spanned, Table, Value};

/// The name of the table of a config file that holds what differs between presets.
const PRESETS: &str = "presets";

/// A resolved table and the origin of each of its values.
#[derive(Debug)]
pub(crate) struct Layers {
    pub(crate) table: Table,
    origins: Origins,
    path: PathBuf,
    text: String,
    preset: Preset,
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
    File,
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
    pub(crate) fn resolve(path: &Path, text: &str, sets: &[String]) -> Result<Self, ConfigError> {
        let mut file = parse(path, text)?;
        let sets = sets.iter().map(|s| Override::parse(s)).collect::<Result<Vec<_>, _>>()?;
        let origin = |key: &str| Origin::File { path: path.to_owned(), line: line_of(text, key) };
        not_a_list(&file, &origin)?;
        let preset = chosen_preset(&file, &sets, &origin)?;
        let differences = take_differences(&mut file, preset, &origin)?;

        let mentioned: BTreeSet<&str> = (file.keys().chain(differences.keys()).map(String::as_str))
            .chain(sets.iter().filter_map(Override::section))
            .collect();
        let mut defaults = preset.defaults();
        defaults.retain(|section, _| mentioned.contains(section));

        let mut layers = Self {
            table: Table::new(),
            origins: Origins::new(),
            path: path.to_owned(),
            text: text.to_owned(),
            preset,
            arguments: sets.iter().map(|set| set.argument.clone()).collect(),
        };
        lay(&mut layers.table, defaults, "", &mut layers.origins, Source::Preset);
        lay(&mut layers.table, file, "", &mut layers.origins, Source::File);
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
    pub(crate) fn error(&self, key: impl Into<String>, problem: Problem) -> ConfigError {
        let key = key.into();
        let origin = match around(&key, |place| self.origins.get(place)) {
            Some(source) => self.origin(*source, &key),
            None => Origin::File { path: self.path.clone(), line: 1 },
        };
        ConfigError::Key { origin, key, problem: Box::new(problem) }
    }

    fn origin(&self, source: Source, key: &str) -> Origin {
        let in_file =
            |key: &str| Origin::File { path: self.path.clone(), line: line_of(&self.text, key) };
        match source {
            Source::File => in_file(key),
            Source::Difference => in_file(&format!("{PRESETS}.{}.{key}", self.preset.name())),
            Source::Set(number) => Origin::Set(self.arguments[number].clone()),
            Source::Preset => Origin::Preset(self.preset.name()),
        }
    }

    /// The key of the first number that is NaN, or infinite where that means nothing, and the number.
    pub(crate) fn first_not_finite(&self) -> Option<(String, f64)> {
        /// The rest of the key, and the number.
        fn search(value: &Value) -> Option<(String, f64)> {
            match value {
                Value::Float(v) if !v.is_finite() => Some((String::new(), *v)),
                Value::Array(items) => items.iter().enumerate().find_map(|(i, item)| {
                    search(item).map(|(rest, v)| (format!("[{i}]{rest}"), v))
                }),
                Value::Table(table) => table.iter().find_map(|(key, value)| {
                    search(value).map(|(rest, v)| (format!(".{key}{rest}"), v))
                }),
                _ => None,
            }
        }
        let mut table = self.table.clone();
        unbounded(&mut table);
        let of = |(key, value): (&String, &Value)| {
            search(value).map(|(rest, v)| (format!("{key}{rest}"), v))
        };
        table.iter().find_map(of)
    }

    /// Puts a value in place of what is there; a table has the preset's defaults beneath it. Returns
    /// as much of the path as leads to something that holds no keys, if it does.
    fn assign(&mut self, number: usize, key: &str, value: Value) -> Result<(), String> {
        let mut beneath = Some(Value::Table(self.preset.defaults())).filter(|_| value.is_table());
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
        let mut keys = parents.split('.').filter(|key| !key.is_empty());
        let table = keys.try_fold(&mut self.table, |table, key| table.get_mut(key)?.as_table_mut());
        let old = table.and_then(|table| table.remove(last)).ok_or_else(|| key.to_owned())?;
        forget(&mut self.origins, key, &old);
        Ok(())
    }
}

/// Puts a value under a key path as `training.phases.0.iterations`, with the tables that lack for
/// it. Returns the path as errors write it and the value that was there, or as much of the path as
/// leads to something that holds no keys. The plant in the loop is the config's own unless the table
/// has another: a key in it changes a copy.
pub(super) fn assign(
    table: &mut Table,
    key: &str,
    value: Value,
) -> Result<(String, Value), String> {
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
    for key in key.split('.') {
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

fn join(prefix: &str, key: &str) -> String {
    if prefix.is_empty() { key.to_owned() } else { format!("{prefix}.{key}") }
}

/// The file as a table.
fn parse(path: &Path, text: &str) -> Result<Table, ConfigError> {
    text.parse::<Table>().map_err(|error| ConfigError::Syntax {
        path: path.to_owned(),
        line: LineEnds::of(text).line_at(error.span().map_or(0, |span| span.start)),
        message: error.message().to_owned(),
    })
}

fn note_lines(
    ends: &LineEnds,
    prefix: &str,
    table: &DeTable<'_>,
    lines: &mut HashMap<String, usize>,
) {
    for (key, value) in table {
        let path = join(prefix, key.get_ref());
        lines.insert(path.clone(), ends.line_at(key.span().start));
        note_lines_within(ends, &path, value, lines);
    }
}

fn note_lines_within(
    ends: &LineEnds,
    path: &str,
    value: &Spanned<DeValue<'_>>,
    lines: &mut HashMap<String, usize>,
) {
    match value.get_ref() {
        DeValue::Table(table) => note_lines(ends, path, table, lines),
        DeValue::Array(items) => {
            for (i, item) in items.iter().enumerate() {
                let path = format!("{path}[{i}]");
                lines.insert(path.clone(), ends.line_at(item.span().start));
                note_lines_within(ends, &path, item, lines);
            }
        }
        _ => {}
    }
}

/// Where the lines of a text end.
struct LineEnds(Vec<usize>);

impl LineEnds {
    fn of(text: &str) -> Self {
        Self(text.match_indices('\n').map(|(byte, _)| byte).collect())
    }

    /// The line of a byte, from 1.
    fn line_at(&self, byte: usize) -> usize {
        1 + self.0.partition_point(|&end| end < byte)
    }
}

/// The line of a key in the text of a file, or of the innermost table around it that the file has.
fn line_of(text: &str, key: &str) -> usize {
    let mut lines = HashMap::new();
    if let Ok(spanned) = DeTable::parse(text) {
        note_lines(&LineEnds::of(text), "", spanned.get_ref(), &mut lines);
    }
    around(key, |place| lines.get(place)).copied().unwrap_or(1)
}

/// What there is for a key, or for the innermost table or list around it that has something.
fn around<T>(key: &str, of: impl Fn(&str) -> Option<T>) -> Option<T> {
    let mut place = key;
    loop {
        if let Some(found) = of(place) {
            return Some(found);
        }
        place = &place[..place.rfind(['.', '['])?];
    }
}

/// Refuses a list of runs in the place of an experiment.
fn not_a_list(file: &Table, in_file: &dyn Fn(&str) -> Origin) -> Result<(), ConfigError> {
    if !file.contains_key("runs") {
        return Ok(());
    }
    let problem = Problem::Value {
        found: "a list of runs".to_owned(),
        expected: "an experiment: one of the configs of the list (`pinc run` takes lists)"
            .to_owned(),
    };
    Err(ConfigError::Key {
        origin: in_file("runs"),
        key: "runs".to_owned(),
        problem: Box::new(problem),
    })
}

fn chosen_preset(
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
        None => {
            Problem::Missing("the name of a preset: \"ours\", \"as-printed\" or \"as-released\"")
        }
        Some(Value::String(name)) => match Preset::named(name) {
            Some(preset) => return Ok(preset),
            None => unknown_preset(name),
        },
        Some(other) => Problem::Type(format!(
            "invalid type: {}, expected the name of a preset",
            other.type_str()
        )),
    };
    let origin = origin.unwrap_or_else(|| in_file("preset"));
    Err(ConfigError::Key { origin, key: "preset".to_owned(), problem: Box::new(problem) })
}

fn unknown_preset(name: &str) -> Problem {
    let known: Vec<_> = Preset::ALL.iter().map(|p| p.name().to_owned()).collect();
    Problem::word(name, &known)
}

/// Takes `[presets]` out of the file and returns the tables of the chosen one.
fn take_differences(
    file: &mut Table,
    chosen: Preset,
    origin: &dyn Fn(&str) -> Origin,
) -> Result<Table, ConfigError> {
    let fail = |key: String, problem| {
        Err(ConfigError::Key { origin: origin(&key), key, problem: Box::new(problem) })
    };
    let wrong_type = |value: &Value| {
        Problem::Type(format!("invalid type: {}, expected a table", value.type_str()))
    };
    let mut presets = match file.remove(PRESETS) {
        None => return Ok(Table::new()),
        Some(Value::Table(presets)) => presets,
        Some(other) => return fail(PRESETS.to_owned(), wrong_type(&other)),
    };
    for (name, value) in &presets {
        let key = join(PRESETS, name);
        if Preset::named(name).is_none() {
            return fail(key, unknown_preset(name));
        }
        if !value.is_table() {
            return fail(key, wrong_type(value));
        }
    }
    match presets.remove(chosen.name()) {
        Some(Value::Table(differences)) => Ok(differences),
        _ => Ok(Table::new()),
    }
}

/// The option that takes a key away.
const UNSET: &str = "--unset ";

/// One `--set key.path=value`, or one `--unset key.path`, which has no value.
#[derive(Debug)]
struct Override {
    /// As errors show it.
    argument: String,
    key: String,
    value: Option<Value>,
}

impl Override {
    fn parse(text: &str) -> Result<Self, ConfigError> {
        let argument = if text.starts_with(UNSET) { text.into() } else { format!("--set {text}") };
        let fail = |problem| ConfigError::Set { argument: argument.clone(), problem };
        let (key, text) = match text.strip_prefix(UNSET) {
            Some(key) => (key, None),
            None => {
                let (key, text) = text.split_once('=').ok_or_else(|| fail(SetProblem::NoKey))?;
                (key, Some(text))
            }
        };
        let keys: Vec<_> = key.split('.').map(str::trim).collect();
        if keys.iter().any(|key| key.is_empty()) {
            return Err(fail(SetProblem::NoKey));
        }
        let key = keys.join(".");
        let Some(text) = text else { return Ok(Self { argument, key, value: None }) };
        let value = match format!("value = {text}").parse::<Table>() {
            Ok(mut table) if table.len() == 1 => table.remove("value"),
            Ok(_) => None,
            Err(_) if is_bare_word(text.trim()) => Some(Value::String(text.trim().to_owned())),
            Err(error) => return Err(fail(SetProblem::Value(error.message().to_owned()))),
        };
        let one = || fail(SetProblem::Value("one value expected".to_owned()));
        let value = Some(value.ok_or_else(one)?);
        Ok(Self { argument, key, value })
    }

    /// The section that it mentions, if it gives a value there.
    fn section(&self) -> Option<&str> {
        self.value.as_ref().and(self.key.split('.').next())
    }
}

/// Whether a text that is not a TOML value can only be meant as a string.
fn is_bare_word(text: &str) -> bool {
    text.starts_with(|c: char| c.is_ascii_alphabetic())
        && text.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_')
}

/// The bounds that may be infinite, which is no bound.
const BOUNDS: [&str; 8] = [
    "control.state_low",
    "control.state_high",
    "control.output_low",
    "control.output_high",
    "control.increment_low",
    "control.increment_high",
    "control.estimator.low",
    "control.estimator.high",
];

/// Whether the numbers of a key may be infinite.
pub(crate) fn may_be_infinite(key: &str) -> bool {
    BOUNDS.contains(&key)
}

/// Takes infinite bounds away that are on the right side.
fn unbounded(table: &mut Table) {
    for key in BOUNDS {
        let none = if key.ends_with("low") { f64::NEG_INFINITY } else { f64::INFINITY };
        let mut keys = key.split('.');
        let first = keys.next().and_then(|key| table.get_mut(key));
        let value = keys.fold(first, |value, key| value?.as_table_mut()?.get_mut(key));
        let is_none = |value: &Value| value.as_float().is_some_and(|v| v.total_cmp(&none).is_eq());
        match value {
            Some(Value::Array(items)) => items.retain(|item| !is_none(item)),
            Some(Value::Table(items)) => items.retain(|_, item| !is_none(item)),
            _ => {}
        }
    }
}
