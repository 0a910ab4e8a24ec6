//! The line of each key of a file.

use std::collections::HashMap;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

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
pub(crate) struct LineEnds(Vec<usize>);

impl LineEnds {
    pub(crate) fn of(text: &str) -> Self {
        Self(text.match_indices('\n').map(|(byte, _)| byte).collect())
    }

    /// The line of a byte, from 1.
    pub(crate) fn line_at(&self, byte: usize) -> usize {
        1 + self.0.partition_point(|&end| end < byte)
    }
}

/// The line of a key in the text of a file, or of the innermost table around it that the file has.
pub(crate) fn line_of(text: &str, key: &str) -> usize {
    let mut lines = HashMap::new();
    if let Ok(spanned) = DeTable::parse(text) {
        note_lines(&LineEnds::of(text), "", spanned.get_ref(), &mut lines);
    }
    around(key, |place| lines.get(place)).copied().unwrap_or(1)
}

/// The keys of tables in the order in which a text has them; none of a table that it does not have.
pub(crate) fn keys_in_order(text: &str, tables: &[String]) -> Vec<String> {
    let Ok(spanned) = DeTable::parse(text) else { return Vec::new() };
    let mut keys = Vec::new();
    for path in tables {
        let table = path.split('.').try_fold(spanned.get_ref(), |table, key| {
            let child = table.iter().find(|(name, _)| name.get_ref() == key)?.1;
            if let DeValue::Table(table) = child.get_ref() { Some(table) } else { None }
        });
        let own = table.into_iter().flat_map(|table| table.keys());
        keys.extend(own.map(|key| (key.span().start, key.get_ref().to_string())));
    }
    keys.sort();
    keys.into_iter().map(|(_, key)| key).collect()
}

/// What there is for a key, or for the innermost table or list around it that has something.
pub(crate) fn around<T>(key: &str, of: impl Fn(&str) -> Option<T>) -> Option<T> {
    let mut place = key;
    loop {
        if let Some(found) = of(place) {
            return Some(found);
        }
        place = &place[..place.rfind(['.', '['])?];
    }
}

/// A key beneath another one.
pub(crate) fn join(prefix: &str, key: &str) -> String {
    if prefix.is_empty() { key.to_owned() } else { format!("{prefix}.{key}") }
}
