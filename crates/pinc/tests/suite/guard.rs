//! A closed loop that uses its net outside the training domain: reported, or ended.

use crate::common::{Outcome, outcome, pinc, smoke};
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
