//! Runs in directories that already hold something.

use crate::common::{Outcome, outcome, pinc, repository};
use std::fs;
use std::path::Path;

/// The program on the smallest config.
fn control(dir: &Path, more: &[&str]) -> Outcome {
    let config = repository("configs/smoke/rk4-only.toml");
    let mut command = pinc(&["control".as_ref(), config.as_os_str(), "--out".as_ref()]);
    outcome(command.arg(dir).args(more))
}

/// The program on a config with a net.
fn with_net(command: &str, dir: &Path, more: &[&str]) -> Outcome {
    let config = repository("configs/smoke/one-tank.toml");
    let mut command = pinc(&[command.as_ref(), config.as_os_str(), "--out".as_ref()]);
    outcome(command.arg(dir).args(more))
}

/// Files that cannot be used are named, and no directory is made.
#[test]
fn refused_input_leaves_no_directory() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("run");
    let (bad, absent) = (dir.path().join("bad.json"), dir.path().join("absent"));
    fs::write(&bad, "{}").unwrap();
    let [bad, absent] = [&bad, &absent].map(|path| path.to_str().unwrap());
    let policy = format!("control.policy={bad:?}");
    let with_policy = ["--set", "control.models=[\"policy\", \"rk4\"]", "--set", &policy];
    let estimator = "control.estimator={ kind = \"ekf\", process_sd = [0.1], measurement_sd = [0.1], \
                     initial_estimate = [5.0], initial_sd = [0.1], disturbance = \"none\" }";
    let estimated = ["--set", "control.measurement={ measured = [\"h\"] }", "--set", estimator];
    let plan = format!("control.first_plan={{ file = {absent:?} }}");
    let tuned = [
        "--set",
        "tune.ranges=[{ key = \"control.r.0\", low = 0.1, high = 10.0 }]",
        "--set",
        "tune.cost={ iae_dense_sum = 1.0 }",
    ];
    let boxed = [
        "--set",
        "domain={ state_low = [2.0], state_high = [8.0], input_low = [1.0], input_high = [2.0] }",
    ];
    for (command, more, said) in [
        ("control", [&with_policy[..], &[]].concat(), [bad, "expected `policy.json`"]),
        ("control", [&with_policy[..], &estimated].concat(), ["policy", "control.estimator"]),
        ("tune", [&with_policy[..], &tuned].concat(), ["\"policy\"", "--only"]),
        ("control", vec!["--set", &plan], [absent, "cannot be read"]),
        ("certify", [&["--only", "rk4", "--data", absent][..], &boxed].concat(), [absent, "read"]),
    ] {
        let config = repository("configs/smoke/rk4-only.toml");
        let mut refused = pinc(&[command.as_ref(), config.as_os_str(), "--out".as_ref()]);
        outcome(refused.arg(&out).args(more)).assert_refused(&said);
        assert!(!out.exists(), "{command} {said:?}");
    }
    let data = format!("data={{ files = [{absent:?}], weight = 1.0 }}");
    with_net("train", &out, &["--set", &data]).assert_refused(&[absent, "cannot be read"]);
    assert!(!out.exists());
}

#[test]
fn a_second_run_of_the_same_config_replaces_the_first() {
    let dir = tempfile::tempdir().unwrap();
    assert_eq!(control(dir.path(), &[]).code, Some(0));
    fs::write(dir.path().join("notes.txt"), "mine").unwrap();
    fs::write(dir.path().join("control.csv"), "old").unwrap();
    let outcome = control(dir.path(), &[]);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    assert!(
        fs::read_to_string(dir.path().join("control.csv")).unwrap().starts_with("t,h,u,h_ref\n")
    );
    assert_eq!(fs::read_to_string(dir.path().join("notes.txt")).unwrap(), "mine");
}

#[test]
fn other_runs_and_other_files_are_left_alone() {
    let dir = tempfile::tempdir().unwrap();
    assert_eq!(control(dir.path(), &[]).code, Some(0));
    let config = fs::read(dir.path().join("config.toml")).unwrap();
    for more in [&["--set", "seed=8"][..], &["--set", "seed=8", "--resume"]] {
        control(dir.path(), more).assert_refused(&["belongs to a run of another config", "--out"]);
    }
    assert_eq!(fs::read(dir.path().join("config.toml")).unwrap(), config);

    let home = tempfile::tempdir().unwrap();
    fs::write(home.path().join("thesis.tex"), "mine").unwrap();
    control(home.path(), &[]).assert_refused(&["holds files, but no config.toml of a run"]);
    assert_eq!(fs::read_dir(home.path()).unwrap().count(), 1);
}

#[test]
fn unfinished_files_of_a_killed_run_are_removed() {
    let dir = tempfile::tempdir().unwrap();
    let left = dir.path().join(".pinc-unfinished-abc");
    fs::write(&left, "half").unwrap();
    assert_eq!(control(dir.path(), &[]).code, Some(0));
    assert!(!left.exists());
}

#[test]
fn folders_that_cannot_be_written() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("file");
    fs::write(&file, "").unwrap();
    control(&file, &[]).assert_refused(&["cannot be written"]);
    control(&file.join("below"), &[]).assert_refused(&["cannot be written"]);
}

#[test]
fn one_model_or_both() {
    let dir = tempfile::tempdir().unwrap();
    let exists = |file: &str| dir.path().join(file).exists();
    let outcome = with_net("control", dir.path(), &["--only", "rk4"]);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    assert!(exists("control.csv") && !exists("control-rk4.csv") && !exists("model.safetensors"));

    let outcome = with_net("control", dir.path(), &[]);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    assert!(!exists("control.csv") && exists("control-pinc.csv") && exists("control-rk4.csv"));
    assert!(exists("model.safetensors") && exists("steps-pinc.csv"));
    for model in ["pinc", "rk4"] {
        assert!(outcome.stdout.lines().any(|l| l.trim_start().starts_with(model)), "{outcome:?}");
    }

    control(dir.path(), &["--only", "pinc"]).assert_refused(&[
        "--only",
        "control.models",
        "`pinc`",
    ]);
    let config = repository("configs/smoke/rk4-only.toml");
    let mut command = pinc(&["run".as_ref(), config.as_os_str(), "--fresh".as_ref()]);
    crate::common::outcome(command.arg("--out").arg(dir.path()))
        .assert_refused(&["--fresh", "[sweep]"]);
}

#[test]
fn a_given_model_is_used_and_kept_beside_its_results() {
    let dir = tempfile::tempdir().unwrap();
    let (trained, controlled) = (dir.path().join("trained"), dir.path().join("controlled"));
    assert_eq!(with_net("train", &trained, &[]).code, Some(0));
    let model = trained.join("model.safetensors");
    let outcome = with_net("control", &controlled, &["--model", model.to_str().unwrap()]);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    let read = |path: &Path| fs::read(path).unwrap();
    assert!(read(&model) == read(&controlled.join("model.safetensors")));
    assert!(!controlled.join("training.csv").exists());

    // In the directory that it was trained in, what is known of it stays.
    let outcome = with_net("control", &trained, &["--model", model.to_str().unwrap()]);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    let metrics: serde_json::Value =
        serde_json::from_slice(&read(&trained.join("metrics.json"))).unwrap();
    assert!(metrics["training"]["iterations"].is_u64(), "{metrics}");
    assert_eq!(metrics["control"].as_array().unwrap().len(), 2);
}

#[test]
fn models_of_another_plant_or_step_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let model = repository("crates/pinc/tests/data/model.safetensors");
    let model = model.to_str().unwrap();
    with_net("control", dir.path(), &["--model", model])
        .assert_refused(&["model.safetensors: states of the model: x1, x2; of the config: h"]);

    let config = repository("configs/smoke/van-der-pol.toml");
    let mut command = pinc(&["control".as_ref(), config.as_os_str(), "--model".as_ref()]);
    let set = "model.horizon_s=0.25";
    outcome(command.arg(model).args(["--set", set, "--out"]).arg(dir.path()))
        .assert_refused(&["step length T of the model: 0.5 s; of the config: 0.25 s"]);
    let mut command = pinc(&["control".as_ref(), config.as_os_str(), "--model".as_ref()]);
    outcome(command.arg(model).args(["--only", "rk4", "--out"]).arg(dir.path()))
        .assert_refused(&["`pinc control`", "no model is a net: \"rk4\""]);
}

#[test]
fn several_configs_have_a_directory_each() {
    let dir = tempfile::tempdir().unwrap();
    let configs = ["rk4-only", "one-tank"].map(|n| repository(&format!("configs/smoke/{n}.toml")));
    let mut command = pinc(&["run".as_ref(), configs[0].as_os_str(), configs[1].as_os_str()]);
    let outcome = outcome(command.arg("--out").arg(dir.path()));
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    for name in ["smoke-rk4-only", "smoke-one-tank"] {
        assert!(dir.path().join(name).join("report.html").exists());
    }
}

#[test]
fn the_report_is_rebuilt_from_the_directory() {
    let dir = tempfile::tempdir().unwrap();
    assert_eq!(control(dir.path(), &[]).code, Some(0));
    let report = dir.path().join("report.html");
    let before = fs::read(&report).unwrap();
    fs::remove_file(&report).unwrap();
    let outcome = outcome(&mut pinc(&["report".as_ref(), dir.path().as_os_str()]));
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    assert!(fs::read(&report).unwrap() == before);

    let empty = tempfile::tempdir().unwrap();
    crate::common::outcome(&mut pinc(&["report".as_ref(), empty.path().as_os_str()]))
        .assert_refused(&["no config.toml of a run"]);
}

#[test]
fn provenance_says_how_and_with_what_but_not_where() {
    let dir = tempfile::tempdir().unwrap();
    assert_eq!(control(dir.path(), &[]).code, Some(0));
    let text = fs::read_to_string(dir.path().join("provenance.json")).unwrap();
    let provenance: serde_json::Value = serde_json::from_str(&text).unwrap();
    let command = provenance["command"].as_array().unwrap();
    assert_eq!(command[..3], ["pinc", "control", ".../rk4-only.toml"]);
    assert_eq!(provenance["seed"], 7);
    assert_eq!(provenance["config_sha256"].as_str().unwrap().len(), 64);
    for key in ["version", "rustc", "target", "cpu", "os", "started"] {
        assert!(!provenance[key].as_str().unwrap().is_empty(), "{key}");
    }
    assert!(!text.contains(dir.path().parent().unwrap().to_str().unwrap()), "{text}");
}

#[test]
fn a_loss_that_is_no_longer_finite_ends_the_training_with_the_last_good_net() {
    let dir = tempfile::tempdir().unwrap();
    // Steps of 1e200 take the weights, and soon the loss, beyond the largest number.
    let phases =
        "training.phases=[{ optimizer = { adam = { learning_rate = 1e200 } }, iterations = 50 }]";
    let outcome = with_net("train", dir.path(), &["--set", phases]);
    assert_eq!(outcome.code, Some(1), "{outcome:?}");
    for part in ["became NaN or infinite at iteration", "the last good net is kept"] {
        assert!(outcome.stderr.contains(part), "{outcome:?}");
    }
    let model = fs::read(dir.path().join("model.safetensors")).unwrap();
    assert!(pinc_net::PincNet::from_bytes(&model).is_ok());
    assert!(dir.path().join("training.csv").exists());
}
