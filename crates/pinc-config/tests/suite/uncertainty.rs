//! `[control.uncertainty]`: intervals from a file, and what is refused.

use crate::common::parse;
use std::fs;

const LOOP: &str = r#"
name = "uncertain"
preset = "ours"
seed = 1

[plant.expression]
states = ["x", "v"]
inputs = ["u"]
parameters = { a = 1.0, b = 2.0 }
derivatives = { x = "v", v = "b*u - a*x" }

[control]
models = ["rk4"]
step_s = 0.5
duration_s = 4.0
initial_state = [0.0, 0.0]
controlled = ["x"]
q = [1.0]
r = [1.0]
input_low = [-1.0]
input_high = [1.0]
references = [{ start_s = 0.0, value = [0.0] }]

[control.uncertainty]
probability = "worst-case"
boxes = { v = 0.1 }
"#;

#[test]
fn intervals_are_read_from_what_was_identified() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("identify.json");
    let set = format!("control.uncertainty.parameters={:?}", file.to_str().unwrap());
    for (half, expected) in [("0.5", Some([0.75, 1.75])), ("null", None)] {
        let text =
            format!(r#"{{"parameters": {{"a": {{"value": 1.25, "half_width_95": {half}}}}}}}"#);
        fs::write(&file, text).unwrap();
        match (parse(LOOP, &[&set]), expected) {
            (Ok(experiment), Some(expected)) => {
                let spec = experiment.control.as_ref().unwrap().uncertainty.as_ref().unwrap();
                assert_eq!(spec.parameters["a"].map(f64::to_bits), expected.map(f64::to_bits));
                let known = experiment.loop_parameters();
                assert_eq!((&known.names[..], &known.values[..]), (&["a"][..], &[1.0][..]));
            }
            (Err(refused), None) => {
                let refused = refused.to_string();
                assert!(refused.contains("identify.json: `a` has no interval there"), "{refused}");
            }
            (other, _) => panic!("{other:?}"),
        }
    }
    fs::remove_file(&file).unwrap();
    let refused = parse(LOOP, &[&set]).unwrap_err().to_string();
    assert!(refused.contains("`control.uncertainty.parameters`"), "{refused}");
    assert!(refused.contains("the path of an identify.json"), "{refused}");
}

#[test]
fn scenarios_are_read_from_what_was_identified() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("identify.json");
    let text = r#"{"parameters": {"a": {"value": 1.25, "half_width_95": 0.5}}}"#;
    fs::write(&file, text).unwrap();
    let (before, _) = LOOP.split_once("[control.uncertainty]").unwrap();
    let set = format!("control.scenarios.values={:?}", file.to_str().unwrap());
    let experiment = parse(before, &[&set, "control.nu=5"]).unwrap();
    let spec = experiment.control.as_ref().unwrap().scenarios.as_ref().unwrap();
    let expected: Vec<u64> = [1.25, 0.75, 1.75].map(f64::to_bits).into();
    assert_eq!(spec.values["a"].iter().map(|v| v.to_bits()).collect::<Vec<_>>(), expected);
    let set = "control.scenarios.values=\"nowhere.json\"";
    let refused = parse(before, &[set]).unwrap_err().to_string();
    assert!(refused.contains("`control.scenarios.values`: nowhere.json given"), "{refused}");
}

#[test]
fn what_makes_no_tube_is_refused_by_name() {
    let of = |key: &str| format!("control.uncertainty.{key}");
    for (sets, expected) in [
        (
            vec![of("probability=0.3")],
            "`control.uncertainty.probability`: 0.3 given, expected from 0.5",
        ),
        (vec![of("probability=often")], "expected a probability, or \"worst-case\""),
        (vec![of("process_sd=[0.1, 0.1]")], "no such key with probability = \"worst-case\""),
        (vec![of("probability=0.9"), of("process_sd=[0.1]")], "1 values given, expected 2"),
        (
            vec!["control.free_time=u".into(), "control.input_low=[0.5]".into()],
            "expected no such table with control.free_time",
        ),
        (vec![of("probability=0.9"), of("estimate=true")], "expected [control.estimator]"),
        (vec![of("boxes={ w = 0.1 }")], "`w` is not known"),
        (vec![of("boxes={ v = -0.1 }")], "`control.uncertainty.boxes.v`"),
        (vec![of("boxes={}")], "nothing uncertain given"),
        (vec![of("net_error=true")], "expected \"pinc\" among control.models"),
        (vec![of("net_error=\"proven\"")], "expected \"pinc\" among control.models"),
        (vec![of("net_error=\"bounded\"")], "expected true, false or \"proven\""),
        (vec![of("parameters={ c = [0.0, 1.0] }")], "`c` is not known"),
        (vec![of("parameters={ a = [2.0, 1.0] }")], "the lower one first"),
        (vec![of("feedback=[[1.0]]")], "1 values given, expected 2"),
        (vec![of("feedback=[]")], "0 rows given, expected 1, one per input"),
        (vec![of("feedback=lqr")], "expected \"riccati\", \"none\" or a matrix"),
        (
            vec![of("tightenings=2"), "control.sqp.real_time=true".to_owned()],
            "2 given, expected no such number with sqp.real_time",
        ),
        (vec!["control.delay_steps=1".to_owned()], "no such table with control.delay_steps"),
        (
            vec!["control.scenarios.values={ a = [1.0, 2.0] }".to_owned()],
            "no such table with [control.scenarios]",
        ),
        (
            vec![
                of("parameters={ a = [0.5, 1.0] }"),
                "control.parameter_schedule=[{ start_s = 0.0, values = { a = 2.0 } }]".to_owned(),
            ],
            "no parameters of the loop can vary",
        ),
    ] {
        let sets: Vec<&str> = sets.iter().map(String::as_str).collect();
        let refused = parse(LOOP, &sets).unwrap_err().to_string();
        assert!(refused.contains(expected), "{sets:?}: {refused}");
    }
    parse(LOOP, &[]).unwrap();
}
