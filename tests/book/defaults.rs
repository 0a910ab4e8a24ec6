//! The values of keys that a config does not say.

use super::types::{Field, Given, Shape, Types};
use pinc_mpc::SqpConfig;
use pinc_net::optim::{LbfgsConfig, LevenbergMarquardtConfig, SelfScaledBroydenConfig};
use std::fs;
use std::path::Path;
use toml::{Table, Value};

/// The presets, and the defaults of types that have one.
#[derive(Debug)]
pub(crate) struct Defaults {
    presets: Vec<(&'static str, Table)>,
    types: Vec<(&'static str, Table)>,
}

impl Defaults {
    pub(crate) fn read(root: &Path) -> Self {
        let preset = |name| {
            let path = root.join(format!("crates/pinc-config/presets/{name}.toml"));
            let text = fs::read_to_string(path).expect("a preset");
            (name, text.parse().expect("TOML"))
        };
        fn table(of: impl serde::Serialize) -> Table {
            Table::try_from(of).expect("a table")
        }
        Self {
            presets: ["ours", "as-printed", "as-released"].map(preset).into(),
            types: vec![
                ("SqpConfig", table(SqpConfig::default())),
                ("SelfScaledBroydenConfig", table(SelfScaledBroydenConfig::default())),
                ("LbfgsConfig", table(LbfgsConfig::default())),
                ("LevenbergMarquardtConfig", table(LevenbergMarquardtConfig::default())),
            ],
        }
    }

    /// What the page says of a key at a path, which is one of `owner`'s.
    pub(crate) fn of(&self, path: &str, owner: &str, field: &Field, types: &Types) -> String {
        let values: Vec<_> =
            self.presets.iter().map(|(name, table)| (name, at(table, path))).collect();
        if let (_, Some(ours)) = values[0] {
            let mut shown = in_words(ours);
            for (name, value) in &values[1..] {
                let other = value.map(in_words).filter(|other| *other != shown);
                shown += &other.map_or_else(String::new, |other| format!("; {name} {other}"));
            }
            return shown;
        }
        let own = self.types.iter().find(|(name, _)| *name == owner);
        if let Some(value) = own.and_then(|(_, table)| table.get(&field.key)) {
            return in_words(value);
        }
        match (&field.default, &field.shape) {
            (Given::Value(value), _) => value.clone(),
            (_, Shape::Optional(_)) => "none".to_owned(),
            (Given::Nothing, _) => "required".to_owned(),
            (Given::OfType, shape) => of_type(shape, types),
        }
    }
}

/// The default of a type.
fn of_type(shape: &Shape, types: &Types) -> String {
    let word = |name: &str| {
        let words = types.words(name)?;
        Some(format!("`\"{}\"`", words.iter().find(|word| word.is_default)?.key))
    };
    match shape {
        Shape::Plain("true or false") => "false".to_owned(),
        Shape::Plain("number" | "whole number") => "0".to_owned(),
        Shape::Named(name) => word(name).unwrap_or_else(|| "none".to_owned()),
        _ => "none".to_owned(),
    }
}

fn at<'a>(table: &'a Table, path: &str) -> Option<&'a Value> {
    let mut keys = path.split('.');
    let first = table.get(keys.next()?)?;
    keys.try_fold(first, |value, key| value.as_table()?.get(key))
}

fn in_words(value: &Value) -> String {
    match value {
        Value::Table(_) => "preset".to_owned(),
        Value::Array(list) if list.iter().any(Value::is_table) => "preset".to_owned(),
        Value::String(text) => format!("`\"{text}\"`"),
        Value::Array(list) => format!("`{}`", Value::Array(list.clone())),
        Value::Float(value) if *value != 0.0 && value.abs() < 1e-3 => format!("{value:e}"),
        value => value.to_string(),
    }
}
