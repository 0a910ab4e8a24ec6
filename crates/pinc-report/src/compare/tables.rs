//! The numbers of runs side by side, with their differences to the first.

use super::Compared;
use crate::number_tables::{NumberTable, changed, loops_side_by_side};
use pinc_chart::text::{self, MISSING};
use pinc_record::Metrics;
use std::collections::{BTreeMap, BTreeSet};
use toml::Value;

pub(super) fn all(runs: &[Compared]) -> Vec<NumberTable> {
    let mut tables = vec![configs(runs)];
    tables.extend(of_nets(runs));
    tables.extend(loops(runs));
    tables
}

/// What the configs differ in.
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
    if rows.is_empty() {
        rows.push(vec!["nothing".to_owned()]);
    }
    NumberTable { title: "What the configs differ in".to_owned(), heads: heads(runs), rows }
}

fn heads(runs: &[Compared]) -> Vec<String> {
    std::iter::once(String::new()).chain(runs.iter().map(|of| of.name.clone())).collect()
}

/// The values of a run's config by their keys.
fn settings(of: &Compared) -> BTreeMap<String, String> {
    let mut flat = BTreeMap::new();
    // It was read as a config before.
    if let Ok(table) = of.run.config_text.parse() {
        flatten("", &Value::Table(table), &mut flat);
    }
    flat
}

/// Lists of numbers or texts are one value, lists of tables are not.
fn flatten(path: &str, value: &Value, flat: &mut BTreeMap<String, String>) {
    let below = |key: &str| match path {
        "" => key.to_owned(),
        path => format!("{path}.{key}"),
    };
    match value {
        Value::Table(table) => table.iter().for_each(|(key, of)| flatten(&below(key), of, flat)),
        Value::Array(list) if list.iter().any(Value::is_table) => {
            list.iter().enumerate().for_each(|(i, of)| flatten(&below(&i.to_string()), of, flat));
        }
        value => drop(flat.insert(path.to_owned(), value.to_string())),
    }
}

/// A number of a run; `None` if the run has none.
type Number = fn(&Metrics) -> Option<f64>;

const TIMES: [(&str, Number); 2] = [
    ("Training, wall time", |of| Some(of.training.as_ref()?.wall_s)),
    ("Training, optimizer alone", |of| Some(of.training.as_ref()?.optimizer_s)),
];

#[expect(clippy::cast_precision_loss, reason = "no training has 2^53 evaluations")]
const NUMBERS: [(&str, Number); 8] = [
    ("Iterations", |of| Some(of.training.as_ref()?.iterations as f64)),
    ("Loss evaluations", |of| Some(of.training.as_ref()?.loss_evaluations as f64)),
    ("Validation, MSE at the steps", |of| Some(of.validation.as_ref()?.mse_gen)),
    ("Validation, MSE of one step", |of| Some(of.validation.as_ref()?.one_step_mse)),
    ("One step over [domain], rms in widths", |of| {
        Some(of.validation.as_ref()?.domain_error.as_ref()?.rms)
    }),
    ("One step over [domain], largest", |of| {
        Some(of.validation.as_ref()?.domain_error.as_ref()?.max)
    }),
    ("Free run, MSE at the steps", |of| Some(of.prediction.as_ref()?.mse_marks)),
    ("Free run, MSE of all rows", |of| Some(of.prediction.as_ref()?.mse_all)),
];

/// Training, validation and free run; `None` if no run has any.
fn of_nets(runs: &[Compared]) -> Option<NumberTable> {
    let row = |(label, number): &(&str, Number), show: &dyn Fn(f64) -> String| {
        let values: Vec<Option<f64>> = runs.iter().map(|of| number(&of.metrics)).collect();
        let cell = |(i, value): (usize, &Option<f64>)| match (value, values[0]) {
            (None, _) => MISSING.to_owned(),
            (Some(value), Some(first)) if i > 0 => {
                format!("{}{}", show(*value), changed(*value, first))
            }
            (Some(value), _) => show(*value),
        };
        let cells: Vec<String> = values.iter().enumerate().map(cell).collect();
        let any = values.iter().any(Option::is_some);
        any.then(|| [vec![(*label).to_owned()], cells].concat())
    };
    let times = TIMES.iter().map(|one| row(one, &text::duration));
    let numbers = NUMBERS.iter().map(|one| row(one, &|value| text::number(value, 4)));
    let rows: Vec<Vec<String>> = times.chain(numbers).flatten().collect();
    let title = "Training, validation, free run".to_owned();
    (!rows.is_empty()).then(|| NumberTable { title, heads: heads(runs), rows })
}

/// The closed loops; `None` if no run has any.
fn loops(runs: &[Compared]) -> Option<NumberTable> {
    let all = || runs.iter().flat_map(|run| run.loops().map(move |(name, of)| (name, run, of)));
    let heads: Vec<String> =
        std::iter::once(String::new()).chain(all().map(|(name, ..)| name)).collect();
    let loops: Vec<_> = all().map(|(_, run, of)| (&run.run, of)).collect();
    let rows = loops_side_by_side(&loops);
    (!loops.is_empty()).then(|| NumberTable { title: "Closed loops".to_owned(), heads, rows })
}
