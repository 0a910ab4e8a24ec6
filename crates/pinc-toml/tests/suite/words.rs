//! Words and keys that are not known, and errors of deserialization in plain words.

use pinc_toml::{ConfigError, Problem, explain, nearest};
use serde::Deserialize;
use std::collections::BTreeMap;

/// A config with a value of each kind.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Config {
    #[expect(dead_code, reason = "only read")]
    number: f64,
    #[expect(dead_code, reason = "only read")]
    count: Option<usize>,
    #[expect(dead_code, reason = "only read")]
    list: Option<Vec<f64>>,
    #[expect(dead_code, reason = "only read")]
    table: Option<BTreeMap<String, f64>>,
    #[expect(dead_code, reason = "only read")]
    inner: Option<Vec<Inner>>,
    #[expect(dead_code, reason = "only read")]
    kind: Option<Kind>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Inner {
    #[expect(dead_code, reason = "only read")]
    width: f64,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Kind {
    Fast,
    Slow,
    #[expect(dead_code, reason = "only read")]
    Other(Inner),
}

/// The key of the mistake in a text, and what is wrong there.
fn explained(text: &str) -> (String, Problem) {
    let table: toml::Table = text.parse().unwrap();
    explain(&serde_path_to_error::deserialize::<_, Config>(table).unwrap_err())
}

/// Each mistake has the key where it is, and says what is expected without a type of Rust.
#[test]
fn mistakes_are_explained_with_their_key() {
    for (text, key, said) in [
        ("", "number", "missing; expected a value for this key"),
        (
            "number = 1.0\ninner = [{ width = 1.0 }, {}]",
            "inner[1].width",
            "missing; expected a value for this key",
        ),
        (
            "number = 1.0\ncuont = 1",
            "cuont",
            "unknown key; expected one of number, count, list, table, inner, kind; did you mean \
             `count`?",
        ),
        (
            "number = 1.0\ninner = [{ width = 1.0, height = 1.0 }]",
            "inner[0].height",
            "unknown key; expected one of width",
        ),
        (
            "number = 1.0\nkind = \"fats\"",
            "kind",
            "`fats` is not known; expected one of fast, slow, other; did you mean `fast`?",
        ),
        ("number = \"a\"", "number", "invalid type: string \"a\", expected a number"),
        (
            "number = 1.0\ncount = \"a\"",
            "count",
            "invalid type: string \"a\", expected a whole number, 0 or more",
        ),
        ("number = 1.0\nlist = 1", "list", "invalid type: integer `1`, expected a list"),
        ("number = 1.0\ntable = 1", "table", "invalid type: integer `1`, expected a table"),
        ("number = 1.0\nkind = {}", "kind", "no key or several given, expected exactly one"),
        (
            "number = 1.0\nkind = \"other\"",
            "kind.other",
            "a word given, expected a table with a value for it",
        ),
    ] {
        let (found, problem) = explained(text);
        assert_eq!((&*found, &*problem.to_string()), (key, said), "{text}");
    }
    let (key, problem) = explained("number = 1.0\ninner = [1]");
    assert_eq!(key, "inner[0]");
    assert_eq!(problem.to_string(), "invalid type: integer `1`, expected a table");
}

/// The nearest word is one in which at most a third of the letters is wrong; a swap of neighbours
/// is one mistake.
#[test]
fn the_nearest_word_has_a_third_of_its_letters_wrong_at_most() {
    let known = ["lambda", "low", "longest", "lowest"].map(str::to_owned);
    for (word, meant) in [
        ("lamda", Some("lambda")),
        ("lmabda", Some("lambda")),
        ("lambba", Some("lambda")),
        ("labmad", Some("lambda")),
        ("lodges", Some("longest")),
        ("hidden", None),
        ("lambxy", Some("lambda")),
        ("lambxyz", None),
        ("la", None),
        ("lo", Some("low")),
        ("lxx", None),
        ("lowets", Some("lowest")),
        ("", None),
        ("LONGEST", Some("longest")),
    ] {
        assert_eq!(nearest(word, &known).as_deref(), meant, "{word}");
    }
    assert_eq!(nearest(&"l".repeat(101), &["l".repeat(101)]), None);
    assert_eq!(nearest(&"l".repeat(100), &["l".repeat(100)]), Some("l".repeat(100)));
    assert_eq!(nearest("low", &[]), None);
    // The same letter in the other case is nearer than another one.
    let known = ["P", "h"].map(str::to_owned);
    assert_eq!(nearest("H", &known).as_deref(), Some("h"));
}

/// A list of the wrong length says what its entries are, by name where they have names.
#[test]
fn a_list_of_the_wrong_length_says_what_its_entries_are() {
    let said = |names: &[&str]| {
        let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
        Problem::Length { found: 3, expected: 2, per: "input", names }.to_string()
    };
    assert_eq!(said(&["a", "b"]), "3 values given, expected 2: a, b");
    assert_eq!(said(&[]), "3 values given, expected 2, one per input");
}

/// An error at a key of a text without layers has the key's line, or that of what is around it.
#[test]
fn an_error_at_a_key_has_its_line() {
    let text = "a = 1\n[b]\nc = [\n  1,\n  { d = 2 },\n  3\n]\n";
    for (key, line) in [
        ("a", 1),
        ("b", 2),
        ("b.c", 3),
        ("b.c[0]", 4),
        ("b.c[1].d", 5),
        ("b.c[2]", 6),
        ("b.x", 2),
        ("x", 1),
    ] {
        let error = ConfigError::at_key("f.toml".as_ref(), text, key, Problem::NotFinite(1.0));
        let expected = format!("f.toml:{line}: `{key}`: 1 given, expected a finite number");
        assert_eq!(error.to_string(), expected);
    }
}
