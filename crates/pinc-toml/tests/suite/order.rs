//! Lists whose order is that of a table's keys.

use super::resolved;

/// What a list for two states is refused with, in a file with these lines.
fn said(states: &str, list: &str) -> Option<String> {
    let text = format!("preset = \"slow\"\n[plant]\n{states}\n[control]\nq = {list}\n");
    let checked = resolved(&text, &[]).unwrap().in_order_of_keys("control.q", "plant");
    checked.err().map(|error| error.to_string())
}

/// A list is by the alphabet; one that may be meant in the order of the file is given as a table
/// in that order.
#[test]
fn a_list_that_may_be_meant_in_another_order_is_refused() {
    let expected = "a.toml:6: `control.q`: [1.0, 2.0] given, expected a table by name, as \
                    { b = 1.0, a = 2.0 } in the order of the file: the plant's is a, b";
    assert_eq!(said("b = 1\na = 2", "[1.0, 2.0]").as_deref(), Some(expected));
    // In the order of the alphabet there is no doubt, nor of equal numbers, nor of a table.
    assert_eq!(said("a = 2\nb = 1", "[1.0, 2.0]"), None);
    assert_eq!(said("b = 1\na = 2", "[1.0, 1.0]"), None);
    assert_eq!(said("b = 1\na = 2", "{ a = 1.0, b = 2.0 }"), None);
    // The last of three may differ.
    assert!(said("b = 1\na = 2\nc = 3", "[1.0, 1.0, 2.0]").is_some());
}

/// The elements of an array are one key, and a list of another length names no numbers.
#[test]
fn elements_of_an_array_are_one_key() {
    let found = said("\"q[2]\" = 1\n\"q[1]\" = 1\na = 2", "[1.0, 2.0, 3.0]").unwrap();
    let expected = "{ q = .., a = .. } in the order of the file: the plant's is a, q";
    assert!(found.ends_with(expected), "{found}");
    assert_eq!(said("a = 2\n\"q[2]\" = 1\n\"q[1]\" = 1", "[1.0, 2.0, 3.0]"), None);
}

/// The preset's part of the file counts by the place of its lines; defaults and overrides have no
/// order.
#[test]
fn only_keys_of_the_file_have_an_order() {
    let file = |before: &str, after: &str| {
        format!("preset = \"slow\"\n{before}[plant]\nb = 1\n{after}[control]\nq = [1.0, 2.0]\n")
    };
    let checked = |text: &str, sets: &[&str]| {
        resolved(text, sets).unwrap().in_order_of_keys("control.q", "plant").is_ok()
    };
    let part = "[presets.slow.plant]\na = 1\n";
    assert!(checked(&file(part, ""), &[]), "a before b");
    assert!(!checked(&file("", part), &[]), "a after b");
    assert!(checked(&file("", ""), &["plant.a=1"]), "a without an order");
}
