//! Files with the weights of nets inside a plant's equations.

use crate::Experiment;
use pinc_toml::Problem;
use std::fmt::Write as _;
use std::path::Path;
use toml::{Table, Value};

/// The tables that may be plants.
const PLANTS: [&[&str]; 2] = [&["plant"], &["control", "plant"]];
/// The header of a file.
const HEADER: &str = "weight";

/// Replaces the files that nets name, relative to `dir`, by their weights among the parameters.
pub(crate) fn read(table: &mut Table, dir: &Path) -> Result<(), (String, Problem)> {
    for path in PLANTS {
        let expression =
            path.iter().try_fold(&mut *table, |at, key| at.get_mut(*key)?.as_table_mut());
        let expression = expression.and_then(|plant| plant.get_mut("expression")?.as_table_mut());
        if let Some(expression) = expression {
            read_all(expression, dir, &path.join("."))?;
        }
    }
    Ok(())
}

fn read_all(expression: &mut Table, dir: &Path, plant: &str) -> Result<(), (String, Problem)> {
    let Some(nets) = expression.get_mut("nets").and_then(Value::as_table_mut) else {
        return Ok(());
    };
    let mut all = Vec::new();
    for (name, net) in nets.iter_mut().filter_map(|(name, net)| Some((name, net.as_table_mut()?))) {
        let key = format!("{plant}.expression.nets.{name}.weights");
        if let Some(Value::String(file)) = net.get("weights") {
            all.push((name.clone(), of_file(&key, &dir.join(file))?, key));
            net.remove("weights");
        }
    }
    if all.is_empty() {
        return Ok(());
    }
    let parameters = expression.entry("parameters").or_insert_with(|| Table::new().into());
    let Some(parameters) = parameters.as_table_mut() else { return Ok(()) };
    for (name, weights, key) in all {
        let of_the_net = |given: &String| given.split('[').next() == Some(name.as_str());
        if let Some(given) = parameters.keys().find(|given| of_the_net(given)) {
            let (found, expected) = (format!("a file beside parameters.{given}"), "one of the two");
            return Err((key, Problem::Value { found, expected: expected.to_owned() }));
        }
        parameters.insert(name, Value::Array(weights));
    }
    Ok(())
}

fn of_file(key: &str, path: &Path) -> Result<Vec<Value>, (String, Problem)> {
    let shown = path.display();
    let fail = |found: String, expected: &str| {
        (key.to_owned(), Problem::Value { found, expected: expected.to_owned() })
    };
    let text = std::fs::read_to_string(path).map_err(|error| {
        fail(format!("{shown} ({error})"), "a CSV file, relative to the config's directory")
    })?;
    let mut lines = text.lines().enumerate();
    let header = lines.next().map_or("", |(_, line)| line.trim());
    if header != HEADER {
        return Err(fail(format!("{shown}, line 1: {header}"), "the header `weight`"));
    }
    let number = |(i, line): (usize, &str)| {
        let value = line.trim().parse().ok().filter(|value: &f64| value.is_finite());
        let found = || fail(format!("{shown}, line {}: {line}", i + 1), "a finite number");
        value.map(Value::Float).ok_or_else(found)
    };
    lines.filter(|(_, line)| !line.trim().is_empty()).map(number).collect()
}

impl Experiment {
    /// The config as TOML, with the weights of the plant's nets in files: the text, and the name and
    /// text of each file, which belongs beside the config.
    ///
    /// # Panics
    ///
    /// Like [`Experiment::to_toml`].
    #[must_use]
    pub fn to_toml_with_weights_beside(&self) -> (String, Vec<(String, String)>) {
        let mut table = self.to_table();
        let mut files = Vec::new();
        let expression = table.get_mut("plant").and_then(|plant| plant.get_mut("expression"));
        if let Some(Value::Table(expression)) = expression {
            let mut parameters = expression.remove("parameters");
            let nets = expression.get_mut("nets").and_then(Value::as_table_mut);
            for (name, net) in nets.into_iter().flatten() {
                let Some(parameters) = parameters.as_mut().and_then(Value::as_table_mut) else {
                    continue;
                };
                let mut text = format!("{HEADER}\n");
                for i in 1.. {
                    let weight = parameters.remove(&format!("{name}[{i}]"));
                    let Some(weight) = weight.and_then(|weight| weight.as_float()) else { break };
                    // Writing to a String does not fail.
                    let _ = writeln!(text, "{weight:?}");
                }
                let file = format!("weights-{name}.csv");
                if let Some(net) = net.as_table_mut() {
                    net.insert("weights".to_owned(), Value::String(file.clone()));
                }
                files.push((file, text));
            }
            expression.extend(parameters.map(|parameters| ("parameters".to_owned(), parameters)));
        }
        (toml::to_string(&table).expect("the values have a form in TOML"), files)
    }
}
