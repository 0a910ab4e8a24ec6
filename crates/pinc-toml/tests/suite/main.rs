//! The tests of pinc-toml, as one program.

mod layers;
mod numbers;
mod order;
mod overrides;
mod words;

use pinc_toml::{ConfigError, Layers, Presets};

/// Two presets with a table each of them has, and one that only the first has.
const PRESETS: Presets = Presets {
    texts: &[
        ("quick", "[model]\nneurons = 8\nlayers = 2\n[model.head]\nwide = true\n[loop]\nT = 0.5\n"),
        ("slow", "[model]\nneurons = 64\n"),
    ],
    expected: "the name of a preset",
};

/// The layers of the file `a.toml` with this text and these `--set`.
fn resolved(text: &str, sets: &[&str]) -> Result<Layers, ConfigError> {
    let sets: Vec<String> = sets.iter().map(|&set| set.to_owned()).collect();
    Layers::resolve("a.toml".as_ref(), text, &sets, PRESETS)
}

/// The table that a text and these `--set` give, as TOML without spaces.
fn table(text: &str, sets: &[&str]) -> toml::Table {
    resolved(text, sets).unwrap().table
}

/// What a text and these `--set` are refused with.
fn refused(text: &str, sets: &[&str]) -> String {
    resolved(text, sets).map(|layers| layers.table).unwrap_err().to_string()
}
