//! `[control.scenarios]`: what a controller gets of it.

use crate::common::parse;

const LOOP: &str = r#"
name = "branches"
preset = "ours"
seed = 1
[plant.expression]
states = ["x"]
inputs = ["u"]
parameters = { a = 1.0, b = 2.0 }
derivatives = { x = "b*u - a*x" }
[control]
models = ["rk4"]
step_s = 0.5
duration_s = 4.0
initial_state = [0.0]
controlled = ["x"]
q = [1.0]
r = [1.0]
input_low = [-1.0]
input_high = [1.0]
references = [{ start_s = 0.0, value = [0.0] }]
[control.scenarios]
values = { b = [2.0, 3.0], a = [1.0, 1.5] }
"#;

#[test]
fn branches_are_all_combinations_with_weights_of_1_together() {
    let of = |sets: &[&str]| parse(LOOP, sets).unwrap().scenarios().unwrap();
    assert_eq!(of(&[]).values, [[1.0, 2.0], [1.0, 3.0], [1.5, 2.0], [1.5, 3.0]]);
    assert_eq!(of(&[]).weights, [0.25; 4]);
    for weights in ["[0.1, 0.2, 0.3, 0.2]", "[1.0, 2.0, 3.0, 2.0]"] {
        let found = of(&[&format!("control.scenarios.weights={weights}")]).weights;
        let off = found.iter().zip([0.125, 0.25, 0.375, 0.25]).map(|(a, b)| (a - b).abs());
        assert!(found.len() == 4 && off.fold(0.0, f64::max) < 1e-15, "{weights}: {found:?}");
    }
}

#[test]
fn values_are_combined_in_order() {
    let in_order = "control.scenarios.combine=\"in-order\"";
    let found = parse(LOOP, &[in_order]).unwrap().scenarios().unwrap();
    assert_eq!((found.values, found.weights), (vec![vec![1.0, 2.0], vec![1.5, 3.0]], vec![0.5; 2]));
    let error =
        parse(LOOP, &[in_order, "control.scenarios.values.a=[1.0]"]).unwrap_err().to_string();
    assert!(error.contains("control.scenarios.values.a"), "{error}");
    assert!(error.contains("as many values as each other parameter has"), "{error}");
}

/// Between the ends, whatever the order of the list; by the seed, and the first ones are the same
/// however many there are.
#[test]
fn values_are_drawn() {
    let of = |draws: usize, more: &str| {
        let draws = format!("control.scenarios.combine={{ draws = {draws} }}");
        parse(LOOP, &[&draws, "control.scenarios.values.a=[1.2, 1.5, 1.0]", more]).unwrap()
    };
    let values = |draws, more| of(draws, more).scenarios().unwrap().values;
    let found = values(400, "seed=1");
    assert_eq!((found.len(), &found[0]), (401, &vec![1.2, 2.0]));
    for (k, [low, high]) in [[1.0, 1.5], [2.0, 3.0]].into_iter().enumerate() {
        assert!(found.iter().all(|branch| (low..=high).contains(&branch[k])));
        let below = found.iter().filter(|branch| branch[k] < low + 0.25 * (high - low)).count();
        assert!((70..130).contains(&below), "{below}");
    }
    assert_eq!(found[..6], values(5, "seed=1"));
    assert_ne!(found[..6], values(5, "seed=2"));
    let error = parse(LOOP, &["control.scenarios.combine={ draws = 0 }"]).unwrap_err().to_string();
    assert!(error.contains("control.scenarios.combine.draws"), "{error}");
    for (set, expected) in [
        ("control.delay_steps=1", "no such table with control.delay_steps"),
        (
            "control.parameters={ a = 1.2 }",
            "no such table with the same parameter in control.parameters",
        ),
    ] {
        let domain = "domain={ state_low = [0.0], state_high = [1.0], input_low = [0.0], \
                      input_high = [1.0], parameters = { a = [1.0, 2.0] } }";
        let error = parse(LOOP, &[domain, set]).unwrap_err().to_string();
        assert!(error.contains("`control.scenarios`") && error.contains(expected), "{error}");
    }
    let many = ["control.scenarios.combine={ draws = 100000 }"];
    let error = parse(LOOP, &many).unwrap_err().to_string();
    assert!(error.contains("branches^robust_horizon"), "{error}");
}
