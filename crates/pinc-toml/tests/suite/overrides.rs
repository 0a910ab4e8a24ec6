//! `--set` and `--unset`: what they give, and what they are refused with.

use super::{refused, table};
use toml::Value;

const TEXT: &str = "preset = \"slow\"\n[model]\nname = \"a\"\nlist = [1, 2]\n";

/// A value is TOML, or a bare word: a letter, then letters, digits, `-` and `_`.
#[test]
fn a_value_is_toml_or_a_bare_word() {
    for (text, expected) in [
        ("1e-3", Value::Float(1e-3)),
        ("[1, 2]", Value::Array(vec![Value::Integer(1), Value::Integer(2)])),
        ("true", Value::Boolean(true)),
        ("\"b c\"", Value::String("b c".to_owned())),
        ("rk4", Value::String("rk4".to_owned())),
        (" as-printed_2 ", Value::String("as-printed_2".to_owned())),
        ("\"a=b\"", Value::String("a=b".to_owned())),
    ] {
        assert_eq!(table(TEXT, &[&format!("model.name={text}")])["model"]["name"], expected);
    }
    // Spaces around a key's parts are none of it.
    assert_eq!(table(TEXT, &[" model . new =1"])["model"]["new"], Value::Integer(1));
}

/// Each mistake is refused by what is wrong, with the option as it was given.
#[test]
fn an_override_that_cannot_be_read_says_why() {
    let needs = "the value is not TOML (a string with other characters than a-z, 0-9, - and _ \
                 needs quotes): ";
    for (set, expected) in [
        ("model.name", "expected key=value, as training.lambda=0.5"),
        ("model..name=1", "expected key=value, as training.lambda=0.5"),
        ("=1", "expected key=value, as training.lambda=0.5"),
        ("model.name=a b", needs),
        ("model.name=4tanks", needs),
        ("model.name=a.b", needs),
        ("model.name=", needs),
        ("model.name=1\nother = 2", &format!("{needs}one value expected")),
        ("model.name.deep=1", "`model.name` is not a table, or has no such element"),
        ("model.list.2=1", "`model.list` is not a table, or has no such element"),
    ] {
        let said = refused(TEXT, &[set]);
        assert!(said.starts_with(&format!("--set {set}: {expected}")), "{said}");
    }
    for (unset, expected) in [
        ("--unset ", "expected a key, as training.lambda"),
        ("--unset model.", "expected a key, as training.lambda"),
        (
            "--unset model.x",
            "there is no key `model.x`; expected one that the config or its preset has",
        ),
        (
            "--unset model.name.x",
            "there is no key `model.name.x`; expected one that the config or its preset has",
        ),
    ] {
        assert_eq!(refused(TEXT, &[unset]), format!("{unset}: {expected}"));
    }
}

/// Overrides count in their order; what is taken away takes no defaults with it.
#[test]
fn overrides_count_in_their_order() {
    let name = |sets: &[&str]| table(TEXT, sets)["model"].get("name").cloned();
    assert_eq!(name(&["model.name=b", "model.name=c"]), Some(Value::String("c".to_owned())));
    assert_eq!(name(&["model.name=b", "--unset model.name"]), None);
    assert_eq!(name(&["--unset model.name", "model.name=b"]), Some(Value::String("b".to_owned())));
    // A section that is only taken away from is not mentioned.
    let said = refused("preset = \"slow\"\n", &["--unset model.neurons"]);
    assert!(said.ends_with("expected one that the config or its preset has"), "{said}");
    let whole = table(TEXT, &["--unset model"]);
    assert_eq!(whole.keys().collect::<Vec<_>>(), ["preset"]);
}
