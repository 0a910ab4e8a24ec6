//! Rust files as text: what of them is code, and which modules are tests.

use std::fs;
use std::path::{Path, PathBuf};

/// The modules in files of their own, without ending, that `path` declares for tests only.
pub(crate) fn files_of_tests(path: &Path, text: &str) -> Vec<PathBuf> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let folder = match &*stem {
        "lib" | "main" | "mod" => folder.to_path_buf(),
        stem => folder.join(stem),
    };
    let plain = without_text(text);
    let declared = plain.split(TEST).skip(1).filter_map(|rest| {
        let item = &rest[..end_of_item(rest)];
        item.trim().strip_prefix("mod ")?.strip_suffix(';')
    });
    declared.map(|name| folder.join(name.trim())).collect()
}

/// What marks an item as one of tests.
const TEST: &str = "#[cfg(test)]";

/// The code of a file: without comments, without what stands in quotes, and without the items of
/// tests.
pub(crate) fn code(text: &str) -> String {
    let plain = without_text(text);
    let mut parts = plain.split(TEST);
    let mut code = parts.next().unwrap_or_default().to_owned();
    for rest in parts {
        code += &rest[end_of_item(rest)..];
    }
    code
}

/// Where an item at the beginning of some plain code ends: behind its `;` or its block.
fn end_of_item(code: &str) -> usize {
    let mut depth = 0_usize;
    // Further attributes belong to the item.
    for (at, c) in code.char_indices() {
        match c {
            '(' | '[' | '{' => depth += 1,
            ')' | ']' => depth = depth.saturating_sub(1),
            '}' if depth <= 1 => return at + 1,
            '}' => depth -= 1,
            ';' if depth == 0 => return at + 1,
            _ => {}
        }
    }
    code.len()
}

/// Rust code without comments, and with nothing in its quotes.
fn without_text(text: &str) -> String {
    let mut out = String::new();
    let mut rest = text;
    while let Some(c) = rest.chars().next() {
        let skipped = if rest.starts_with("//") {
            rest.find('\n').unwrap_or(rest.len())
        } else if rest.starts_with("/*") {
            rest.find("*/").map_or(rest.len(), |end| end + 2)
        } else if let Some(hashes) = raw_string(rest, &out) {
            let end = format!("\"{}", "#".repeat(hashes));
            let begin = hashes + 2;
            rest[begin..].find(&end).map_or(rest.len(), |at| begin + at + end.len())
        } else if c == '"' {
            quoted(rest, '"')
        } else if c == '\'' && is_character(rest) {
            quoted(rest, '\'')
        } else {
            out.push(c);
            rest = &rest[c.len_utf8()..];
            continue;
        };
        out.push(' ');
        rest = &rest[skipped..];
    }
    out
}

/// The number of `#` in front of a raw string at the beginning of `rest`, if there is one.
fn raw_string(rest: &str, before: &str) -> Option<usize> {
    let in_word = before.chars().last().is_some_and(|c| c.is_alphanumeric() || c == '_');
    let behind = rest.strip_prefix('r').filter(|_| !in_word)?;
    let hashes = behind.len() - behind.trim_start_matches('#').len();
    behind[hashes..].starts_with('"').then_some(hashes)
}

/// Whether a quote begins a character rather than a lifetime.
fn is_character(rest: &str) -> bool {
    let mut chars = rest.chars().skip(1);
    chars.next() == Some('\\') || chars.next() == Some('\'')
}

/// The length of a text in quotes, with the quotes.
fn quoted(rest: &str, quote: char) -> usize {
    let mut escaped = false;
    for (at, c) in rest.char_indices().skip(1) {
        match c {
            _ if escaped => escaped = false,
            '\\' => escaped = true,
            c if c == quote => return at + c.len_utf8(),
            _ => {}
        }
    }
    rest.len()
}

/// The identifiers and numbers of some code, in order.
pub(crate) fn words(code: &str) -> impl Iterator<Item = &str> {
    code.split(|c: char| !(c.is_alphanumeric() || c == '_')).filter(|word| !word.is_empty())
}

/// All Rust files below `folder`, sorted.
pub(crate) fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(error) => panic!("{}: {error}", folder.display()),
    };
    let mut files = Vec::new();
    for entry in entries {
        let path = entry.expect("a readable folder").path();
        if path.is_dir() {
            files.extend(rust_files(&path));
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
    files.sort();
    files
}
