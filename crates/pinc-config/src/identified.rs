//! Parameters whose uncertainty is in the `identify.json` of an identification.

use pinc_toml::Problem;
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;
use toml::{Table, Value};

#[derive(Deserialize)]
struct Identified {
    parameters: BTreeMap<String, Estimate>,
}

#[derive(Deserialize)]
struct Estimate {
    value: f64,
    half_width_95: Option<f64>,
}

/// Replaces the path of an `identify.json`: in `[control.uncertainty]` by the intervals in it, in
/// `[control.scenarios]` by each parameter's value and the ends of its interval.
pub(crate) fn read(table: &mut Table) -> Result<(), (String, Problem)> {
    let ends = |value: f64, half: f64| vec![value - half, value + half];
    let all = |value: f64, half: f64| vec![value, value - half, value + half];
    replace(table, ["uncertainty", "parameters"], "intervals", ends)?;
    replace(table, ["scenarios", "values"], "values", all)
}

/// Replaces a path below `[control]` by numbers of each parameter's value and half its interval.
fn replace(
    table: &mut Table,
    [section, key]: [&str; 2],
    what: &str,
    numbers: fn(f64, f64) -> Vec<f64>,
) -> Result<(), (String, Problem)> {
    let control = table.get_mut("control").and_then(Value::as_table_mut);
    let given = control.and_then(|of| of.get_mut(section)).and_then(Value::as_table_mut);
    let given = given.and_then(|section| section.get_mut(key));
    let Some(parameters) = given else { return Ok(()) };
    let Value::String(path) = &*parameters else { return Ok(()) };
    let found = parameters_of(Path::new(path), numbers).map_err(|problem| {
        let expected = format!("a table of {what}, or the path of an identify.json: {problem}");
        let problem = Problem::Value { found: path.clone(), expected };
        (format!("control.{section}.{key}"), problem)
    })?;
    *parameters = Value::Table(found);
    Ok(())
}

/// The parameters in an `identify.json`; or what is wrong with it.
fn parameters_of(path: &Path, numbers: fn(f64, f64) -> Vec<f64>) -> Result<Table, String> {
    let text = std::fs::read_to_string(path).map_err(|error| error.to_string())?;
    let all: Identified = serde_json::from_str(&text).map_err(|error| error.to_string())?;
    let list = |(name, Estimate { value, half_width_95 })| match half_width_95 {
        Some(half) => {
            let list = numbers(value, half).into_iter().map(Value::Float).collect();
            Ok((name, Value::Array(list)))
        }
        None => Err(format!("`{name}` has no interval there")),
    };
    all.parameters.into_iter().map(list).collect()
}
