//! Numbers that are not finite, and long ones in messages.

use pinc_toml::{Problem, first_not_finite};
use toml::Table;

fn first(text: &str, bounds: &[&str]) -> Option<(String, String)> {
    let table: Table = text.parse().unwrap();
    first_not_finite(&table, bounds).map(|(key, value)| (key, value.to_string()))
}

/// The key leads through tables and lists to the number.
#[test]
fn a_number_that_is_not_finite_is_found_by_its_key() {
    for (text, key, value) in [
        ("a = nan", "a", "NaN"),
        ("a = 1.0\nb = -inf", "b", "-inf"),
        ("[a]\nb = [1.0, [2.0, inf]]", "a.b[1][1]", "inf"),
        ("a = [{ b = 1.0 }, { c = { d = inf } }]", "a[1].c.d", "inf"),
    ] {
        assert_eq!(first(text, &[]), Some((key.to_owned(), value.to_owned())));
    }
    assert_eq!(first("a = 1e308\nb = [0.0, 1]\nc = \"inf\"", &[]), None);
}

/// A bound may be infinite on its own side, as a list or a table, and not on the other.
#[test]
fn a_bound_may_be_infinite_on_its_side_only() {
    let bounds = ["control.u_low", "control.u_high"];
    let found = |low: &str, high: &str| {
        first(&format!("[control]\nu_low = {low}\nu_high = {high}\n"), &bounds)
    };
    assert_eq!(found("[-inf, 0.0]", "[1.0, inf]"), None);
    assert_eq!(found("{ a = -inf }", "{ a = inf, b = 1.0 }"), None);
    for (low, high, key) in [
        ("[inf]", "[inf]", "control.u_low[0]"),
        ("[-inf]", "[-inf]", "control.u_high[0]"),
        ("{ a = nan }", "[inf]", "control.u_low.a"),
        ("[-inf]", "{ a = 1.0, b = -inf }", "control.u_high.b"),
        // One number for all is none.
        ("-inf", "[inf]", "control.u_low"),
    ] {
        assert_eq!(found(low, high).map(|(key, _)| key), Some(key.to_owned()));
    }
    // Another key of the same name is no bound.
    assert_eq!(first("u_high = [inf]", &bounds).map(|(key, _)| key), Some("u_high[0]".to_owned()));
}

/// A number of hundreds of digits is said with an exponent, one of ordinary size as it was written.
#[test]
fn long_numbers_are_said_with_an_exponent() {
    let long = format!("1{}", "0".repeat(30));
    for (found, said) in [
        (format!("`{long}`,"), "`1e30`,".to_owned()),
        (format!("{long}:"), "1e30:".to_owned()),
        ("0.125".to_owned(), "0.125".to_owned()),
        ("123456789012345678901234".to_owned(), "123456789012345678901234".to_owned()),
        ("1234567890123456789012345".to_owned(), "1.2345678901234568e24".to_owned()),
        ("a_word_of_more_than_twenty_four_letters".to_owned(), {
            "a_word_of_more_than_twenty_four_letters".to_owned()
        }),
    ] {
        let problem = Problem::Value { found, expected: format!("at most {long}") };
        assert_eq!(problem.to_string(), format!("{said} given, expected at most 1e30"));
    }
}
