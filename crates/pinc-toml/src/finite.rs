//! Numbers that are not finite.

use toml::{Table, Value};

/// The key of the first number that is NaN, or infinite where that means nothing, and the number. Lists
/// and tables of `bounds` whose key ends with `low` may be -inf, others inf.
#[must_use]
pub fn first_not_finite(table: &Table, bounds: &[&str]) -> Option<(String, f64)> {
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
    unbounded(&mut table, bounds);
    let of = |(key, value): (&String, &Value)| {
        search(value).map(|(rest, v)| (format!("{key}{rest}"), v))
    };
    table.iter().find_map(of)
}

/// Takes infinite bounds away that are on the right side.
fn unbounded(table: &mut Table, bounds: &[&str]) {
    for key in bounds {
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
