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
