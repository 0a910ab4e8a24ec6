//! Known signals beside an estimator: measured or scheduled parameters of the model.

use crate::closed::Closed;
use crate::common::{outcome, pinc};
use crate::ways::{Served, assert_same};
use pinc_config::ModelKind;
use serde_json::json;
use std::fs;
use std::path::{Path, PathBuf};

/// A room that loses heat to the air outside, whose temperature is known, through a wall that no
/// sensor sees. The thermometer near the window shows some of the cold.
const ROOM: &str = r#"
name = "room"
preset = "ours"
seed = 1

[plant.expression]
states = [{ name = "room", unit = "degC" }, { name = "wall", unit = "degC" }]
inputs = [{ name = "heat", unit = "kW" }]
time_unit = "h"

[plant.expression.parameters]
outside = 5.0
capacity = 2.0

[plant.expression.derivatives]
room = "(outside - room)/3 + heat/capacity + 0.1*(wall - room)"
wall = "0.05*(room - wall) + 0.02*(outside - wall)"

[plant.expression.outputs]
window = { expression = "0.9*room + 0.1*outside + 0.01*heat", unit = "degC" }

[domain]
state_low = [0.0, 0.0]
state_high = [40.0, 40.0]
input_low = [0.0]
input_high = [40.0]
parameters = { outside = [-10.0, 20.0] }

[control]
models = ["rk4"]
step_s = 1800.0
duration_s = 36000.0
n2 = 10
initial_state = [18.0, 16.0]
initial_input = [5.0]
controlled = ["room"]
q = [1.0]
r = [0.01]
input_low = [0.0]
input_high = [40.0]
references = [{ start_s = 0.0, value = [20.0] }]
plant_schedule = [
    { start_s = 9000.0, values = { outside = -5.0 } },
    { start_s = 18000.0, values = { outside = 12.0 } },
]
repetitions = 1
"#;

const ESTIMATOR: &str = r#"
[control.measurement]
measured = ["window"]

[control.estimator]
kind = "ekf"
initial_estimate = [18.0, 16.0]
initial_sd = [1.0, 1.0]
process_sd = [0.01, 0.01]
measurement_sd = [0.05]
disturbance = "none"
"#;

const MEASURED: [&str; 2] = ["--set", "control.measured_parameters=[\"outside\"]"];

const SCHEDULED: [&str; 2] = [
    "--set",
    "control.parameter_schedule=[{ start_s = 9000.0, values = { outside = -5.0 } }, \
     { start_s = 18000.0, values = { outside = 12.0 } }]",
];

const KINDS: [&[&str]; 3] = [
    &["--set", "control.estimator.kind=ekf"],
    &["--set", "control.estimator.kind=ukf"],
    &["--set", "control.estimator.kind=mhe", "--set", "control.estimator.window=4"],
];

fn written(dir: &Path, text: &str) -> PathBuf {
    let path = dir.join("room.toml");
    fs::write(&path, text).unwrap();
    path
}

fn run(text: &str, more: &[&[&str]]) -> Closed {
    let dir = tempfile::tempdir().unwrap();
    let config = written(dir.path(), text);
    Closed::run(dir.path(), &config, ModelKind::RK4, &more.concat())
}

/// The temperature outside in step `k`.
fn outside(k: usize) -> f64 {
    [5.0, -5.0, 12.0][usize::from(k >= 5) + usize::from(k >= 10)]
}

/// The largest innovation of an estimator.
fn innovation(closed: &Closed) -> f64 {
    let rows = &closed.estimates.as_ref().unwrap().rows;
    rows.iter().flat_map(|row| &row.innovation).fold(0.0, |most, v| v.abs().max(most))
}

fn largest_difference(one: &Closed, other: &Closed) -> f64 {
    assert_eq!(one.inputs.len(), other.inputs.len());
    let pairs = one.inputs.iter().flatten().zip(other.inputs.iter().flatten());
    pairs.fold(0.0, |most, (a, b)| (a - b).abs().max(most))
}

/// Sensors without noise and a model that is right: where it is told the signal, nothing surprises
/// the estimator, and the loop is the one whose states are measured. Otherwise it is surprised by
/// degrees.
#[test]
fn an_estimator_that_is_told_a_signal_expects_what_is_measured() {
    let estimated = format!("{ROOM}{ESTIMATOR}");
    let preview: &[&str] = &["--set", "control.parameter_preview=true"];
    for ahead in [&[], preview] {
        let seen = run(ROOM, &[&SCHEDULED, ahead]);
        for kind in KINDS {
            for told in [MEASURED, SCHEDULED] {
                let found = run(&estimated, &[kind, &told, ahead]);
                assert!(innovation(&found) < 1e-3, "{kind:?}: {}", innovation(&found));
                let off = largest_difference(&found, &seen);
                assert!(off < 1e-3, "{kind:?} {told:?} {ahead:?}: {off}");
            }
        }
    }
    let unaware = run(&estimated, &[]);
    assert!(innovation(&unaware) > 1.0, "{}", innovation(&unaware));
}

/// Served step by step, a controller chooses the inputs of its loop: with noise, delay, and disturbances
/// and parameters to be estimated. Its state is handed on to another process in between, with the
/// parameters that it was told last.
#[test]
fn a_served_estimator_is_told_what_that_of_a_loop_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let config = written(dir.path(), &format!("{ROOM}{ESTIMATOR}"));
    let disturbed: &[&str] = &[
        "--set",
        "control.estimator.disturbance=input",
        "--set",
        "control.estimator.disturbance_sd=[0.1]",
        "--set",
        "control.estimator.disturbance_initial_sd=[0.3]",
    ];
    let fitted: &[&str] = &[
        "--set",
        "control.estimator.parameters=[{ name = \"capacity\", initial = 2.5, initial_sd = 0.5, \
         drift_sd = 0.0, low = 1.0, high = 4.0 }]",
    ];
    let common: &[&str] =
        &["--set", "control.delay_steps=1", "--set", "control.measurement.noise_sd=[0.1]"];
    for (i, kind) in KINDS.into_iter().enumerate() {
        let unknown = [disturbed, fitted, disturbed][i];
        let sets = [common, kind, unknown, &MEASURED].concat();
        let run = tempfile::tempdir().unwrap();
        let closed = Closed::run(run.path(), &config, ModelKind::RK4, &sets);
        let told: Vec<Vec<f64>> = (0..closed.steps.len()).map(|k| vec![outside(k)]).collect();
        let (measured, [moved, told_again]) = (closed.told(), [7, 9]);
        let mut served = Served::of(&config, ModelKind::RK4, &sets);
        let mut answers = served.answers(&measured[..moved], &told[..moved]);
        let saved = served.ask(&json!({ "command": "save" }));
        served.end();
        let mut other = Served::of(&config, ModelKind::RK4, &sets);
        other.ask(&json!({ "command": "restore", "state": saved["state"] }));
        answers.extend(other.answers(&measured[moved..told_again], &[]));
        answers.extend(other.answers(&measured[told_again..], &told[told_again..]));
        assert_same("served", &closed, &answers, 1e-9);
        other.end();
        // Told a step late, it chooses others.
        let mut late = Served::of(&config, ModelKind::RK4, &sets);
        let told: Vec<Vec<f64>> = (0..told.len()).map(|k| told[k.max(1) - 1].clone()).collect();
        let answers = late.answers(&closed.told(), &told);
        let off = |k: usize| (answers[k].u[0] - closed.inputs[k + 1][0]).abs();
        assert!((0..answers.len() - 1).any(|k| off(k) > 1e-3), "{kind:?}");
        late.end();
    }
}

/// `pinc estimate` reads a known signal from the column of its name, and finds in the record of a loop
/// what the loop's estimator found.
#[test]
fn recorded_signals_are_told_to_the_estimator() {
    let dir = tempfile::tempdir().unwrap();
    let config = written(dir.path(), &format!("{ROOM}{ESTIMATOR}"));
    let noise = ["--set", "control.measurement.noise_sd=[0.1]"];
    for kind in KINDS {
        let sets = [kind, &noise, &MEASURED].concat();
        let run = tempfile::tempdir().unwrap();
        let closed = Closed::run(run.path(), &config, ModelKind::RK4, &sets);
        let table = closed.estimates.as_ref().unwrap();
        let mut text = "t,outside,heat,y_window\n".to_owned();
        for (k, row) in table.rows.iter().enumerate() {
            let (u, y) = (closed.inputs[k][0], row.measured[0]);
            text += &format!("{},{},{u},{y}\n", row.t, outside(k));
        }
        let [data, out] = ["data.csv", "out.csv"].map(|name| dir.path().join(name));
        fs::write(&data, &text).unwrap();
        let estimate = |output: &Path| {
            let mut command = pinc(&["estimate"]);
            command.arg(&config).arg("--data").arg(&data).args(&sets);
            outcome(command.arg("--output").arg(output))
        };
        let found = estimate(&out);
        assert_eq!(found.code, Some(0), "{found:?}");
        let rows = fs::read_to_string(&out).unwrap();
        for (line, row) in rows.lines().skip(1).zip(&table.rows) {
            let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
            for (found, expected) in cells[1..].iter().zip(&row.estimate) {
                assert!((found - expected).abs() < 1e-9, "{found} {expected}");
            }
        }
        assert_eq!(rows.lines().count(), table.rows.len() + 1);
        fs::write(&data, text.replace("outside", "air")).unwrap();
        estimate(&out).assert_refused(&["data.csv:1: column `outside` is missing"]);
    }
}

#[test]
fn a_signal_is_known_or_estimated() {
    let dir = tempfile::tempdir().unwrap();
    let config = written(dir.path(), &format!("{ROOM}{ESTIMATOR}"));
    let estimated = "control.estimator.parameters=[{ name = \"outside\", initial = 5.0, \
                     initial_sd = 2.0, drift_sd = 0.1 }]";
    for told in [MEASURED, SCHEDULED] {
        let mut command = pinc(&["control", "--quiet", "--set", estimated]);
        outcome(command.args(told).arg(&config)).assert_refused(&[
            "control.estimator.parameters[0].name",
            "a parameter that is neither measured nor in control.parameter_schedule",
        ]);
    }
    let mut command = pinc(&["export", "--to", "c"]);
    outcome(command.args(MEASURED).arg(&config)).assert_refused(&["control.measured_parameters"]);
}

/// A signal that is told but never changes is a constant: to targets, tubes with an estimated
/// covariance, and the gate, too.
#[test]
fn a_signal_that_stays_is_a_constant() {
    let disturbed =
        format!("{ROOM}{ESTIMATOR}disturbance_sd = [0.1]\ndisturbance_initial_sd = [0.3]\n")
            .replace("disturbance = \"none\"", "disturbance = \"output\"");
    let steady: &[&str] = &["--set", "control.plant_schedule=[]"];
    let noise: &[&str] = &["--set", "control.measurement.noise_sd=[0.1]"];
    let target: &[&str] = &["--set", "control.target=true"];
    let tube: &[&str] = &[
        "--set",
        "control.state_low=[19.5, 0.0]",
        "--set",
        "control.state_softness.penalty=[10.0, 10.0]",
        "--set",
        "control.uncertainty={ probability = 0.9, estimate = true, \
         parameters = { capacity = [1.8, 2.2] } }",
    ];
    for with in [target, tube] {
        let constant = run(&disturbed, &[steady, noise, with]);
        let told = run(&disturbed, &[steady, noise, with, &MEASURED]);
        assert!(largest_difference(&told, &constant) < 1e-9, "{with:?}");
        let changed = run(&disturbed, &[noise, with, &MEASURED]);
        assert!(largest_difference(&changed, &constant) > 0.1, "{with:?}");
    }
}
