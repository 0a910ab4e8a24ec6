//! Searches.

use super::*;

fn range(text: &str) -> SearchRange {
    toml::from_str(&format!("key = \"model.neurons\"\n{text}")).unwrap()
}

#[test]
fn values_are_in_their_ranges_and_reach_both_ends() {
    let whole = range("low = 2\nhigh = 5\nwhole = true");
    let at = |range: &SearchRange, place| range.value(place);
    let found: Vec<_> = [0.0, 0.3, 0.6, 0.999].map(|place| at(&whole, place)).into();
    assert_eq!(found, [2, 3, 4, 5].map(Value::Integer));
    let log = range("low = 0.001\nhigh = 10.0\nlog = true");
    assert_eq!(at(&log, 0.0), Value::Float(0.001));
    assert_eq!(at(&log, 0.5), Value::Float(0.1));
    assert_eq!(at(&log, 0.123), Value::Float(0.003105));
    let both = range("low = 1\nhigh = 64\nwhole = true\nlog = true");
    assert_eq!([0.0, 0.5, 0.9999].map(|p| at(&both, p)), [1, 6, 64].map(Value::Integer));
    let list = range("values = [\"a\", \"b\"]");
    assert_eq!(at(&list, 0.49), Value::String("a".to_owned()));
    assert_eq!(at(&list, 0.51), Value::String("b".to_owned()));
    for wrong in ["low = 1.0", "low = 2.0\nhigh = 1.0", "low = 0\nhigh = 1\nlog = true", ""] {
        assert!(range(wrong).check("ranges[0]").is_err(), "{wrong}");
    }
}

#[test]
fn each_rung_has_a_share_of_the_candidates_and_a_multiple_of_the_budget() {
    let halving = HalvingSpec {
        key: "training.phases.0.iterations".to_owned(),
        also: Vec::new(),
        least: 100,
        factor: 3,
        rungs: 4,
    };
    assert_eq!([0, 1, 2, 3].map(|rung| halving.budget(rung)), [100, 300, 900, 2700]);
    assert_eq!([0, 1, 2, 3].map(|rung| halving.survivors(20, rung)), [20, 7, 3, 1]);
}
