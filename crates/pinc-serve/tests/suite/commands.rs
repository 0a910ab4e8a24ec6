//! What is served beside steps: a description, a state that outlives the process.

use crate::Served;
use serde_json::{Value, json};

/// Steps before and after the restart.
const STEPS: usize = 12;

fn measured(k: usize, base: &[f64]) -> Value {
    let wave = |i: usize| 0.05 * ((3 * k + 5 * i) as f64).sin();
    json!(base.iter().enumerate().map(|(i, y)| y + wave(i)).collect::<Vec<_>>())
}

/// A process that takes the state of another gives the inputs that the other gives.
#[test]
fn a_restarted_process_goes_on_without_a_bump() {
    let oscillator = "van-der-pol/control.toml";
    let tanks = "estimation/tanks.toml";
    let window = "control.estimator.window=5";
    for (config, base, sets) in [
        (oscillator, &[0.4, -0.1][..], &[][..]),
        (oscillator, &[0.4, -0.1], &["control.delay_steps=2", "control.initial_input=[0.3]"]),
        (oscillator, &[0.4, -0.1], &["control.sqp.real_time=true"]),
        (tanks, &[2.0, 2.1], &["control.estimator.kind=ekf"]),
        (tanks, &[2.0, 2.1], &["control.estimator.kind=ukf", "control.delay_steps=1"]),
        (tanks, &[2.0, 2.1], &["control.estimator.kind=mhe", window]),
    ] {
        let mut first = Served::new(config, sets);
        // One wild reading in between: what the gate knows goes along.
        let reading = |k: usize| match k {
            7 => json!({ "y": vec![1e5; base.len()] }),
            _ => json!({ "y": measured(k, base) }),
        };
        for k in 0..STEPS {
            first.ask(&reading(k));
        }
        let saved = first.ask(&json!({ "command": "save" }));
        let mut second = Served::new(config, sets);
        let restore = json!({ "command": "restore", "state": saved["state"] });
        assert_eq!(second.ask(&restore), json!({ "done": "restore" }), "{sets:?}");
        assert_eq!(second.ask(&json!({ "command": "save" })), saved, "{sets:?}");
        for k in STEPS..2 * STEPS {
            let [one, other] = [&mut first, &mut second].map(|served| served.ask(&reading(k)));
            for what in ["u", "x"] {
                let pairs =
                    one[what].as_array().unwrap().iter().zip(other[what].as_array().unwrap());
                for (a, b) in pairs {
                    let (a, b) = (a.as_f64().unwrap(), b.as_f64().unwrap());
                    assert!((a - b).abs() < 1e-9, "{sets:?} {k}: {what} {one} {other}");
                }
            }
            assert_eq!(one["estimator"], other["estimator"], "{sets:?} {k}");
        }
        // Afresh, the step is another one: the state was of use.
        assert_eq!(second.ask(&json!({ "command": "reset" })), json!({ "done": "reset" }));
        let mut fresh = Served::new(config, sets);
        let [again, new] = [&mut second, &mut fresh].map(|served| served.ask(&reading(0)));
        assert_eq!(again["u"], new["u"], "{sets:?}");
        [first, second, fresh].into_iter().for_each(Served::end);
    }
}

#[test]
fn what_is_served_is_described() {
    let config = "estimation/tanks.toml";
    let sets = ["control.delay_steps=1", "control.budget_us=800.0"];
    let mut served = Served::new(config, &sets);
    let described = served.ask(&json!({ "command": "describe" }));
    assert_eq!(described["version"], env!("CARGO_PKG_VERSION"));
    assert_eq!(described["model"], "rk4");
    assert_eq!(described["sample_time_s"], 10.0);
    assert_eq!(described["delay_steps"], 1);
    assert_eq!(described["budget_us"], 800.0);
    assert_eq!(described["measured"], json!(["h1", "h2"]));
    assert_eq!(described["controlled"], json!(["h1", "h2"]));
    assert_eq!(described["inputs"][0]["name"], "u1");
    assert_eq!(described["inputs"][0]["low"], 0.0);
    assert_eq!(described["states"][3]["name"], "h4");
    assert_eq!(described["states"][3]["unit"], "cm");
    assert_eq!(described["unknowns"], json!(["d_u1", "d_u2"]));
    let answer = served.ask(&json!({ "y": [2.0, 2.0] }));
    assert_eq!(answer["unknowns"].as_array().unwrap().len(), 2);
    let rows =
        vec![vec![3.0, 3.0]; usize::try_from(described["horizon"].as_u64().unwrap()).unwrap()];
    let answer = served.ask(&json!({ "y": [2.0, 2.0], "reference": rows }));
    assert!(answer["u"].is_array(), "{answer}");
    served.end();
    let measured = ["control.measured_parameters=[\"k2\", \"k1\"]"];
    let mut served = Served::new("four-tanks/family.toml", &measured);
    let described = served.ask(&json!({ "command": "describe" }));
    assert_eq!(described["parameters"], json!(["k2", "k1"]));
    assert_eq!(described["unknowns"], json!([]));
    assert_eq!(described["measured"], json!(["h1", "h2", "h3", "h4"]));
    served.end();
}

#[test]
fn commands_that_cannot_be_carried_out_change_nothing() {
    let tanks = "estimation/tanks.toml";
    let config = "van-der-pol/control.toml";
    let mut strange = Served::new(tanks, &[]);
    let of_tanks = strange.ask(&json!({ "command": "save" }))["state"].clone();
    strange.end();
    let mut longer = Served::new(config, &["control.n2=9"]);
    let longer_state = longer.ask(&json!({ "command": "save" }))["state"].clone();
    longer.end();
    let mut served = Served::new(config, &[]);
    let mut other = Served::new(config, &[]);
    for request in [json!({ "y": [0.5, 0.1] }), json!({ "y": [0.4, 0.0] })] {
        assert_eq!(served.ask(&request)["u"], other.ask(&request)["u"]);
    }
    let mut damaged = served.ask(&json!({ "command": "save" }))["state"].clone();
    damaged["numbers"].as_array_mut().unwrap().pop();
    for (request, part) in [
        (json!({ "command": "stop" }), "unknown variant `stop`"),
        (json!({ "command": "reset", "y": [0.5, 0.1] }), "a command or a step"),
        (json!({ "command": "reset", "reference": [0.5, 0.1] }), "a command or a step"),
        (json!({ "command": "reset", "u_applied": [0.5] }), "a command or a step"),
        (json!({ "command": "reset", "parameters": [] }), "a command or a step"),
        (json!({ "command": "reset", "budget_us": 90.0 }), "a command or a step"),
        (json!({ "command": "restore" }), "expected \"state\""),
        (json!({ "command": "save", "state": damaged }), "restore only"),
        (json!({ "y": [0.5, 0.1], "state": damaged }), "restore only"),
        (json!({ "command": "restore", "state": of_tanks }), "with the states h1, h2, h3, h4"),
        (json!({ "command": "restore", "state": longer_state }), "another horizon"),
        (json!({ "command": "restore", "state": damaged }), "another horizon or estimator"),
        (json!({ "y": [0.5, 0.1], "budget_us": -1.0 }), "budget_us: -1 given"),
    ] {
        served.refuses(request.to_string().as_bytes(), part);
    }
    let next = json!({ "y": [0.3, -0.1] });
    assert_eq!(served.ask(&next)["u"], other.ask(&next)["u"]);
    served.end();
    other.end();
}

/// What a controller does not have is not in its answers: no guard, estimator, starts or tube.
#[test]
fn an_answer_says_nothing_of_what_there_is_not() {
    let mut served = Served::new("van-der-pol/control.toml", &["control.state_high=[1.0, inf]"]);
    let answer = served.ask(&json!({ "y": [0.5, 0.1] }));
    for absent in
        ["trust", "model_error", "estimator", "unknowns", "start", "target_found", "in_tube"]
    {
        assert!(answer.get(absent).is_none(), "{absent}: {answer}");
    }
    assert_eq!(answer["x"], json!([0.5, 0.1]));
    assert_eq!(answer["u"].as_array().unwrap().len(), 1);
    // Bounds are said where there are any: a state without one has none.
    let described = served.ask(&json!({ "command": "describe" }));
    assert!(described["states"][1].get("high").is_none(), "{described}");
    assert!(described["states"][1]["low"].is_f64(), "{described}");
    for absent in ["model_sha256", "budget_us"] {
        assert!(described.get(absent).is_none(), "{absent}: {described}");
    }
    served.end();
}

/// A step with less time than any step takes ends at its deadline; one with more than a clock can
/// say does not.
#[test]
fn a_line_says_how_long_its_step_may_take() {
    let mut served = Served::new("van-der-pol/control.toml", &[]);
    let hurried = served.ask(&json!({ "y": [0.5, 0.1], "budget_us": 1e-3 }));
    assert_eq!(hurried["status"], "deadline", "{hurried}");
    for budget_us in [json!(null), json!(1e308)] {
        let unhurried = served.ask(&json!({ "y": [0.5, 0.1], "budget_us": budget_us }));
        assert_eq!(unhurried["status"], "converged", "{unhurried}");
    }
    served.end();
    let mut served = Served::new("van-der-pol/control.toml", &["control.budget_us=1e-3"]);
    assert_eq!(served.ask(&json!({ "y": [0.5, 0.1] }))["status"], "deadline");
    let unhurried = served.ask(&json!({ "y": [0.5, 0.1], "budget_us": 1e9 }));
    assert_eq!(unhurried["status"], "converged", "{unhurried}");
    served.end();
}
