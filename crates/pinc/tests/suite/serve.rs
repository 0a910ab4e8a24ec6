//! `pinc serve`: the controller as a process.

use crate::closed::Closed;
use crate::common::{outcome, pinc, repository};
use crate::ways::Served;
use pinc_config::ModelKind;
use serde_json::{Value, json};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// Given the states of the loop that `pinc control` ran, it chooses the same inputs; with the
/// references on the lines and without.
#[test]
fn the_served_controller_is_that_of_the_loop() {
    let config = repository("configs/van-der-pol/control.toml");
    let short = ["--set", "control.duration_s=20.0"];
    let begun = ["--set", "control.initial_input=[-0.6]", "--set", "control.increment_high=[0.1]"];
    let begun = [&short[..], &begun, &["--set", "control.max_failed_share=1.0"]].concat();
    for (with_reference, sets) in [(false, &short[..]), (true, &short), (true, &begun)] {
        let dir = tempfile::tempdir().unwrap();
        let closed = Closed::run(dir.path(), &config, ModelKind::RK4, sets);
        let mut served = Served::new(&config, sets);
        for (k, x) in closed.states.iter().enumerate() {
            let mut request = json!({ "y": x });
            if with_reference {
                request["reference"] = json!(closed.reference(k));
            }
            let answer = served.ask(&request);
            assert_eq!(answer["status"], closed.steps[k].status.as_str(), "{answer}");
            assert_eq!(answer["x"], json!(x));
            assert!(answer["step_us"].as_f64().is_some(), "{answer}");
            let u = answer["u"][0].as_f64().unwrap();
            assert!((u - closed.inputs[k][0]).abs() < 1e-12, "step {k}: {u}");
        }
        served.end();
    }
}

/// References that begin after `duration_s` are the controller's all the same: its last steps look
/// ahead to them, and a served or exported one goes on to them.
#[test]
fn references_after_the_end_of_the_loop_are_followed() {
    let config = repository("configs/van-der-pol/control.toml");
    let later = "control.references=[{ start_s = 0.0, value = [0.0, 0.0] }, \
                 { start_s = 12.0, value = [0.5, 0.0] }]";
    let short = ["--set", later, "--set", "control.duration_s=10.0"];
    let long = ["--set", later, "--set", "control.duration_s=20.0"];
    let dir = tempfile::tempdir().unwrap();
    let whole = Closed::run(&dir.path().join("long"), &config, ModelKind::RK4, &long);
    let begin = Closed::run(&dir.path().join("short"), &config, ModelKind::RK4, &short);
    assert_eq!(begin.inputs[..], whole.inputs[..begin.inputs.len()]);
    let mut served = Served::new(&config, &short);
    for (k, x) in whole.states.iter().enumerate() {
        let answer = served.ask(&json!({ "y": x }));
        assert_eq!(answer["u"], json!(whole.inputs[k]), "{k}");
    }
    served.end();
    let mut export = pinc(&["export", "--to", "c", "--name", "vdp", "--only", "rk4", "--out", "c"]);
    let exported = outcome(export.arg(&config).args(short).current_dir(dir.path()));
    assert_eq!(exported.code, Some(0), "{exported:?}");
    let source = std::fs::read_to_string(dir.path().join("c/vdp_mpc.c")).unwrap();
    assert!(source.contains("#define VDP_SEGMENTS 2\n"));
}

/// Given what the estimator of the loop was told, the served one estimates the same, and the
/// controller chooses the same inputs.
#[test]
fn the_served_estimator_is_that_of_the_loop() {
    let config = repository("configs/estimation/tanks.toml");
    let estimator = |kind: &'static str| format!("control.estimator.kind={kind}");
    let (ekf, ukf, mhe) = (estimator("ekf"), estimator("ukf"), estimator("mhe"));
    let output = "control.estimator.disturbance=output";
    let held = "control.initial_input=[1.6, 4.0]";
    for more in [
        &[&ekf[..]][..],
        &[&ukf, output],
        &[&mhe, "control.estimator.window=5", "control.delay_steps=2", held],
    ] {
        let mut sets = vec!["--set", "control.duration_s=700.0"];
        more.iter().for_each(|set| sets.extend(["--set", *set]));
        let dir = tempfile::tempdir().unwrap();
        let closed = Closed::run(dir.path(), &config, ModelKind::RK4, &sets);
        let estimates = closed.estimates.as_ref().unwrap();
        let mut served = Served::new(&config, &sets);
        for (k, row) in estimates.rows.iter().enumerate() {
            let answer = served.ask(&json!({ "y": row.measured }));
            assert_eq!(answer["status"], closed.steps[k].status.as_str(), "{more:?} {k}: {answer}");
            assert_eq!(answer["estimator"], "updated", "{answer}");
            let found = |key: &str, i: usize| answer[key][i].as_f64().unwrap();
            for (i, expected) in row.estimate[4..].iter().enumerate() {
                let off = found("unknowns", i) - expected;
                assert!(off.abs() < 1e-9, "{more:?} {k}: {off:e}");
            }
            for (i, expected) in row.estimate[..4].iter().enumerate() {
                // The controller sees a measured state with its disturbance.
                let own = if more.contains(&output) && i < 2 { found("unknowns", i) } else { 0.0 };
                let off = found("x", i) - own - expected;
                assert!(off.abs() < 1e-9, "{more:?} {k}: {off:e}");
            }
            let Some(inputs) = closed.inputs.get(k + closed.spec.delay_steps) else { continue };
            for (i, expected) in inputs.iter().enumerate() {
                let off = found("u", i) - expected;
                assert!(off.abs() < 1e-8, "{more:?} {k}: {off:e}");
            }
        }
        served.end();
    }
}

#[test]
fn what_cannot_be_served_is_refused() {
    let config = repository("configs/van-der-pol/control.toml");
    let refused = |arguments: &[&str], part: &str| {
        let mut command = pinc(&["serve"]);
        outcome(command.arg(&config).args(arguments)).assert_refused(&[part]);
    };
    refused(&[], "--model FILE");
    refused(&["--only", "rosenbrock"], "control.models");
    refused(&["--model", "none.safetensors"], "none.safetensors");
    refused(&["--model", "none.safetensors", "--only", "rk4"], "no model is a net: \"rk4\"");
}

/// The example client closes the loop with its own simulator, where there is a Python to run it.
#[test]
fn the_example_client_closes_the_loop() {
    let python = Command::new("python3").arg("--version").output();
    if !python.is_ok_and(|version| version.status.success()) {
        return;
    }
    let client = repository("examples/serve-client/client.py");
    let mut command = Command::new("python3");
    command.arg(client).arg(env!("CARGO_BIN_EXE_pinc")).current_dir(repository("."));
    let ended = outcome(&mut command);
    assert_eq!(ended.code, Some(0), "{ended:?}");
    assert!(ended.stdout.contains("40 steps, 40 converged"), "{ended:?}");
}

/// The controller of a config at a port.
struct AtPort {
    child: Child,
    address: String,
}

impl AtPort {
    fn new(config: &Path) -> Self {
        let mut command = pinc(&["serve", "--only", "rk4", "--listen", "127.0.0.1:0"]);
        let mut child = command.arg(config).stdout(Stdio::piped()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let said: Value = serde_json::from_str(&line).unwrap();
        Self { child, address: said["listening"].as_str().unwrap().to_owned() }
    }
}

impl Drop for AtPort {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// The clients of `examples/` close a loop with the controller at a port.
#[test]
fn the_clients_of_the_examples_reach_the_reference() {
    let process = AtPort::new(&repository("configs/van-der-pol/control.toml"));
    let port = process.address.rsplit(':').next().unwrap();
    let here = tempfile::tempdir().unwrap();
    let program = here.path().join("client");
    let source = repository("examples/serve-client/tcp_client.c");
    let mut compiler = Command::new("cc");
    let compiled = compiler.args(["-std=c99", "-Wall", "-Wextra", "-Werror", "-o"]);
    assert!(compiled.arg(&program).arg(source).status().unwrap().success());
    let mut python = Command::new("python3");
    python.arg(repository("examples/serve-client/tcp_client.py"));
    for mut client in [python, Command::new(program)] {
        let ended = outcome(client.arg(port));
        assert_eq!(ended.code, Some(0), "{}{}", ended.stdout, ended.stderr);
        let last = ended.stdout.lines().last().unwrap();
        let reached: f64 = last.rsplit(' ').next().unwrap().parse().unwrap();
        assert!((reached + 0.5).abs() < 1e-2, "{last}");
    }
}

#[test]
fn only_addresses_of_this_machine_are_listened_at() {
    let config = repository("configs/van-der-pol/control.toml");
    for address in ["0.0.0.0:5025", "192.168.1.5:5025", "localhost", "5025"] {
        let mut command = pinc(&["serve", "--only", "rk4", "--listen", address]);
        let ended = outcome(command.arg(&config).stdin(Stdio::null()));
        assert_eq!(ended.code, Some(2), "{address}");
        assert!(ended.stderr.contains("127.0.0.1:5025"), "{}", ended.stderr);
    }
}

/// With a tube an answer says whether its plan keeps the tightened bounds, and the report of a loop how
/// many did.
#[test]
fn an_answer_says_whether_its_plan_is_in_the_tube() {
    let config = repository("configs/smoke/van-der-pol.toml");
    for (sd, fits) in [("[0.001, 0.001]", true), ("[10.0, 10.0]", false)] {
        let tube = format!("control.uncertainty={{ probability = 0.9, process_sd = {sd} }}");
        let sets = [
            "--set",
            "control.state_low=[-3.0, -3.0]",
            "--set",
            "control.state_high=[3.0, 3.0]",
            "--set",
            "control.state_softness.penalty=[10.0, 10.0]",
            "--set",
            "control.uncertainty.probability=0.9",
            "--set",
            &tube,
        ];
        let mut served = Served::of(&config, ModelKind::RK4, &sets);
        let answer = served.ask(&serde_json::json!({ "y": [0.5, 0.1] }));
        assert_eq!(answer["in_tube"], fits, "{answer}");
        served.end();
        let dir = tempfile::tempdir().unwrap();
        let mut command = pinc(&["control", "--quiet", "--only", "rk4", "--out"]);
        let sets = [&sets[..], &["--set", "control.max_failed_share=1.0"]].concat();
        let ended = outcome(command.arg(dir.path().join("run")).arg(&config).args(sets));
        assert_eq!(ended.code, Some(0), "{ended:?}");
        let html = std::fs::read_to_string(dir.path().join("run/report.html")).unwrap();
        let said =
            if fits { "plans keep the bounds of the tube" } else { "do not keep the bounds" };
        assert!(html.contains(&format!("With RK4 {}", if fits { "all " } else { "" })), "{said}");
        assert!(html.contains(said), "{said}");
    }
    let mut served = Served::of(&config, ModelKind::RK4, &[]);
    let answer = served.ask(&serde_json::json!({ "y": [0.5, 0.1] }));
    assert!(answer["in_tube"].is_null(), "{answer}");
    served.end();
}

/// x' = x^2 + 2 + u is at rest nowhere with u of -1 at least.
const WITHOUT_REST: &str = r#"
name = "without-rest"
preset = "ours"
seed = 1
[plant.expression]
states = ["x"]
inputs = ["u"]
derivatives = { x = "x^2 + 2 + u" }
[control]
models = ["rk4"]
step_s = 0.05
duration_s = 0.5
initial_state = [-1.0]
controlled = ["x"]
target = true
q = [1.0]
r = [0.1]
n2 = 4
nu = 4
input_low = [-1.0]
input_high = [1.0]
references = [{ start_s = 0.0, value = [-0.5] }]
[control.measurement]
measured = ["x"]
[control.estimator]
kind = "ekf"
process_sd = [0.01]
measurement_sd = [0.01]
initial_estimate = [-1.0]
initial_sd = [0.1]
disturbance = "input"
disturbance_sd = [0.01]
disturbance_initial_sd = [0.1]
"#;

/// The search for the target goes on where it was.
#[test]
fn a_restored_controller_with_a_target_goes_on_to_the_same_bits() {
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("experiment.toml");
    std::fs::write(&config, WITHOUT_REST).unwrap();
    let sets = ["--set", "control.input_low=[-3.0]"];
    let mut whole = Served::of(&config, ModelKind::RK4, &sets);
    for k in 0..6 {
        let mut restored = Served::of(&config, ModelKind::RK4, &sets);
        let state = whole.ask(&json!({ "command": "save" }))["state"].clone();
        restored.ask(&json!({ "command": "restore", "state": state }));
        let measured = json!({ "y": [-1.0 + 0.07 * f64::from(k)] });
        let expected = whole.ask(&measured)["u"].clone();
        assert_eq!(restored.ask(&measured)["u"], expected, "{k}");
        restored.end();
    }
    whole.end();
}

/// A loop counts the steps in which an answer says so.
#[test]
fn an_answer_says_whether_a_target_was_found() {
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("experiment.toml");
    std::fs::write(&config, WITHOUT_REST).unwrap();
    for (low, found) in [("-1.0", false), ("-3.0", true)] {
        let sets = ["--set", &format!("control.input_low=[{low}]")];
        let mut served = Served::of(&config, ModelKind::RK4, &sets);
        assert_eq!(served.ask(&json!({ "y": [-1.0] }))["target_found"], found);
        served.end();
        let run = dir.path().join(low);
        let mut command = pinc(&["control", "--quiet", "--out"]);
        let ended = outcome(command.arg(&run).arg(&config).args(sets));
        assert_eq!(ended.code, Some(0), "{ended:?}");
        let metrics = std::fs::read_to_string(run.join("metrics.json")).unwrap();
        let metrics: Value = serde_json::from_str(&metrics).unwrap();
        let counted = &metrics["control"][0]["targets_not_found"];
        assert_eq!(*counted, if found { Value::Null } else { json!(10) }, "{metrics}");
    }
}
