//! From an error of deserialization to one that says what to write instead.

use crate::problem::{Problem, nearest};

type Error = serde_path_to_error::Error<toml::de::Error>;

/// The key of an error and what is wrong there, with the nearest key that exists.
#[must_use]
pub fn explain(error: &Error) -> (String, Problem) {
    let mut key = match error.path().to_string() {
        root if root == "." => String::new(),
        path => path,
    };
    let message = error.inner().message().trim_end();
    let problem = if let Some(field) = message.strip_prefix("missing field ") {
        key = within(&key, quoted(field).first());
        Problem::Missing("a value for this key")
    } else if let Some(rest) = message.strip_prefix("unknown field ") {
        let mut known = quoted(rest);
        let found = take_first(&mut known);
        key = within(&key, Some(&found));
        let nearest = nearest(&found, &known);
        Problem::Unknown { known, nearest }
    } else if let Some(rest) = message.strip_prefix("unknown variant ") {
        let mut known = quoted(rest);
        let found = take_first(&mut known);
        Problem::word(&found, &known)
    } else {
        Problem::Type(in_plain_quoted(message))
    };
    (key, problem)
}

/// `path` with `key` at its end, if it is not there yet.
fn within(path: &str, key: Option<&String>) -> String {
    match key {
        Some(key) if path.is_empty() => key.clone(),
        Some(key) if path != key && !path.ends_with(&format!(".{key}")) => format!("{path}.{key}"),
        _ => path.to_owned(),
    }
}

/// The names in backquotes of one of serde's messages.
fn quoted(message: &str) -> Vec<String> {
    message.split('`').skip(1).step_by(2).map(str::to_owned).collect()
}

fn take_first(names: &mut Vec<String>) -> String {
    if names.is_empty() { String::new() } else { names.remove(0) }
}

/// A message without Rust's names of types.
fn in_plain_quoted(message: &str) -> String {
    if message.starts_with("wanted exactly 1 element") {
        // A choice between several kinds of thing, of which a table names one by its only key.
        return "no key or several given, expected exactly one".to_owned();
    }
    if message.ends_with("unit variant, expected string only") {
        return "no word given, expected one of this key's words, or a table where it takes one"
            .to_owned();
    }
    if message.ends_with("unit variant, expected newtype variant") {
        return "a word given, expected a table with a value for it".to_owned();
    }
    let plain = [
        ("expected f64", "expected a number"),
        ("expected usize", "expected a whole number, 0 or more"),
        ("expected u64", "expected a whole number, 0 or more"),
        ("expected a sequence", "expected a list"),
        ("expected a map", "expected a table"),
    ];
    let plain = plain.iter().find_map(|(end, plain)| Some((message.strip_suffix(end)?, plain)));
    match plain {
        Some((begin, plain)) => format!("{begin}{plain}"),
        None if message.contains("expected struct ") => {
            message.split("expected struct ").next().unwrap_or_default().to_owned()
                + "expected a table"
        }
        None => message.to_owned(),
    }
}
