//! The reference of config keys: every key of a config, read from the types that configs are
//! deserialized into.

use pinc_tests::book::{self, root};

#[test]
fn every_key_is_described_by_sentences() {
    let poor = book::undescribed_keys();
    assert!(poor.is_empty(), "{}", poor.join("\n"));
}

/// What the page says is what the program reads: resolved shipped configs have no key without a row,
/// and rows say the values that a config has without saying them.
#[test]
fn the_page_has_the_keys_and_defaults_of_resolved_configs() {
    let text = book::page(&root().join("docs/config.md")).expect("the page");
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
