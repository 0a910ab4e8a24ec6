//! The numbers of runs side by side, with their differences to the first.

use super::Compared;
use crate::number_tables::{NumberTable, changed, loops_side_by_side, shown};
use pinc_chart::text::{self, MISSING};
use pinc_record::metric::{DOMAIN, FREE_RUN, Metric, TRAINING, VALIDATION, Value};
use std::collections::{BTreeMap, BTreeSet};

pub(super) fn all(runs: &[Compared]) -> Vec<NumberTable> {
    let mut tables = vec![configs(runs)];
    tables.extend(of_nets(runs));
    tables.extend(loops(runs));
    tables
}

/// What the runs differ in: their configs, and the models that ran.
fn configs(runs: &[Compared]) -> NumberTable {
    let flat: Vec<BTreeMap<String, String>> = runs.iter().map(settings).collect();
    let keys: BTreeSet<&String> = flat.iter().flat_map(BTreeMap::keys).collect();
    let cell = |of: &BTreeMap<String, String>, key: &str| {
        of.get(key).cloned().unwrap_or_else(|| MISSING.to_owned())
    };
    let row = |key: &&String| {
        let cells: Vec<String> = flat.iter().map(|of| cell(of, key)).collect();
        let differ = cells.iter().any(|other| *other != cells[0]);
        differ.then(|| [vec![(*key).clone()], cells].concat())
    };
    let mut rows: Vec<Vec<String>> = keys.iter().filter_map(row).collect();
    rows.extend(models(runs));
    if rows.is_empty() {
        rows.push(vec!["nothing".to_owned()]);
    }
    NumberTable::new("What the runs differ in", heads(runs), rows)
}

/// The models that were in the runs' loops, which `--only` chooses beside the config; `None` if they
/// are the same.
fn models(runs: &[Compared]) -> Option<Vec<String>> {
    let of = |run: &Compared| {
        let models = run.metrics.control.iter().map(|of| run.run.model_name(Some(of.model)));
        models.collect::<Vec<_>>().join(", ")
    };
    let models: Vec<String> = runs.iter().map(of).collect();
    let differ = models.iter().any(|other| *other != models[0]);
    differ.then(|| [vec!["models that ran".to_owned()], models].concat())
}

fn heads(runs: &[Compared]) -> Vec<String> {
    std::iter::once(String::new()).chain(runs.iter().map(|of| of.name.clone())).collect()
}

/// The values of a run's config by their keys.
fn settings(of: &Compared) -> BTreeMap<String, String> {
    let mut flat = BTreeMap::new();
    // It was read as a config before.
    if let Ok(table) = of.run.config_text.parse() {
        flatten("", &toml::Value::Table(table), &mut flat);
    }
    flat
}

/// Lists of numbers or texts are one value, lists of tables are not.
fn flatten(path: &str, value: &toml::Value, flat: &mut BTreeMap<String, String>) {
    let below = |key: &str| match path {
        "" => key.to_owned(),
        path => format!("{path}.{key}"),
    };
    match value {
        toml::Value::Table(table) => {
            table.iter().for_each(|(key, of)| flatten(&below(key), of, flat))
        }
        toml::Value::Array(list) if list.iter().any(toml::Value::is_table) => {
            list.iter().enumerate().for_each(|(i, of)| flatten(&below(&i.to_string()), of, flat));
        }
        value => drop(flat.insert(path.to_owned(), value.to_string())),
    }
}

/// Training, validation and free run; `None` if no run has any.
fn of_nets(runs: &[Compared]) -> Option<NumberTable> {
    let row = |metric: &Metric| {
        let number = |of: &Compared| match metric.value(&of.metrics, None)? {
            Value::Number(value) => Some(value),
            Value::Name(_) => None,
        };
        let values: Vec<Option<f64>> = runs.iter().map(number).collect();
        let cell = |(i, value): (usize, &Option<f64>)| match (value, values[0]) {
            (None, _) => MISSING.to_owned(),
            (Some(value), Some(first)) if i > 0 => {
                format!("{}{}", four_digits(metric, *value), changed(*value, first))
            }
            (Some(value), _) => four_digits(metric, *value),
        };
        let cells: Vec<String> = values.iter().enumerate().map(cell).collect();
        let any = values.iter().any(Option::is_some);
        any.then(|| [vec![metric.title.to_owned()], cells].concat())
    };
    let stages = [TRAINING, VALIDATION, DOMAIN, FREE_RUN];
    let rows = stages.into_iter().flat_map(Metric::rows).filter_map(row);
    NumberTable::of_any("Training, validation, free run", heads(runs), rows)
}

/// A number with so many digits that small differences are seen; durations as in reports.
fn four_digits(metric: &Metric, value: f64) -> String {
    if metric.unit.seconds().is_some() { shown(metric, value) } else { text::number(value, 4) }
}

/// The closed loops; `None` if no run has any.
fn loops(runs: &[Compared]) -> Option<NumberTable> {
    let all = || runs.iter().flat_map(|run| run.loops().map(move |(name, of)| (name, run, of)));
    let heads = std::iter::once(String::new()).chain(all().map(|(name, ..)| name));
    let loops: Vec<_> = all().map(|(_, run, of)| (&run.run, of)).collect();
    let rows = loops_side_by_side(&loops);
    (!loops.is_empty()).then(|| NumberTable::new("Closed loops", heads, rows))
}
