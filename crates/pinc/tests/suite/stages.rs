//! Horizons of stages that differ in length.

use crate::common::{outcome, pinc, repository};
use pinc_record::{ControlMetrics, Metrics};
use std::fs;
use std::path::{Path, PathBuf};

/// The loop of the tanks of nonminimum phase for 1200 s, in `dir`, with the `stages`.
fn config(dir: &Path, stages: &str) -> PathBuf {
    let path = dir.join("tanks.toml");
    let text = format!(
        r#"
name = "tanks"
preset = "ours"
seed = 1
[plant]
four-tanks = {{ parameters = "johansson-nonminimum" }}
[control]
models = ["rk4"]
step_s = 10.0
duration_s = 1200.0
initial_state = [12.6, 13.0, 4.8, 4.9]
initial_input = [3.15, 3.15]
controlled = ["h1", "h2"]
q = [10.0, 10.0]
r = [1.0, 1.0]
input_low = [1.0, 1.0]
input_high = [5.0, 5.0]
rk4_substeps = 1
repetitions = 1
references = [{{ start_s = 0.0, value = [12.6, 13.0] }}, {{ start_s = 600.0, value = [13.6, 13.5] }}]
{stages}
"#
    );
    fs::write(&path, text).unwrap();
    path
}

fn run(stages: &str) -> ControlMetrics {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("run");
    let config = config(dir.path(), stages);
    let ended = outcome(pinc(&["control", "--quiet", "--out"]).arg(&out).arg(&config));
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let metrics: Metrics =
        serde_json::from_slice(&fs::read(out.join("metrics.json")).unwrap()).unwrap();
    metrics.control.into_iter().next().unwrap()
}

const SIX: &str = "n2 = 6\nnu = 6\nstages_s = [10, 10, 20, 40, 80, 140]";

/// What five stages cannot do at all, and thirty do, six long ones do with less work: the plant
/// first moves the wrong way.
#[test]
fn few_long_stages_control_a_response_that_first_goes_the_wrong_way() {
    let short = run("n2 = 5\nnu = 5");
    let equal = run("n2 = 30\nnu = 30");
    let few = run(SIX);
    assert!(short.iae_dense_sum > 10.0 * equal.iae_dense_sum, "{}", short.iae_dense_sum);
    let (found, limit) = (few.iae_dense_sum, 1.03 * equal.iae_dense_sum);
    assert!(found < limit, "{found} {limit}");
    // Each program has a fifth of the unknowns, and there are fewer programs.
    let (found, limit) = (few.sqp_iterations_mean, equal.sqp_iterations_mean);
    assert!(found < limit, "{found} {limit}");
    assert_eq!(few.status.get("converged"), Some(&120));
}

#[test]
fn stages_of_one_length_change_nothing() {
    let plain = run("n2 = 3\nnu = 2");
    let listed = run("n2 = 3\nnu = 2\nstages_s = [10.0, 10.0, 10.0]");
    assert_eq!(listed.iae_dense_sum.to_bits(), plain.iae_dense_sum.to_bits());
    assert_eq!(listed.status, plain.status);
}

#[test]
fn an_export_refuses_stages_and_the_server_previews_at_their_ends() {
    let dir = tempfile::tempdir().unwrap();
    let path = config(dir.path(), SIX);
    let out = dir.path().join("c");
    outcome(pinc(&["export", "--to", "c", "--out"]).arg(&out).arg(&path))
        .assert_refused(&["stages of one length", "pinc serve"]);
    let mut command = pinc(&["serve"]);
    let request = dir.path().join("request");
    // The second reference, from 600 s on, is seen by the stages that end then.
    let state = "[12.6, 13.0, 4.99, 4.72]";
    let now = format!("{{\"y\": {state}}}\n");
    let rows = ["[12.6, 13.0]"; 6].join(", ");
    let listed = format!("{{\"y\": {state}, \"reference\": [{rows}]}}\n");
    fs::write(&request, [now, listed].concat()).unwrap();
    let ended = outcome(command.arg(&path).stdin(fs::File::open(&request).unwrap()));
    let answers: Vec<serde_json::Value> =
        ended.stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(answers.len(), 2, "{ended:?}");
    assert!(answers.iter().all(|answer| answer["status"] == "converged"), "{answers:?}");
}

/// A net of which [model] says nothing has to cover the longest stage.
#[test]
fn a_net_that_is_too_short_for_the_stages_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = config(dir.path(), SIX);
    let out = dir.path().join("net");
    let smoke = repository("configs/smoke/four-tanks.toml");
    let trained = outcome(
        pinc(&["train", "--quiet", "--set", "plant.four-tanks.parameters=johansson-nonminimum"])
            .args(["--set", "training.phases.0.iterations=5", "--out"])
            .arg(&out)
            .arg(smoke),
    );
    assert_eq!(trained.code, Some(0), "{trained:?}");
    let model = out.join("model.safetensors");
    let mut command = pinc(&["control", "--only", "pinc", "--set", "control.models=[\"pinc\"]"]);
    let refused = outcome(command.arg("--model").arg(model).arg(&path));
    refused.assert_refused(&["140 s at least", "10 s"]);
}
