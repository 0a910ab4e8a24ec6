//! Lines of steps, good and bad.

use crate::Served;
use serde_json::{Value, json};

/// A measurement that is missing is no number; an input that was not the one chosen moves the
/// estimate.
#[test]
fn the_served_estimator_takes_what_is_missing_and_what_was_applied() {
    let config = "estimation/tanks.toml";
    let answers = [
        json!({ "y": [2.1, 2.0] }),
        json!({ "y": [null, null] }),
        json!({ "y": [null, null], "u_applied": [0.0, 0.0] }),
    ];
    let [measured, missing, applied] = answers.map(|request| {
        let mut served = Served::new(config, &[]);
        served.refuses(b"{\"y\": [2.0, 2.0, 0.6, 0.6]}", "expected 2, one per measured quantity");
        served.input(&json!({ "y": [2.0, 2.0] }));
        let answer = served.ask(&request);
        served.end();
        answer
    });
    assert_eq!(measured["estimator"], "updated");
    assert_eq!(missing["estimator"], "nothing-measured");
    let level = |answer: &Value| answer["x"][0].as_f64().unwrap();
    assert!(level(&applied) < level(&missing) - 0.1, "{applied} {missing}");
}

/// `describe` names no parameter here, and a line may say as much.
#[test]
fn a_line_may_have_no_parameters_where_none_are_measured() {
    for config in ["estimation/tanks.toml", "four-tanks/control.toml"] {
        let mut served = Served::new(config, &[]);
        let about = served.ask(&json!({ "command": "describe" }));
        assert_eq!(about["parameters"], json!([]), "{config}");
        let y = if about["measured"].as_array().unwrap().len() == 2 {
            &[2.0; 2][..]
        } else {
            &[2.0; 4]
        };
        let plain = served.input(&json!({ "y": y }));
        served.ask(&json!({ "command": "reset" }));
        let told = served.input(&json!({ "y": y, "parameters": [] }));
        assert!(told.total_cmp(&plain).is_eq(), "{config}: {told} {plain}");
        served.end();
    }
}

/// An input beyond its bounds was not applied: the line is refused, and neither the estimator nor the
/// controller has heard of it.
#[test]
fn an_applied_input_beyond_its_bounds_is_refused() {
    let config = "estimation/tanks.toml";
    let [mut told, mut untold] = [(); 2].map(|()| Served::new(config, &[]));
    let first = json!({ "y": [2.0, 2.0] });
    told.input(&first);
    untold.input(&first);
    for (line, part) in [
        (
            &b"{\"y\": [2.1, 2.0], \"u_applied\": [1e5, 0]}"[..],
            "u_applied[0] is 100000, but must be within its bounds, 0 to 5",
        ),
        (b"{\"y\": [2.1, 2.0], \"u_applied\": [1.0, -0.1]}", "u_applied[1] is -0.1, but must be"),
    ] {
        told.refuses(line, part);
    }
    let next = json!({ "y": [2.3, 2.2] });
    let [found, expected] = [told.ask(&next), untold.ask(&next)];
    for key in ["u", "x", "unknowns", "estimator", "status"] {
        assert_eq!(found[key], expected[key], "{key}");
    }
    told.end();
    untold.end();
}

/// A wild reading is rejected, and the answer says so; a jump that stays is believed at its fifth
/// reading.
#[test]
fn the_served_estimator_says_what_its_gate_rejects() {
    let config = "estimation/tanks.toml";
    // At rest under 3 V, with the pumps that the model has.
    let sets = [
        "control.estimator.initial_estimate=[12.4, 12.7, 1.8, 1.4]",
        "control.estimator.disturbance=none",
        "control.estimator.disturbance_sd=[]",
        "control.estimator.disturbance_initial_sd=[]",
    ];
    let mut served = Served::new(config, &sets);
    let mut ask = |y: [f64; 2]| {
        let answer = served.ask(&json!({ "y": y, "u_applied": [3.0, 3.0] }));
        let level = answer["x"][0].as_f64().unwrap();
        (answer["estimator"].as_str().unwrap().to_owned(), level)
    };
    for _ in 0..20 {
        let (status, level) = ask([12.4, 12.7]);
        assert!(status == "updated" && (level - 12.4).abs() < 0.1, "{status} {level}");
    }
    let (status, level) = ask([65535.0, 12.7]);
    assert!(status == "rejected" && (level - 12.4).abs() < 0.1, "{status} {level}");
    assert_eq!(ask([12.4, 12.7]).0, "updated");
    // 2.8 cm: beyond 30 times the root of about 0.03^2 + 0.05^2, within 30 times the root of 0.1^2
    // + 0.05^2.
    for k in 0..5 {
        let (status, level) = ask([15.2, 12.7]);
        let (expected, near) = if k < 4 { ("rejected", 12.4) } else { ("reacquired", 15.2) };
        assert!(status == expected && (level - near).abs() < 0.8, "{k}: {status} {level}");
    }
    served.end();
}

#[test]
fn bad_lines_are_answered_and_change_nothing() {
    let config = "van-der-pol/control.toml";
    let mut served = Served::new(config, &[]);
    let mut other = Served::new(config, &[]);
    let good = json!({ "y": [0.5, 0.1] });
    assert!(served.input(&good).total_cmp(&other.input(&good)).is_eq());
    for (line, part) in [
        (&b""[..], "expected"),
        (b"hello", "expected {\"y\""),
        (b"{\"y\": [0.1, 0.2]", "EOF"),
        (b"{\"y\": [0.1]}", "y: 1 numbers given, expected 2"),
        (b"{\"y\": [0.1, 1e999]}", "out of range"),
        (b"{\"y\": [0.1, 0.2], \"reference\": [0.1, NaN]}", "`reference`: expected numbers, or"),
        (b"[null, null, [0.1, 0.2], null, null, null, null]", "not an object; expected {\"y\""),
        (b"{\"y\": [0.1, 0.2], \"u_applied\": [NaN]}", "null"),
        (b"{\"y\": [0.1, \"NaN\"]}", "string"),
        (b"{\"x\": [0.1, 0.2]}", "unknown field `x`"),
        (b"{\"x\\\"NaN\": [0.1, 0.2]}", "unknown field `x\"NaN`"),
        (b"{\"u_applied\": [0.1]}", "missing field `y`"),
        (b"{\"y\": [0.1, 0.2], \"reference\": [0.1]}", "reference: 1 numbers given, expected 2"),
        (b"{\"y\": [0.1, 0.2], \"reference\": [[0.1, 0.2]]}", "1 rows given, expected"),
        (b"{\"y\": [0.1, 0.2], \"reference\": \"up\"}", "expected"),
        (b"{\"y\": [0.1, 0.2], \"u_applied\": [0.1, 0.2]}", "u_applied: 2 numbers given"),
        (b"{\"y\": [0.1, 0.2], \"u_applied\": [9.5]}", "u_applied[0] is 9.5, but must be within"),
        (b"\xff\xfe{}", "expected"),
    ] {
        served.refuses(line, part);
    }
    let next = json!({ "y": [0.4, -0.1] });
    assert!(served.input(&next).total_cmp(&other.input(&next)).is_eq());
    served.end();
    other.end();
}

/// Without an estimator nothing can be made of a state that is not all there: the last input is
/// held, and the step counts. What is missing is null, or what Python writes for it.
#[test]
fn a_missing_measurement_holds_the_last_input() {
    let config = "van-der-pol/control.toml";
    let sets = ["control.initial_input=[0.25]"];
    let mut served = Served::new(config, &sets);
    let mut told = Served::new(config, &sets);
    let ask = |served: &mut Served, line: &str, u: f64| {
        let answer = served.ask_bytes(line.as_bytes());
        assert_eq!(answer["status"], "bad-argument", "{answer}");
        assert!(answer["u"][0].as_f64().unwrap().total_cmp(&u).is_eq(), "{answer} {u}");
        answer
    };
    let answer = ask(&mut served, "{\"y\": [null, 0.1]}", 0.25);
    assert_eq!(answer["x"], json!([null, 0.1]));
    told.input(&json!({ "y": [0.5, 0.1] }));
    let next = json!({ "y": [0.45, 0.05] });
    let u = served.input(&next);
    let same = told.input(&json!({ "y": [0.45, 0.05], "u_applied": [0.25] }));
    assert!((u - same).abs() < 1e-7, "{u} {same}");
    for line in ["{\"y\":[NaN,NaN]}", "{\"y\": [0.4, -Infinity]}", "{ \"y\": [Infinity, 0.0] }"] {
        ask(&mut served, line, u);
        told.input(&json!({ "y": [0.4, 0.0], "u_applied": [u] }));
    }
    // References of the config are at the same step.
    for _ in 0..40 {
        let last = json!({ "y": [0.4, 0.0], "u_applied": [u] });
        let [u, same] = [&mut served, &mut told].map(|served| served.input(&last));
        assert!((u - same).abs() < 1e-7, "{u} {same}");
    }
    served.end();
    told.end();
}

#[test]
fn the_applied_input_and_the_reference_count() {
    let config = "van-der-pol/control.toml";
    let answers = [
        json!({ "y": [0.4, 0.2] }),
        json!({ "y": [0.4, 0.2], "u_applied": [1.0] }),
        json!({ "y": [0.4, 0.2], "reference": [0.8, 0.0] }),
    ];
    let inputs = answers.map(|request| {
        let mut served = Served::new(config, &[]);
        served.input(&json!({ "y": [0.5, 0.1] }));
        let u = served.input(&request);
        served.end();
        u
    });
    // The input changes slowly, since changes are weighted; the reference is above.
    assert!(inputs[1] > inputs[0] + 0.05, "{inputs:?}");
    assert!(inputs[2] > inputs[0] + 0.1, "{inputs:?}");
}

/// From a line on, the model has the measured parameters in it; a refused line changes nothing.
#[test]
fn measured_parameters_are_those_of_the_line() {
    let config = "four-tanks/family.toml";
    let measured = "control.measured_parameters=[\"k1\", \"k2\"]";
    let y = json!([8.0, 12.0, 2.0, 3.0]);
    let plain = json!({ "y": y });
    let line = json!({ "y": y, "parameters": [3.33, 3.35] });
    let first_with = |sets: &[&str], request: &Value| {
        let mut served = Served::new(config, sets);
        let u = served.input(request);
        served.end();
        u
    };
    let first = |set: &str, request: &Value| first_with(&[set], request);
    let own = "control.parameters={ k1 = 3.33, k2 = 3.35 }";
    let told = first(own, &plain);
    assert!(first(measured, &line).total_cmp(&told).is_eq());
    // Without, what the models have: the plant in the loop is not known.
    assert!((first(measured, &plain) - told).abs() > 1e-3);
    assert!(first_with(&[measured, own], &plain).total_cmp(&told).is_eq());
    let other = "control.plant.four-tanks.pump=[3.33, 3.35]";
    assert!(first_with(&[measured, other], &plain).total_cmp(&first(measured, &plain)).is_eq());
    let mut served = Served::new(config, &[measured]);
    let refused = br#"{"y": [8.0, 12.0, 2.0, 3.0], "parameters": [3.33]}"#;
    served.refuses(refused, "parameters: 1 numbers given, expected 2, one per measured parameter");
    served.refuses(br#"{"y": [8.0], "parameters": [3.33, 3.35]}"#, "y: 1 numbers given");
    assert!(served.input(&plain).total_cmp(&first(measured, &plain)).is_eq());
    served.end();
}

/// A line longer than any request is skipped, and the next line is the same step; what an error
/// repeats of a line is short.
#[test]
fn long_lines_are_refused_and_not_repeated() {
    let config = "van-der-pol/control.toml";
    let mut served = Served::new(config, &[]);
    // Two states, a reference of five rows of two, and an input.
    let state = served.ask(&json!({ "command": "save" }))["state"]["numbers"].clone();
    let longest = 65_536 + 64 * (2 + 5 * 2 + 1 + state.as_array().unwrap().len());
    let padded = |length: usize| {
        let request = "{\"y\":[0.5,0.1]}";
        format!("{}{request}", " ".repeat(length - request.len()))
    };
    let refused = format!("a line of more than {longest} bytes given");
    served.refuses(padded(longest + 1).as_bytes(), &refused);
    served.refuses(&b"[".repeat(3_000_000), &refused);
    let key = format!("{{\"{}\":1}}", "k".repeat(60_000));
    let answer = served.ask_bytes(key.as_bytes());
    let error = answer["error"].as_str().unwrap();
    assert!(error.starts_with("unknown field `kkk") && error.len() < 1000, "{}", error.len());
    let answer = served.ask_bytes(padded(longest).as_bytes());
    let u = answer["u"][0].as_f64().unwrap();
    assert!((u + 0.145_616_002_283_442_9).abs() < 1e-9, "{answer}");
    served.end();
}

/// With a cost of its own, the plan's is in the answer, and whether it is known to be a minimum.
#[test]
fn a_cost_is_answered_where_there_is_one() {
    let mut served = Served::new("gallery/van-de-vusse.toml", &[]);
    let answer = served.ask(&json!({ "y": [0.8, 0.5, 134.14, 130.0] }));
    assert!(answer["cost"].is_f64() && answer["curvature_dropped"].is_boolean(), "{answer}");
    served.end();
    let mut served = Served::new("van-der-pol/control.toml", &[]);
    let answer = served.ask(&json!({ "y": [0.5, 0.1] }));
    assert!(answer.get("cost").is_none() && answer.get("curvature_dropped").is_none(), "{answer}");
    served.end();
}
