//! The sections of a config with their keys, read from the types that configs are deserialized into.

use super::defaults::Defaults;
use super::types::{Field, Shape, Types};
use std::collections::BTreeMap;
use std::sync::LazyLock;

/// The page being written.
struct Page<'a> {
    types: &'a Types,
    defaults: &'a Defaults,
    text: String,
    /// The path at which each type was described, for links from where it comes up again.
    described: BTreeMap<String, String>,
    /// Descriptions that are no sentences.
    poor: Vec<String>,
}

impl Page<'_> {
    /// Describes the fields of a struct at a path, then the tables among them.
    fn fields(&mut self, path: &str, owner: &str, fields: &[Field]) {
        self.text += "| key | type | unit | default | what |\n|---|---|---|---|---|\n";
        for field in fields {
            let here = joined(path, &field.key);
            if !field.doc.ends_with('.') || field.doc.starts_with(|c: char| c.is_lowercase()) {
                self.poor.push(format!("{here}: {:?}", field.doc));
            }
            let default = self.defaults.of(&here, owner, field, self.types);
            let unit = match field.key.rsplit_once('_') {
                Some((_, "s")) => "s",
                Some((_, "us")) => "µs",
                _ => "",
            };
            self.text += &format!(
                "| `{}` | {} | {unit} | {default} | {} |\n",
                field.key,
                field.shape.in_words(self.types),
                field.doc.replace('|', "\\|"),
            );
        }
        self.text.push('\n');
        for field in fields {
            self.words(&field.key, &field.shape);
        }
        for field in fields {
            self.tables(&joined(path, &field.key), &field.shape);
        }
    }

    /// Lists the words that a value may be.
    fn words(&mut self, key: &str, shape: &Shape) {
        let Some(name) = shape.name() else { return };
        let Some(words) = self.types.words(name) else { return };
        if words.iter().all(|word| word.content.as_ref().is_some_and(Shape::is_table)) {
            return;
        }
        if let Some(before) = self.described.get(name) {
            self.text += &format!("`{key}` takes the words of `{before}`.\n\n");
            return;
        }
        self.described.insert(name.to_owned(), key.to_owned());
        self.text += &format!("`{key}` is one of\n\n");
        for word in words {
            let content = word.content.as_ref();
            let content = content.map(|shape| format!(" = {}", shape.in_words(self.types)));
            let written = match content {
                None => format!("`\"{}\"`", word.key),
                Some(content) => format!("`{{ {}{} }}`", word.key, content.replace('`', "")),
            };
            self.text += &format!("- {written}: {}\n", word.doc);
        }
        self.text.push('\n');
    }

    /// Describes the tables that a value may be, at its path.
    fn tables(&mut self, path: &str, shape: &Shape) {
        let Some(name) = shape.name() else { return };
        let heading = match shape {
            Shape::List(_) => format!("[[{path}]]"),
            Shape::Table(_) => format!("[{path}.NAME]"),
            _ => format!("[{path}]"),
        };
        let level = "#".repeat(path.split('.').count() + 1);
        let title = format!("{level} `{heading}`\n\n");
        if let Some(fields) = self.types.fields(name) {
            self.text += &title;
            if let Some(before) = self.described.get(name) {
                let anchor: String = before.chars().filter(|c| is_kept(*c)).collect();
                self.text += &format!("The keys of [`{before}`](#{anchor}).\n\n");
                return;
            }
            self.described.insert(name.to_owned(), heading);
            self.text += &format!("{}\n\n", self.types.doc(name));
            self.fields(path, name, fields);
            return;
        }
        let Some(words) = self.types.words(name) else { return };
        let tables: Vec<_> = words
            .iter()
            .filter(|word| word.content.as_ref().is_some_and(Shape::is_table))
            .collect();
        // What is listed as words has no heading of its own.
        let is_listed = self.described.get(name).is_some_and(|before| !before.starts_with('['));
        if tables.is_empty() || is_listed {
            return;
        }
        self.text += &title;
        if let Some(before) = self.described.get(name) {
            let anchor: String = before.chars().filter(|c| is_kept(*c)).collect();
            self.text += &format!("As [`{before}`](#{anchor}).\n\n");
            return;
        }
        self.described.insert(name.to_owned(), heading);
        self.text += &format!("{} One of\n\n", self.types.doc(name));
        for word in &tables {
            self.text += &format!("- `{}`: {}\n", word.key, word.doc);
        }
        self.text.push('\n');
        for word in tables {
            let content = word.content.as_ref().expect("a table");
            self.tables(&joined(path, &word.key), content);
        }
    }
}

/// Whether a character of a heading stays in its anchor, as GitHub makes them.
fn is_kept(c: char) -> bool {
    c.is_alphanumeric() || matches!(c, '-' | '_')
}

fn joined(path: &str, key: &str) -> String {
    if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") }
}

/// The sections, and the keys whose descriptions are no sentences; the sources are read once.
static DESCRIBED: LazyLock<(String, Vec<String>)> = LazyLock::new(described);

fn described() -> (String, Vec<String>) {
    let root = super::root();
    let (types, defaults) = (Types::read(&root), Defaults::read(&root));
    let mut page = Page {
        types: &types,
        defaults: &defaults,
        text: "## Above all sections\n\n".to_owned(),
        described: BTreeMap::new(),
        poor: Vec::new(),
    };
    let top = types.fields("Experiment").expect("the root of a config");
    page.fields("", "Experiment", top);
    page.text += "## `[presets.NAME]`\n\nValues for one preset, which override the sections: \
                  `[presets.ours.control]` has the keys of `[control]`.\n";
    (page.text, page.poor)
}

/// The sections of a config, each with a table of its keys.
pub(super) fn sections() -> String {
    DESCRIBED.0.clone()
}

/// Returns the keys that their types do not describe by a sentence.
#[must_use]
pub fn undescribed_keys() -> Vec<String> {
    DESCRIBED.1.clone()
}
