//! Closed loops in configs: outputs, known signals, the final judgement.

use crate::common::{Outcome, outcome, pinc, repository};
use pinc_config::ModelKind;
use pinc_record::{ControlReader, ControlRow, Metrics, file};
use std::fmt::Write as _;
use std::fs;
use std::path::Path;

/// Two lags in a row, x1' = u - x1 and x2' = (x1 - x2)/2: at rest x1 = x2 = u.
const LAGS: &str = r#"
name = "lags"
preset = "ours"
seed = 1
[plant.expression]
states = ["x1", "x2"]
inputs = ["u"]
derivatives = { x1 = "u - x1", x2 = "0.5*(x1 - x2)" }
outputs = { y = { expression = "x1 + x2", unit = "m" } }
[model]
horizon_s = 0.5
hidden_layers = 2
neurons = 8
[domain]
state_low = [-2.0, -2.0]
state_high = [2.0, 2.0]
input_low = [-2.0]
input_high = [2.0]
[training]
target_one_step_rms = 1e-3
[validation]
duration_s = 2.0
[validation.domain]
state_low = [-1.0, -1.0]
state_high = [1.0, 1.0]
input_low = [-1.0]
input_high = [1.0]
[control]
duration_s = 20.0
initial_state = [0.0, 0.0]
controlled = ["y"]
q = [10.0]
r = [1.0]
input_low = [-2.0]
input_high = [2.0]
references = [{ start_s = 0.0, value = [1.0] }, { start_s = 10.0, value = [-0.5] }]
repetitions = 1
"#;

/// A ball under a magnet, unstable, exactly at rest under 13.14 V.
const MAGNET: &str = r#"
name = "magnet"
preset = "ours"
seed = 1
[plant.expression]
states = ["gap", "speed", "current"]
inputs = ["voltage"]
[plant.expression.derivatives]
gap = "speed"
speed = "9.81*(1 - (current/gap)^2)"
current = "(voltage - 13.14*current)/0.5"
[control]
models = ["rk4"]
step_s = 0.05
duration_s = 0.5
initial_state = [1.0, 0.0, 1.0]
controlled = ["gap"]
n2 = 10
nu = 10
q = [100.0]
r = [1.0]
input_low = [0.0]
input_high = [30.0]
references = [{ start_s = 0.0, value = [1.0] }]
repetitions = 1
"#;

/// Runs `pinc control` with this config in `dir`.
fn control(dir: &Path, config: &str, arguments: &[&str]) -> Outcome {
    fs::write(dir.join("experiment.toml"), config).unwrap();
    let mut command = pinc(&["control", "experiment.toml", "--out", "run"]);
    outcome(command.args(arguments).current_dir(dir))
}

#[track_caller]
fn fine(outcome: &Outcome) {
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
}

fn metrics(dir: &Path) -> Metrics {
    Metrics::read(&dir.join("run")).unwrap().unwrap()
}

fn trace(dir: &Path, model: ModelKind, models: usize, controlled: &[&str]) -> Vec<ControlRow> {
    let controlled: Vec<String> = controlled.iter().map(|&name| name.to_owned()).collect();
    let path = dir.join("run").join(file::control(model, models));
    let config = dir.join("run").join(file::CONFIG);
    let states = pinc_config::Experiment::load(&config, &[], &pinc_config::Plants::default());
    let states = states.unwrap().plant.variables().states.len();
    ControlReader::open(&path, [states, 1], &controlled)
        .unwrap()
        .unwrap()
        .collect::<Result<_, _>>()
        .unwrap()
}

/// With the equation and with a net the output reaches its references; files and report have it,
/// and the loop replayed by `pinc predict` behaves alike.
#[test]
fn an_output_is_controlled_with_the_equation_and_with_a_net() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    fine(&control(dir, LAGS, &[]));
    let metrics = metrics(dir);
    assert_eq!(metrics.variables["y"], "m");
    // A net that is 1e-3 of the domain off per step is some hundredths off at rest.
    for (model, near) in [(ModelKind::Pinc, 0.03), (ModelKind::RK4, 1e-3)] {
        let trace = trace(dir, model, 2, &["y"]);
        assert!(trace.iter().all(|row| row.output.len() == 1));
        for row in &trace {
            assert!((row.output[0] - row.state[0] - row.state[1]).abs() < 1e-12, "{row:?}");
        }
        for step in trace[..180].chunks(9).chain(trace[180..360].chunks(9)) {
            assert!(step.iter().all(|row| row.input == step[0].input), "{step:?}");
        }
        let of = metrics.loop_with(model).unwrap();
        let offsets = &of.references.offset["y"];
        assert_eq!(of.references.reference_start_s, [0.0, 10.0]);
        assert!(offsets.iter().all(|offset| offset.unwrap() < near), "{offsets:?}");
        // A hundredth of the largest error at a step mark; the second reference is from 10 s on.
        let reference = |t: f64| if t < 10.0 - 1e-9 { 1.0 } else { -0.5 };
        let errors = trace.iter().step_by(9).map(|row| (row.output[0] - reference(row.t)).abs());
        let (within, largest) = (of.references.settled_within["y"], errors.fold(0.0, f64::max));
        assert!((within - 0.01 * largest).abs() < 1e-9, "{within} of {largest}");
        // Rest is reached after the slow lag has settled, and well before the end.
        assert!(of.steps() == 40 && of.failed_steps() == 0, "{of:?}");
        let last = trace.last().unwrap();
        assert!((last.output[0] + 0.5).abs() < near, "{last:?}");
    }
    let report = fs::read_to_string(dir.join("run/report.html")).unwrap();
    assert!(report.contains("Outputs") && report.contains("y (m)"));

    let trace = trace(dir, ModelKind::Pinc, 2, &["y"]);
    let mut inputs = "scenario,t,u,x1,x2\n".to_owned();
    for row in &trace {
        writeln!(inputs, "a,{:?},{:?},{:?},{:?}", row.t, row.input[0], row.state[0], row.state[1])
            .unwrap();
    }
    fs::write(dir.join("in.csv"), inputs).unwrap();
    let arguments = [
        "predict",
        "--model",
        "run/model.safetensors",
        "--inputs",
        "in.csv",
        "--output",
        "out.csv",
    ];
    fine(&outcome(pinc(&arguments).current_dir(dir)));
    let predicted = fs::read_to_string(dir.join("out.csv")).unwrap();
    for (line, row) in predicted.lines().skip(1).zip(&trace) {
        let cells: Vec<f64> = line.split(',').skip(1).map(|cell| cell.parse().unwrap()).collect();
        for (found, expected) in cells[2..].iter().zip(&row.state) {
            assert!((found - expected).abs() < 0.02, "{line}: {row:?}");
        }
    }
}

#[test]
fn a_bound_of_an_output_holds_and_the_offset_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    let config = LAGS.replace("r = [1.0]", "r = [1.0]\noutput_high = [0.7]");
    let outcome = control(dir.path(), &config, &["--only", "rk4"]);
    fine(&outcome);
    let trace = trace(dir.path(), ModelKind::RK4, 1, &["y"]);
    let highest = trace.iter().map(|row| row.output[0]).fold(f64::MIN, f64::max);
    // Between the marks the output may pass its bound a little.
    assert!((0.69..0.71).contains(&highest), "{highest}");
    let metrics = metrics(dir.path());
    let offset = metrics.control[0].references.offset["y"][0].unwrap();
    assert!((offset - 0.3).abs() < 0.01, "{offset}");
    assert_eq!(metrics.control[0].references.settle_s[0], None);
    let said = "With RK4 y does not reach 1 of its 2 references: it ends 0.3";
    assert!(outcome.stdout.contains(said), "{outcome:?}");
    let report = fs::read_to_string(dir.path().join("run/report.html")).unwrap();
    assert!(report.contains(said));
}

#[test]
fn a_loop_at_rest_begins_with_the_input_that_was_applied() {
    let first_input = |config: &str| {
        let dir = tempfile::tempdir().unwrap();
        fine(&control(dir.path(), config, &[]));
        trace(dir.path(), ModelKind::RK4, 1, &["gap"])[0].input[0]
    };
    let told = MAGNET.replace("repetitions", "initial_input = [13.14]\nrepetitions");
    assert!((first_input(&told) - 13.14).abs() < 1e-6, "{}", first_input(&told));
    // Its change is counted from 0 otherwise.
    assert!(first_input(MAGNET) < 13.0, "{}", first_input(MAGNET));
}

/// Without preview nothing moves before the reference changes.
#[test]
fn references_are_known_in_advance_or_not() {
    let config = LAGS.replace("value = [1.0]", "value = [0.0]");
    let before = |sets: &[&str]| {
        let dir = tempfile::tempdir().unwrap();
        let arguments = [&["--only", "rk4"], sets].concat();
        fine(&control(dir.path(), &config, &arguments));
        let trace = trace(dir.path(), ModelKind::RK4, 1, &["y"]);
        // 20 steps of 9 rows: the one at 10 s has the first input that knows the new reference.
        let before = trace[..180].iter().map(|row| row.input[0].abs()).fold(0.0, f64::max);
        (before, trace[180].input[0].abs())
    };
    let (earlier, then) = before(&["--set", "control.preview=false"]);
    assert!(earlier < 1e-9 && then > 0.05, "{earlier} {then}");
    assert!(before(&[]).0 > 0.05);
}

#[test]
fn too_many_failed_steps_fail_the_run_and_keep_its_results() {
    let config = fs::read_to_string(repository("configs/smoke/rk4-only.toml")).unwrap();
    // From 5 cm no pump brings the level to 8 cm in a step.
    let config = format!("{config}state_low = [8.0]\n");
    let dir = tempfile::tempdir().unwrap();
    let failed = control(dir.path(), &config, &["--set", "control.max_failed_share=0.02"]);
    assert_eq!(failed.code, Some(1), "{failed:?}");
    assert!(failed.stderr.contains("control.max_failed_share = 0.02"), "{failed:?}");
    assert!(failed.stdout.contains("state_softness = \"exact\""), "{failed:?}");
    assert!(dir.path().join("run/report.html").exists());
    let failures = metrics(dir.path()).control[0].failed_steps();
    assert!((1..10).contains(&failures), "{failures}");
    let dir = tempfile::tempdir().unwrap();
    fine(&control(dir.path(), &config, &["--set", "control.max_failed_share=0.5"]));
}

#[test]
fn mistakes_in_these_keys_are_named() {
    let dir = tempfile::tempdir().unwrap();
    for (set, parts) in [
        (
            "control.initial_input=[1.0, 2.0]",
            ["`control.initial_input`", "2 values given, expected 1"],
        ),
        ("control.output_low=[1.0, 2.0]", ["`control.output_low`", "2 values given, expected 1"]),
        ("control.max_failed_share=2.0", ["`control.max_failed_share`", "a share from 0 to 1"]),
        ("control.settled_within=[0.0]", ["`control.settled_within[0]`", "a positive number"]),
        ("control.controlled=[\"z\"]", ["`control.controlled[0]`", "expected one of x1, x2, y"]),
        (
            "control.input_differences=[{ between = [0, 5], weight = [1.0] }]",
            ["`control.input_differences[0].between[1]`", "nu - 1 = 4"],
        ),
    ] {
        control(dir.path(), LAGS, &["--set", set]).assert_refused(&parts);
    }
    control(dir.path(), MAGNET, &["--set", "control.output_high=[1.0]"])
        .assert_refused(&["`control.output_high`", "the plant has no outputs that are not states"]);
}
