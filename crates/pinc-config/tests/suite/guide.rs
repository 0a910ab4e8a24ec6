//! The documented defaults against the presets.

use crate::common::read;
use toml::{Table, Value};

const PRESETS: [&str; 3] = ["ours", "as-printed", "as-released"];

fn guide() -> String {
    read("docs/config.md")
}

fn preset(name: &str) -> String {
    read(&format!("crates/pinc-config/presets/{name}.toml"))
}

/// The defaults of a section by the keys that the guide uses, `sqp.tolerance` for instance.
fn defaults(preset: &Table, section: &str) -> Vec<(String, Value)> {
    let table = preset.get(section).and_then(Value::as_table).unwrap();
    let keys = table.iter().flat_map(|(key, value)| match value {
        Value::Table(inner) => {
            inner.iter().map(|(name, value)| (format!("{key}.{name}"), value.clone())).collect()
        }
        value => vec![(key.clone(), value.clone())],
    });
    keys.collect()
}

/// The default of a key in the guide's table of a section: the last cell has one for each key of
/// the first.
fn documented(guide: &str, section: &str, key: &str) -> Option<Value> {
    let (_, rest) = guide.split_once(&format!("\n### `[{section}]`\n"))?;
    let part = rest.split("\n### ").next()?;
    for row in part.lines().filter(|line| line.starts_with("| `")) {
        let cells: Vec<_> = row.trim_matches('|').split(" | ").map(str::trim).collect();
        let mut keys = cells.first()?.split(", ");
        if let Some(place) = keys.position(|found| found == format!("`{key}`")) {
            let several = cells[0].contains(", ") && cells.last()?.matches(", ").count() > 0;
            let default = match several {
                true => cells.last()?.split(", ").nth(place)?.to_owned(),
                false => format!("[{}]", cells.last()?.replace('`', "")),
            };
            let parsed: Table = format!("value = {}", default.replace('`', "")).parse().ok()?;
            let value = parsed.get("value")?;
            return match value {
                Value::Array(values) if values.len() == 1 => values.first().cloned(),
                value => Some(value.clone()),
            };
        }
    }
    None
}

#[test]
fn the_guide_shows_the_presets_as_they_are() {
    let guide = guide();
    let presets = PRESETS.map(|name| preset(name).parse::<Table>().unwrap());
    for section in ["data", "validation", "prediction", "control", "one_step"] {
        for (key, value) in defaults(&presets[0], section) {
            let same =
                |preset: &Table| defaults(preset, section).contains(&(key.clone(), value.clone()));
            let shown = documented(&guide, section, &key);
            if presets.iter().all(same) && value != Value::Array(vec![]) {
                assert_eq!(shown, Some(value), "{section}.{key}");
            }
        }
    }
}

/// The guide quotes the training of `ours` word for word.
#[test]
fn the_guide_quotes_a_preset() {
    let guide = guide();
    let quoted = guide.split("```toml\n# ours.toml\n").nth(1);
    let quoted = quoted.and_then(|rest| rest.split("```").next()).expect("a quotation");
    assert!(quoted.lines().count() > 20, "{quoted}");
    assert!(preset("ours").contains(quoted), "{quoted}");
}
