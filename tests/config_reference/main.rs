//! `docs/config-keys.md`: every key of a config, read from the types that configs are
//! deserialized into. With `PINC_WRITE` set in the environment, the test writes the page.

mod defaults;
mod types;

use crate::defaults::Defaults;
use crate::types::{Field, Shape, Types};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

const PAGE: &str = "docs/config-keys.md";

const HEAD: &str = "# Config reference

Every key of a config, in the order of the resolved `config.toml` in a run directory. A test writes
this page from the types that configs are read into: `PINC_WRITE=1 cargo test -p pinc-tests --test
config_reference`.

- **type**: a *table of* something has names as its keys; a *list of* something has its entries in
  the order that the description names.
- **unit**: a key that ends in `_s` is in seconds, one that ends in `_us` in microseconds. All other
  numbers are in the units of the plant, or have none.
- **default**: the value of a key that a config leaves out. A *required* key has none; *none* means
  that the key is absent, and its description says what happens then. Sections marked *preset* take
  defaults from `preset`: the tables show the values of `ours`, and of the other two where they
  differ. A section exists only if the config mentions it.

";

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().expect("a folder above the tests").to_owned()
}

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
        if tables.is_empty() {
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

fn page() -> (String, Vec<String>) {
    let (types, defaults) = (Types::read(&root()), Defaults::read(&root()));
    let mut page = Page {
        types: &types,
        defaults: &defaults,
        text: HEAD.to_owned(),
        described: BTreeMap::new(),
        poor: Vec::new(),
    };
    page.text += "## Above all sections\n\n";
    let top = types.fields("Experiment").expect("the root of a config");
    page.fields("", "Experiment", top);
    page.text += "## `[presets.NAME]`\n\nValues for one preset alone, over those of the sections: \
                  `[presets.ours.control]` has the keys of `[control]`.\n";
    (page.text, page.poor)
}

#[test]
fn the_reference_of_configs_is_what_their_types_say() {
    let path = root().join(PAGE);
    let (text, _) = page();
    if std::env::var_os("PINC_WRITE").is_some() {
        fs::create_dir_all(path.parent().expect("a folder")).expect("a folder for the page");
        fs::write(&path, text).expect("a page that can be written");
    } else {
        let written = fs::read_to_string(&path).unwrap_or_default();
        assert!(written == text, "{PAGE}: run this test with PINC_WRITE=1");
    }
}

#[test]
fn every_key_is_described_by_sentences() {
    let (_, poor) = page();
    assert!(poor.is_empty(), "{}", poor.join("\n"));
}

/// What the page says is what the program reads: resolved shipped configs have no key without a row,
/// and rows say the values that a config has without saying them.
#[test]
fn the_page_has_the_keys_and_defaults_of_resolved_configs() {
    let (text, _) = page();
    let load = |name: &str| {
        let path = root().join("configs/smoke").join(name);
        let plants = pinc_config::Plants::built_in();
        pinc_config::Experiment::load(&path, &[], &plants).expect("a config").to_toml()
    };
    let mut sections = 0;
    for name in ["van-der-pol.toml", "four-tanks.toml"] {
        let config: toml::Table = load(name).parse().expect("TOML");
        for (section, value) in &config {
            let toml::Value::Table(table) = value else {
                assert!(text.contains(&format!("| `{section}` |")), "{section}");
                continue;
            };
            let begin = text.find(&format!("\n## `[{section}]`")).expect("a section");
            let length = text[begin + 1..].find("\n## ").expect("another section");
            sections += 1;
            for key in table.keys() {
                let (row, word) = (format!("\n| `{key}` |"), format!("\n- `{key}`"));
                let part = &text[begin..begin + 1 + length];
                assert!(part.contains(&row) || part.contains(&word), "[{section}] {key}");
            }
        }
    }
    assert!(sections >= 12, "{sections} sections");
    for row in [
        "| `horizon_s` | number | s | required |",
        "| `max_failed_share` | number |  | 0.05 |",
        "| `n2` | whole number |  | 5 |",
        "| `real_time` | true or false |  | false |",
        "| `lambda` | number |  | 1.0; as-printed 0.1",
        "| `measure_s` | number | s | 0.2 |",
        "| `budget_us` | number | µs | none |",
        "| `beta1` | number |  | 0.9 |",
    ] {
        assert!(text.contains(row), "no {row}");
    }
}
