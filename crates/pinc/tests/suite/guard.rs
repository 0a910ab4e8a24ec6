//! A closed loop that uses its net outside the training domain: reported, or ended.

use crate::common::{Outcome, outcome, pinc, smoke};
use crate::ways::Served;
use pinc_config::ModelKind;
use serde_json::json;
use std::path::Path;

/// Trains the smoke config on a box that the closed loop begins outside of, x1 = 0.5, and runs the
/// loop.
fn run(dir: &Path, sets: &[&str]) -> Outcome {
    let config = smoke().replacen("state_high = [3.0, 4.35]", "state_high = [0.4, 4.35]", 1);
    std::fs::write(dir.join("experiment.toml"), config).unwrap();
    let mut command = pinc(&["run", "experiment.toml", "--out", "run"]);
    for set in ["training.phases.0.iterations=20", "control.models=[\"pinc\", \"rk4\"]"] {
        command.args(["--set", set]);
    }
    outcome(command.args(sets).current_dir(dir))
}

#[test]
fn a_loop_outside_the_domain_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    // With a net that is hardly trained, steps fail: that is judged elsewhere.
    let outcome = run(dir.path(), &["--set", "control.max_failed_share=1.0"]);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    assert!(outcome.stdout.contains("outside the training domain in "), "{outcome:?}");
    let metrics = std::fs::read(dir.path().join("run/metrics.json")).unwrap();
    let metrics: serde_json::Value = serde_json::from_slice(&metrics).unwrap();
    let of = |model: &str| {
        let loops = metrics["control"].as_array().unwrap();
        loops.iter().find(|run| run["model"] == model).unwrap()["outside_domain"].clone()
    };
    let found = of("pinc");
    // Ten steps of 0.5 s, the first of them at x1 = 0.5, outside by 0.1 or by a little more later.
    assert_eq!(found["samples"], 10, "{found}");
    assert!((1..=9).contains(&found["outside"].as_u64().unwrap()), "{found}");
    assert!(found["variables"]["x1"]["farthest"].as_f64().unwrap() >= 0.1 - 1e-12, "{found}");
    assert!(of("rk4").is_null(), "{metrics}");
}

/// The measured state is in the box; the plan for the reference leaves it.
#[test]
fn a_plan_outside_the_domain_is_reported_or_refused() {
    for policy in ["report", "refuse"] {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("experiment.toml"), smoke()).unwrap();
        let mut command = pinc(&["run", "experiment.toml", "--out", "run"]);
        for set in [
            "domain.state_high=[0.52, 4.35]",
            "control.references=[{ start_s = 0.0, value = [0.8, 0.0] }]",
            "control.duration_s=0.5",
            &format!("control.outside_domain=\"{policy}\""),
        ] {
            command.args(["--set", set]);
        }
        let outcome = outcome(command.current_dir(dir.path()));
        if policy == "refuse" {
            assert_eq!(outcome.code, Some(1), "{outcome:?}");
            assert!(outcome.stderr.contains("outside its training domain: x1"), "{outcome:?}");
        } else {
            assert_eq!(outcome.code, Some(0), "{outcome:?}");
            let said = "outside the training domain in 1 of 1 steps: x1";
            assert!(outcome.stdout.contains(said), "{outcome:?}");
        }
    }
}

#[test]
fn a_loop_outside_the_domain_is_ended_where_that_is_asked_for() {
    let dir = tempfile::tempdir().unwrap();
    let outcome = run(dir.path(), &["--set", "control.outside_domain=\"refuse\""]);
    assert_eq!(outcome.code, Some(1), "{outcome:?}");
    for part in ["error: ", "x1", "[domain]", "with control.outside_domain = \"report\""] {
        assert!(outcome.stderr.contains(part), "no `{part}` in {outcome:?}");
    }
    // The net is trained and kept; its loop is not called done, and that of RK4 is run.
    assert!(dir.path().join("run/model.safetensors").exists());
    let metrics = std::fs::read(dir.path().join("run/metrics.json")).unwrap();
    let metrics: serde_json::Value = serde_json::from_slice(&metrics).unwrap();
    let loops = metrics["control"].as_array().unwrap();
    let [rk4] = &loops[..] else { panic!("{metrics}") };
    assert_eq!(rk4["model"], "rk4", "{metrics}");
}

/// A served controller answers with an error, and goes on as if it had not been asked.
#[test]
fn a_step_that_is_refused_changes_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("smoke.toml");
    std::fs::write(&config, smoke()).unwrap();
    let mut train = pinc(&["train", "smoke.toml", "--quiet", "--out", "net"]);
    assert_eq!(outcome(train.current_dir(dir.path())).code, Some(0));
    let model = dir.path().join("net/model.safetensors");
    let refuse = "control.outside_domain=\"refuse\"";
    let more = ["--model", model.to_str().unwrap(), "--set", refuse];
    let [mut asked, mut plain] = [0, 1].map(|_| Served::of(&config, ModelKind::Pinc, &more));
    let u = |served: &mut Served, x: f64| {
        served.ask(&json!({ "y": [x, 0.0] }))["u"][0].as_f64().unwrap()
    };
    assert!((u(&mut asked, 0.5) - u(&mut plain, 0.5)).abs() < 1e-12);
    let refused = asked.ask(&json!({ "y": [5.0, 0.0] }));
    let said = refused["error"].as_str().unwrap();
    assert!(said.contains("outside its training domain: x1 is 2.00 beyond"), "{said}");
    let states = [&mut asked, &mut plain].map(|of| of.ask(&json!({ "command": "save" })));
    assert_eq!(states[0], states[1]);
    assert!((u(&mut asked, 0.3) - u(&mut plain, 0.3)).abs() < 1e-12);
    asked.end();
    plain.end();
}

/// Recorded inputs that leave the box by 0.5 in three of eleven steps: identification and estimator
/// name them before they blame the plant or their numbers, or end there.
#[test]
fn recorded_data_outside_the_domain_are_reported_or_end_the_command() {
    let dir = tempfile::tempdir().unwrap();
    let sections = "\n[identify]\nmeasured = [\"x1\", \"x2\"]\nmeasurement_sd = [0.1, 0.1]\n\
        initial_state = [0.1, 0.0]\n[control.measurement]\n[control.estimator]\nkind = \"ekf\"\n\
        process_sd = [0.1, 0.1]\nmeasurement_sd = [0.1, 0.1]\ninitial_estimate = [0.1, 0.0]\n\
        initial_sd = [0.1, 0.1]\n";
    std::fs::write(dir.path().join("experiment.toml"), smoke() + sections).unwrap();
    let row =
        |k: u32| format!("{},{},0.1,0.0\n", 0.5 * f64::from(k), if k / 3 == 1 { 1.5 } else { 0.1 });
    let rows: String = (0..12).map(row).collect();
    std::fs::write(dir.path().join("data.csv"), "t,u,y_x1,y_x2\n".to_owned() + &rows).unwrap();
    let run = |command: &str, more: &[&str]| {
        let mut command = pinc(&[command, "experiment.toml"]);
        outcome(command.args(more).current_dir(dir.path()))
    };
    let iterations = ["--set", "training.phases.0.iterations=20", "--out", "net"];
    let trained = run("train", &iterations);
    assert_eq!(trained.code, Some(0), "{trained:?}");
    let files = ["--data", "data.csv", "--model", "net/model.safetensors"];
    let refuse = ["--set", "control.outside_domain=refuse"];
    let cases =
        [("identify", &["--out", "found"][..], "data.csv: "), ("estimate", &[], "data.csv:5: ")];
    for (command, out, place) in cases {
        let found = run(command, &[&files, out].concat());
        assert_eq!(found.code, Some(0), "{found:?}");
        let said = found.stdout.split("outside the training domain in ").nth(1);
        let said = said.unwrap_or_else(|| panic!("nothing said: {found:?}"));
        assert!(said.starts_with("3 of 11 steps: u by up to 0.500 (3 steps); "), "{found:?}");
        let ended = run(command, &[&files, &refuse[..]].concat());
        assert_eq!(ended.code, Some(1), "{ended:?}");
        let parts = [place, "u is 0.500 beyond -1 to 1", "control.outside_domain = \"report\""];
        for part in parts {
            assert!(ended.stderr.contains(part), "no `{part}` in {ended:?}");
        }
        let numerical = run(command, &["--data", "data.csv", "--only", "rk4"]);
        assert_eq!(numerical.code, Some(0), "{numerical:?}");
        assert!(!numerical.stdout.contains("domain"), "{numerical:?}");
    }
    let json = std::fs::read_to_string(dir.path().join("found/identify.json")).unwrap();
    assert!(json.contains("outside the training domain in 3 of 11 steps"), "{json}");
}
