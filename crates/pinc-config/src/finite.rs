//! Numbers that are not finite.

use toml::{Table, Value};

/// The key of the first number that is NaN, or infinite where that means nothing, and the number.
pub(crate) fn first_not_finite(table: &Table) -> Option<(String, f64)> {
    /// The rest of the key, and the number.
    fn search(value: &Value) -> Option<(String, f64)> {
        match value {
            Value::Float(v) if !v.is_finite() => Some((String::new(), *v)),
            Value::Array(items) => items
                .iter()
                .enumerate()
                .find_map(|(i, item)| search(item).map(|(rest, v)| (format!("[{i}]{rest}"), v))),
            Value::Table(table) => table.iter().find_map(|(key, value)| {
                search(value).map(|(rest, v)| (format!(".{key}{rest}"), v))
            }),
            _ => None,
        }
    }
    let mut table = table.clone();
    unbounded(&mut table);
    let of = |(key, value): (&String, &Value)| {
        search(value).map(|(rest, v)| (format!("{key}{rest}"), v))
    };
    table.iter().find_map(of)
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
