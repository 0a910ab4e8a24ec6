//! Sensors and estimators in configs: closed loops, recorded data, and what is refused.

use crate::common::{outcome, pinc, repository};
use pinc_record::{EstimateTable, Metrics};
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

/// The four tanks of recorded data, with a loop that they are not needed for.
const TANKS: &str = r#"
name = "recorded"
preset = "ours"
seed = 1
[plant]
four-tanks = { parameters = "antonelo" }
[control]
step_s = 10.0
models = ["rk4"]
rk4_substeps = 4
duration_s = 300.0
initial_state = [8.0, 13.0, 3.5, 2.5]
controlled = ["h1", "h2"]
q = [10.0, 10.0]
r = [1.0, 1.0]
input_low = [0.0, 0.0]
input_high = [5.0, 5.0]
references = [{ start_s = 0.0, value = [9.159582958982018, 14.211590549777885] }]
repetitions = 1
[control.measurement]
measured = ["h1", "h2"]
noise_sd = [0.05, 0.05]
[control.estimator]
kind = "ekf"
process_sd = [0.03, 0.03, 0.03, 0.03]
measurement_sd = [0.05, 0.05]
initial_estimate = [8.0, 13.0, 3.5, 2.5]
initial_sd = [1.0, 1.0, 1.0, 1.0]
"#;

/// A parameter of an equation that is estimated.
const LAG: &str = r#"
name = "lag"
preset = "ours"
seed = 3
[plant.expression]
states = ["x"]
inputs = ["u"]
parameters = { gain = 1.0, rate = 0.5 }
derivatives = { x = "rate*(gain*u - x)" }
[control]
step_s = 0.5
models = ["rk4"]
duration_s = 40.0
initial_state = [0.0]
controlled = ["x"]
q = [10.0]
r = [1.0]
input_low = [-5.0]
input_high = [5.0]
references = [{ start_s = 0.0, value = [1.0] }, { start_s = 20.0, value = [-1.0] }]
repetitions = 1
[control.plant.expression]
states = ["x"]
inputs = ["u"]
parameters = { gain = 0.8, rate = 0.5 }
derivatives = { x = "rate*(gain*u - x)" }
[control.measurement]
noise_sd = [0.01]
[control.estimator]
kind = "mhe"
window = 8
process_sd = [0.001]
measurement_sd = [0.01]
initial_estimate = [0.0]
initial_sd = [0.1]
[[control.estimator.parameters]]
name = "gain"
initial = 1.0
initial_sd = 0.3
drift_sd = 0.001
low = 0.5
high = 2.0
"#;

fn recorded(name: &str) -> PathBuf {
    repository("crates/pinc-estimate/tests/data").join(name)
}

fn written(dir: &Path, text: &str) -> PathBuf {
    let path = dir.join("config.toml");
    fs::write(&path, text).unwrap();
    path
}

/// The estimates in a file, without what belongs to measurements.
fn columns(path: &Path) -> (Vec<String>, Vec<Vec<f64>>) {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let header = lines.next().unwrap().split(',').map(str::to_owned).collect();
    let row = |line: &str| line.split(',').map(|cell| cell.parse().unwrap()).collect();
    (header, lines.map(row).collect())
}

/// The shipped loop with pumps that wear: the pump constants are followed, and nothing is left of
/// the error that stays without.
#[test]
fn pumps_that_wear_are_adapted_to() {
    let dir = tempfile::tempdir().unwrap();
    let config = repository("configs/estimation/wear.toml");
    let run = |name: &str, set: &str| {
        let out = dir.path().join(name);
        let mut command = pinc(&["control", "--quiet", "--set", "control.repetitions=1"]);
        command.arg(&config).arg("--out").arg(&out).args(["--set", set]);
        let found = outcome(&mut command);
        assert_eq!(found.code, Some(0), "{found:?}");
        let offset = &Metrics::read(&out).unwrap().unwrap().control[0].references.offset;
        let last = |name: &str| offset[name].last().copied().flatten().unwrap();
        let table = EstimateTable::read(&out.join("estimates.csv")).unwrap().unwrap();
        (last("h1"), last("h2"), table.rows.last().unwrap().estimate[4..].to_vec())
    };
    let (h1, h2, pumps) = run("adaptive", "control.preview=true");
    assert!(h1 < 1e-3 && h2 < 1e-3, "{h1} {h2}");
    assert!((pumps[0] - 2.664).abs() < 0.03 && (pumps[1] - 2.68).abs() < 0.03, "{pumps:?}");
    let (h1, h2, pumps) = run("plain", "control.estimator.parameters=[]");
    assert!(h1 > 0.1 && h2 > 0.1 && pumps.is_empty(), "{h1} {h2}");
}

#[test]
fn recorded_data_are_estimated() {
    let dir = tempfile::tempdir().unwrap();
    let config = written(dir.path(), TANKS);
    let (data, output) = (recorded("estim-tanks.csv"), dir.path().join("out.csv"));
    let path = |path: &Path| path.to_str().unwrap().to_owned();
    let arguments =
        ["estimate", &path(&config), "--data", &path(&data), "--output", &path(&output)];
    let found = outcome(&mut pinc(&arguments));
    assert_eq!(found.code, Some(0), "{found:?}");
    assert!(found.stdout.contains("241 rows; NIS 2.0"), "{found:?}");
    assert!(found.stdout.contains("RMSE h1 0.03"), "{found:?}");
    let (header, rows) = columns(&output);
    assert_eq!(header.join(","), "t,h1,h2,h3,h4,h1_sd,h2_sd,h3_sd,h4_sd");
    let (_, expected) = columns(&recorded("answer-tanks-ekf.csv"));
    assert_eq!(rows.len(), expected.len());
    for (found, expected) in rows.iter().zip(&expected) {
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-8, "{found} is not {expected}");
        }
    }
}

#[test]
fn recorded_data_may_have_gaps_and_must_have_steps_and_columns() {
    let dir = tempfile::tempdir().unwrap();
    let config = written(dir.path(), TANKS);
    let data = dir.path().join("data.csv");
    let run = |text: &str| {
        fs::write(&data, text).unwrap();
        let (config, data) = (config.to_str().unwrap(), data.to_str().unwrap());
        outcome(&mut pinc(&["estimate", config, "--data", data]))
    };
    let found = run("t,u2,u1,y_h1,y_h2,note\n0,3,3,8,13,a\n10,3,3,,NaN,b\n20,3,3,8.1,,c\n");
    assert_eq!(found.code, Some(0), "{found:?}");
    assert!(found.stdout.contains("3 rows") && !found.stdout.contains("RMSE"), "{found:?}");
    run("t,u1,u2,y_h1,y_h2,k1\n").assert_refused(&["data.csv:1: column `k1` is a parameter"]);
    run("t,u1,y_h1,y_h2\n0,3,8,13\n").assert_refused(&["data.csv:1: column `u2` is missing"]);
    run("t,u1,u2,y_h1,y_h1,y_h2\n0,3,3,8,80,13\n")
        .assert_refused(&["data.csv:1: column `y_h1` more than once"]);
    let late = "t,u1,u2,y_h1,y_h2\n0,3,3,8,13\n15,3,3,8,13\n";
    run(late).assert_refused(&["data.csv:3", "15 s after 0 s given", "T = 10 s"]);
    run("t,u1,u2,y_h1,y_h2\n").assert_refused(&["data.csv:1: 0 rows of data, expected 1 or more"]);
    let one = run("t,u1,u2,y_h1,y_h2\n0,3,3,8,13\n");
    assert!(one.code == Some(0) && one.stdout.starts_with("1 rows"), "{one:?}");
    run("t,u1,u2,y_h1,y_h2\n0,3,3,8,high\n").assert_refused(&["data.csv:2", "`y_h2`: `high`"]);
}

#[test]
fn a_loop_with_sensors_says_how_good_its_estimates_are() {
    let dir = tempfile::tempdir().unwrap();
    let config = written(dir.path(), TANKS);
    let out = dir.path().join("run");
    let run = |out: &Path, more: &[&str]| {
        let mut arguments = vec!["control", config.to_str().unwrap(), "--quiet"];
        arguments.extend(["--out", out.to_str().unwrap()]);
        arguments.extend(more);
        let found = outcome(&mut pinc(&arguments));
        assert_eq!(found.code, Some(0), "{found:?}");
        let metrics = Metrics::read(out).unwrap().unwrap();
        let table = EstimateTable::read(&out.join("estimates.csv")).unwrap().unwrap();
        (metrics.control[0].clone(), table)
    };
    let (metrics, table) = run(&out, &[]);
    let estimator = metrics.estimator.unwrap();
    assert_eq!(estimator.estimator_status["updated"], 30);
    assert!((1.0..3.5).contains(&estimator.nis_mean), "{estimator:?}");
    assert!(estimator.nees_mean > 0.0 && estimator.estimator_us.p50 > 0.0);
    assert!(estimator.estimate_rmse["h1"] < 0.06 && estimator.estimate_rmse.len() == 4);
    assert_eq!((table.rows.len(), table.measured.len()), (30, 2));
    assert_eq!(table.names, ["h1", "h2", "h3", "h4"]);
    let report = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(report.contains("extended Kalman filter") || report.contains("Innovation of h1"));
    // The noise follows from the seed.
    let (_, same) = run(&dir.path().join("again"), &[]);
    assert_eq!(same.rows[7].measured, table.rows[7].measured);
    let (_, other) = run(&dir.path().join("other"), &["--set", "seed=2"]);
    assert_ne!(other.rows[7].measured, table.rows[7].measured);
    // Exact sensors see the plant.
    let exact = ["--set", "control.measurement.noise_sd=[0.0, 0.0]"];
    let (_, exact) = run(&dir.path().join("exact"), &exact);
    assert!((exact.rows[0].measured[0] - 8.0).abs() < 1e-15);
}

/// Rejected measurements are counted in the table and in the metrics, by quantity; statistics are of
/// the others.
#[test]
fn rejected_measurements_are_counted() {
    let dir = tempfile::tempdir().unwrap();
    let config = written(dir.path(), TANKS);
    let out = dir.path().join("run");
    let mut command = pinc(&["control", "--out", out.to_str().unwrap()]);
    // Most of the second sensor's readings are beyond the gate.
    command.arg(&config).args(["--set", "control.measurement.noise_sd=[0.05, 40.0]"]);
    command.args(["--set", "control.estimator.gate=10.0"]);
    let found = outcome(&mut command);
    assert_eq!(found.code, Some(0), "{found:?}");
    let (header, rows) = columns(&out.join("estimates.csv"));
    let place = |name: &str| header.iter().position(|column| column == name).unwrap();
    assert_eq!(place("rejected"), header.len() - 1);
    let [v1, v2, nis, rejected] = ["innovation_h1", "innovation_h2", "nis", "rejected"].map(place);
    let mut total = 0;
    for row in &rows {
        let without = [v1, v2].iter().filter(|place| row[**place].is_nan()).count();
        assert_eq!(row[rejected].to_string(), without.to_string(), "{row:?}");
        total += without;
    }
    assert!(total > 10 && total < 30, "{total}");
    assert!(rows.iter().all(|row| !row[v1].is_nan() && !row[nis].is_nan()));
    let metrics = Metrics::read(&out).unwrap().unwrap();
    let estimator = metrics.control[0].estimator.clone().unwrap();
    assert_eq!(estimator.rejected.into_iter().collect::<Vec<_>>(), [("h2".to_owned(), total)]);
    assert_eq!((estimator.nis_steps, estimator.nis_undefined), (30, 0));
    assert_eq!(estimator.nees_steps, 30);
    let used = (60 - total) as f64 / 30.0;
    assert!((estimator.nis_expected - used).abs() < 1e-12, "{}", estimator.nis_expected);
    let mean = rows.iter().map(|row| row[nis]).sum::<f64>() / 30.0;
    assert!((estimator.nis_mean / mean - 1.0).abs() < 1e-12, "{} {mean}", estimator.nis_mean);
    let gated: usize = ["rejected", "reacquired"]
        .iter()
        .filter_map(|status| estimator.estimator_status.get(*status))
        .sum();
    assert!(gated >= total, "{:?}", estimator.estimator_status);
    // What was rejected is said where the run ends.
    let said = format!("in 30 steps the estimator's gate rejected measurements: {total} of h2.");
    assert!(found.stdout.contains(&said) || found.stderr.contains(&said), "{found:?}");
}

/// The model's pumps deliver less than the plant's, so an estimator that trusts the model is
/// inconsistent; terminal and report say so, with numbers.
#[test]
fn an_inconsistent_estimator_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let plant = "[control.plant]\nfour-tanks = { parameters = \"antonelo\", pump = [4.0, 2.7] }\n";
    let config = written(dir.path(), &format!("{TANKS}{plant}"));
    let out = dir.path().join("run");
    let mut command = pinc(&["control", "--out", out.to_str().unwrap()]);
    let found = outcome(command.arg(&config));
    assert_eq!(found.code, Some(0), "{found:?}");
    let metrics = Metrics::read(&out).unwrap().unwrap();
    let estimator = metrics.control[0].estimator.clone().unwrap();
    assert!(estimator.nis_mean > 10.0, "{estimator:?}");
    let report = fs::read_to_string(out.join("report.html")).unwrap();
    let report = report.split_whitespace().collect::<Vec<_>>().join(" ");
    let terminal = [&found.stdout[..], &found.stderr].concat();
    let terminal = terminal.split_whitespace().collect::<Vec<_>>().join(" ");
    for text in [&terminal, &report] {
        let said = text.split("With RK4 the estimator is inconsistent: its mean NIS is ").nth(1);
        let said = said.unwrap_or_else(|| panic!("nothing said: {text}"));
        let mean: f64 = said.split(',').next().unwrap().parse().unwrap();
        assert!((mean / estimator.nis_mean - 1.0).abs() < 5e-3, "{mean}");
        assert!(said.contains("where a consistent one has 2.00 ("), "{said}");
        assert!(said.contains("raise process_sd and disturbance_sd"), "{said}");
    }
}

#[test]
fn a_parameter_is_found_in_the_loop() {
    let dir = tempfile::tempdir().unwrap();
    let config = written(dir.path(), LAG);
    let out = dir.path().join("run");
    let arguments = ["control", config.to_str().unwrap(), "--out", out.to_str().unwrap()];
    let found = outcome(&mut pinc(&arguments));
    assert_eq!(found.code, Some(0), "{found:?}");
    let table = EstimateTable::read(&out.join("estimates.csv")).unwrap().unwrap();
    assert_eq!(table.names, ["x", "gain"]);
    let last = table.rows.last().unwrap();
    assert!((last.estimate[1] - 0.8).abs() < 0.03, "{last:?}");
    let metrics = Metrics::read(&out).unwrap().unwrap();
    for offset in metrics.control[0].references.offset["x"].iter().flatten() {
        assert!(*offset < 0.02, "{offset}");
    }
}

/// The lag's parameter followed row by row: without drift it ends where the fit of all rows does, with
/// half its interval as standard deviation; with drift it follows a change; and if it is taken for
/// certain, or leaves the rows behind, the terminal says so.
#[test]
fn a_parameter_followed_through_a_record_agrees_with_the_fit_of_all_rows() {
    let dir = tempfile::tempdir().unwrap();
    let fit = "[identify]\nmeasurement_sd = [0.01]\ninitial_state = [0.0]\n\
        parameters = [{ name = \"gain\", initial = 1.0, low = 0.5, high = 2.0 }]\n";
    let kalman = LAG.replace("kind = \"mhe\"\nwindow = 8\n", "kind = \"ekf\"\n");
    let config = written(dir.path(), &format!("{kalman}{fit}"));
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let write = |name: &str, gain: &dyn Fn(u32) -> f64| {
        let (mut x, mut text) = (0.0_f64, "t,u,y_x,x\n".to_owned());
        for row in 0..240_u32 {
            let u = f64::from(row / 12 * 7 % 5) - 2.0;
            // Uniform, with a standard deviation of 0.01.
            let noise = 0.0346 * (f64::from(row * 7919 % 1009) / 1009.0 - 0.5);
            writeln!(text, "{},{u},{},{x}", 0.5 * f64::from(row), x + noise).unwrap();
            x += (gain(row) * u - x) * (1.0 - (-0.25_f64).exp());
        }
        fs::write(path(name), text).unwrap();
    };
    write("held.csv", &|_| 0.8);
    write("changed.csv", &|row| if row < 120 { 0.8 } else { 1.1 });
    let follow = |data: &str, kind: &str, sets: &[&str]| {
        let (config, data, out) = (config.to_str().unwrap(), path(data), path("out.csv"));
        let kind = format!("control.estimator.kind={kind}");
        let mut command = pinc(&["estimate", config, "--data", &data, "--output", &out]);
        command.args(["--set", "control.estimator.process_sd=[1e-6]", "--set", &kind]);
        sets.iter().for_each(|set| _ = command.args(["--set", set]));
        let found = outcome(&mut command);
        assert_eq!(found.code, Some(0), "{found:?}");
        let last = columns(Path::new(&out)).1.pop().unwrap();
        (last[2], last[4], found.stdout)
    };
    let gain = |initial: f64, sd: f64, drift: f64| {
        format!(
            "control.estimator.parameters=[{{ name = \"gain\", initial = {initial}, \
             initial_sd = {sd}, drift_sd = {drift} }}]"
        )
    };

    let out = path("fit");
    let arguments = ["identify", "--data", &path("held.csv"), "--out", &out];
    let found = outcome(pinc(&arguments).arg(&config));
    assert_eq!(found.code, Some(0), "{found:?}");
    let json = fs::read_to_string(Path::new(&out).join("identify.json")).unwrap();
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let of = |key: &str| json["parameters"]["gain"][key].as_f64().unwrap();
    let (value, half_width) = (of("value"), of("half_width_95"));
    assert!((value - 0.8).abs() < half_width, "{value} +- {half_width}");
    for kind in ["ekf", "ukf"] {
        let (last, sd, said) = follow("held.csv", kind, &[&gain(1.0, 0.3, 0.0)]);
        assert!((last - value).abs() < 0.1 * half_width, "{kind}: {last}, {value}");
        assert!((1.97 * sd / half_width - 1.0).abs() < 0.1, "{kind}: {sd}, {half_width}");
        assert!(!said.contains("inconsistent") && !said.contains("rejected"), "{said}");
    }

    let (last, sd, _) = follow("changed.csv", "ekf", &[&gain(1.0, 0.3, 0.01)]);
    assert!((last - 1.1).abs() < 3.0 * sd && sd < 0.03, "{last} +- {sd}");
    let (last, _, said) = follow("changed.csv", "ekf", &[&gain(0.8, 1e-6, 0.0)]);
    assert!((last - 0.8).abs() < 1e-3, "{last}");
    assert!(said.contains("the estimator is inconsistent: its mean NIS is "), "{said}");
    let (_, _, said) =
        follow("held.csv", "ekf", &[&gain(-2.0, 1e-6, 0.0), "control.estimator.gate=1.0"]);
    assert!(said.contains("in 240 steps the estimator's gate rejected measurements: "), "{said}");
}

#[test]
fn sections_that_do_not_fit_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let refused = |text: &str, set: &str, parts: &[&str]| {
        let config = written(dir.path(), text);
        let arguments = ["check", config.to_str().unwrap(), "--set", set];
        outcome(&mut pinc(&arguments)).assert_refused(parts);
    };
    let of = |key: &str, value: &str| format!("control.{key}={value}");
    let tanks = |key: &str, value: &str, parts: &[&str]| refused(TANKS, &of(key, value), parts);
    tanks("measurement.measured", "[\"h1\", \"h7\"]", &["measured[1]`: `h7` is not known"]);
    tanks("measurement.noise_sd", "[0.1]", &["noise_sd`", "measured quantity"]);
    tanks("measurement.noise_sd", "[0.1, -0.1]", &["noise_sd[1]`", "0 or a positive number"]);
    tanks("estimator.kind", "kalman", &["estimator.kind`", "ekf, ukf, mhe"]);
    tanks("estimator.process_sd", "[0.1]", &["process_sd`", "expected 4: h1, h2, h3, h4"]);
    tanks("estimator.measurement_sd", "[0.1, 0.0]", &["measurement_sd[1]`", "positive"]);
    tanks("estimator.window", "5", &["window`", "it is for kind = \"mhe\""]);
    tanks("estimator.kind", "mhe", &["window`", "the length of the window"]);
    tanks("estimator.disturbance", "input", &["disturbance_sd`", "disturbance"]);
    let states = "{ states = [\"h1\", \"h1\"] }";
    tanks("estimator.disturbance", states, &["disturbance.states[1]`", "each of them once"]);
    let parameter = "[{ name = \"k1\", initial = 3.3, initial_sd = 0.1 }]";
    let k9 = parameter.replace("k1", "k9");
    tanks("estimator.parameters", &k9, &["`k9` is not known"]);
    tanks("models", "[\"rk4\", \"rk4\"]", &["control.models"]);
    let width = "a positive and finite number of standard deviations, or \"off\"";
    for sd in ["0.0", "-3.0"] {
        tanks("estimator.gate", sd, &["control.estimator.gate`", width]);
    }
    tanks("estimator.gate", "inf", &["control.estimator.gate`", "expected a finite number"]);
    let number_or_off = "expected a number of standard deviations, or \"off\"";
    for word in ["\"wide\"", "\"Off\"", "true", "[3.0]"] {
        tanks("estimator.gate", word, &["control.estimator.gate`", number_or_off]);
        let in_file = format!("{TANKS}gate = {word}\n");
        refused(&in_file, "seed=1", &["config.toml", "gate", number_or_off]);
    }
    let in_file = format!("{TANKS}gate = -1\n");
    refused(&in_file, "seed=1", &["config.toml", "control.estimator.gate`", width]);
    let parameter = "[{ name = \"gains\", initial = 3.3, initial_sd = 0.1 }]";
    let key = of("estimator.parameters", parameter);
    refused(LAG, &key, &["`gains` is not known", "did you mean `gain`?"]);
    // More disturbances than sensors.
    let alone = TANKS
        .replace("measured = [\"h1\", \"h2\"]", "measured = [\"h1\"]")
        .replace("noise_sd = [0.05, 0.05]", "noise_sd = [0.05]")
        .replace("measurement_sd = [0.05, 0.05]", "measurement_sd = [0.05]")
        + "disturbance = \"input\"\ndisturbance_sd = [0.1, 0.1]\n\
           disturbance_initial_sd = [0.5, 0.5]\n";
    refused(&alone, "seed=1", &["at most one disturbance per measured quantity"]);
    // Sensors and nothing that uses them.
    let lost = TANKS.split("[control.estimator]").next().unwrap();
    refused(lost, "seed=1", &["[control.estimator]"]);
}

/// A leak that begins and ends: the estimated disturbance is there while the leak is, and the
/// controlled levels come back.
#[test]
fn a_leak_is_found_while_it_lasts() {
    let dir = tempfile::tempdir().unwrap();
    let config = written(dir.path(), TANKS);
    let out = dir.path().join("run");
    let free = "plant.four-tanks.parameters=johansson-minimum";
    let leak = "control.loads=[{ start_s = 400.0, end_s = 1000.0, rates = { h1 = -0.02 } }]";
    let disturbed = "{ states = [\"h1\", \"h2\"] }";
    let mut sets: Vec<String> = vec![free.into(), leak.into()];
    for (key, value) in [
        ("duration_s", "1600.0"),
        ("initial_state", "[12.4, 12.7, 1.8, 1.4]"),
        ("references", "[{ start_s = 0.0, value = [12.4, 12.7] }]"),
        ("measurement.noise_sd", "[0.0, 0.0]"),
        ("estimator.initial_estimate", "[12.4, 12.7, 1.8, 1.4]"),
        ("estimator.disturbance", disturbed),
        ("estimator.disturbance_sd", "[0.1, 0.1]"),
        ("estimator.disturbance_initial_sd", "[0.5, 0.5]"),
    ] {
        sets.push(format!("control.{key}={value}"));
    }
    let mut command = pinc(&["control", "--quiet"]);
    command.arg(&config).arg("--out").arg(&out);
    sets.iter().for_each(|set| {
        command.args(["--set", set]);
    });
    let found = outcome(&mut command);
    assert_eq!(found.code, Some(0), "{found:?}");
    let table = EstimateTable::read(&out.join("estimates.csv")).unwrap().unwrap();
    let leak = |step: usize| table.rows[step].estimate[4];
    assert!(leak(39).abs() < 1e-3 && leak(159).abs() < 1e-3, "{} {}", leak(39), leak(159));
    // r = -0.02 cm/s for T = 10 s, less what flows out less at a lower level: r tau (1 - exp(-T/tau))
    // with the tank's time constant tau = A/a sqrt(2 h/g) at h = 12.4 cm. Linear about that level:
    // what the level falls by meanwhile, 0.2 cm, is 0.016 of it, and acts on the second term alone.
    let tau = 28.0 / 0.071 * (2.0 * 12.4 / 981.0_f64).sqrt();
    let lost = -0.02 * tau * (1.0 - (-10.0 / tau).exp());
    assert!((leak(99) - lost).abs() < 1e-3, "{} instead of {lost}", leak(99));
    let metrics = Metrics::read(&out).unwrap().unwrap();
    let offset = &metrics.control[0].references.offset["h1"];
    assert!(offset.iter().flatten().all(|offset| *offset < 1e-2), "{offset:?}");
}

#[test]
fn loads_that_make_no_sense_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let config = written(dir.path(), TANKS);
    for (load, parts) in [
        ("{ start_s = 0.0 }", &["control.loads[0]`", "what the load adds"][..]),
        ("{ start_s = 300.0, rates = { h1 = 1.0 } }", &["start_s`", "less than the duration"]),
        ("{ start_s = 5.0, rates = { h1 = 1.0 } }", &["start_s`", "whole number of steps"]),
        ("{ start_s = 20.0, end_s = 10.0, rates = { h1 = 1.0 } }", &["end_s`", "more than 20"]),
        ("{ start_s = 0.0, rates = { h7 = 1.0 } }", &["loads[0].rates.h7`", "`h7` is not known"]),
        ("{ start_s = 0.0, inputs = { h1 = 1.0 } }", &["inputs.h1`", "`h1` is not known"]),
    ] {
        let mut command = pinc(&["check"]);
        command.arg(&config).args(["--set", &format!("control.loads=[{load}]")]);
        outcome(&mut command).assert_refused(parts);
    }
}

/// What the plant of the loop cannot hold, and when.
#[test]
fn check_asks_the_plant_of_the_loop() {
    let dir = tempfile::tempdir().unwrap();
    let config = written(dir.path(), TANKS);
    let check = |set: &str| {
        let found = outcome(&mut pinc(&["check", config.to_str().unwrap(), "--set", set]));
        assert_eq!(found.code, Some(0), "{found:?}");
        found.stdout
    };
    // A leak takes the levels off the line that the singular gain reaches.
    let leak = "{ start_s = 100.0, end_s = 200.0, rates = { h1 = -0.02 } }";
    let said = check(&format!("control.loads=[{leak}]"));
    let place = "with the plant of the loop from 100 s to 3.33 min: h1 = 9.15958, h2 = 14.2115";
    assert!(said.contains(place) && said.contains("is no steady state"), "{said}");
    // Worn pumps do not, but weak ones need more than 5 V.
    let pumps = |k: &str| {
        check(&format!(
            "control.plant={{ four-tanks = {{ parameters = \"antonelo\", pump = {k} }} }}"
        ))
    };
    let said = pumps("[3.1, 3.1]");
    assert!(said.contains("the plant of the loop can hold what the models' plant can"), "{said}");
    let said = pumps("[1.5, 1.5]");
    assert!(
        said.contains("with the plant of the loop: ") && said.contains("within bounds"),
        "{said}"
    );
}

/// The conditions for offset-free control, in words.
#[test]
fn check_says_what_an_estimator_cannot_find() {
    let dir = tempfile::tempdir().unwrap();
    let check = |text: &str| {
        let config = written(dir.path(), text);
        let found = outcome(&mut pinc(&["check", config.to_str().unwrap()]));
        assert_eq!(found.code, Some(0), "{found:?}");
        found.stdout
    };
    let said = check(TANKS);
    assert!(said.contains("extended Kalman filter: h1, h2, h3, h4 estimated from h1, h2"));
    assert!(said.contains("0 disturbances and parameters are estimated, and 2 quantities"));
    // Pumps whose effect on the measured levels has rank 1.
    let disturbed = "disturbance_sd = [0.1, 0.1]\ndisturbance_initial_sd = [0.5, 0.5]\n";
    let pumps = format!("{TANKS}disturbance = \"input\"\n{disturbed}");
    let said = check(&pumps);
    assert!(said.contains("rank 5 of 6") && said.contains("d_u1, d_u2 apart"), "{said}");
    let leaks = format!("{TANKS}disturbance = {{ states = [\"h1\", \"h2\"] }}\n{disturbed}");
    assert!(!check(&leaks).contains("apart"));
    // What is controlled has to be measured.
    let other = leaks.replace("controlled = [\"h1\", \"h2\"]", "controlled = [\"h1\", \"h3\"]");
    assert!(check(&other).contains("h3 is controlled, but not measured"));
    // The sensors of a plant that is unstable at rest.
    let oscillator = TANKS
        .replace("four-tanks = { parameters = \"antonelo\" }", "van-der-pol = { mu = 1.0 }")
        .replace("initial_state = [8.0, 13.0, 3.5, 2.5]", "initial_state = [1.0, 0.0]")
        .replace("controlled = [\"h1\", \"h2\"]", "controlled = [\"x1\"]")
        .replace("q = [10.0, 10.0]", "q = [10.0]")
        .replace("r = [1.0, 1.0]", "r = [1.0]")
        .replace("input_low = [0.0, 0.0]", "input_low = [-1.0]")
        .replace("input_high = [5.0, 5.0]", "input_high = [1.0]")
        .replace("[9.159582958982018, 14.211590549777885]", "[0.3]")
        .replace("step_s = 10.0", "step_s = 0.5")
        .replace("measured = [\"h1\", \"h2\"]", "measured = [\"x1\"]")
        .replace("noise_sd = [0.05, 0.05]", "noise_sd = [0.05]")
        .replace("process_sd = [0.03, 0.03, 0.03, 0.03]", "process_sd = [0.03, 0.03]")
        .replace("measurement_sd = [0.05, 0.05]", "measurement_sd = [0.05]")
        .replace("initial_estimate = [8.0, 13.0, 3.5, 2.5]", "initial_estimate = [1.0, 0.0]")
        .replace("initial_sd = [1.0, 1.0, 1.0, 1.0]", "initial_sd = [1.0, 1.0]");
    let output =
        "disturbance = \"output\"\ndisturbance_sd = [0.1]\ndisturbance_initial_sd = [0.5]\n";
    let said = check(&(oscillator + output));
    assert!(said.contains("output disturbances with an unstable steady state"), "{said}");
}

/// What is estimated in the loop is no argument of the steps that `[one_step]` looks at.
#[test]
fn single_steps_are_judged_beside_an_estimated_parameter() {
    let dir = tempfile::tempdir().unwrap();
    let sections = "[domain]\nstate_low = [-2.0]\nstate_high = [2.0]\ninput_low = [-5.0]\n\
                    input_high = [5.0]\n[one_step]\npoints = 16\nmeasure_s = 0.001\n";
    let config = written(dir.path(), &format!("{LAG}{sections}"));
    let out = dir.path().join("run");
    let (config, out) = (config.to_str().unwrap(), out.to_str().unwrap());
    let found = outcome(&mut pinc(&["run", config, "--quiet", "--out", out]));
    assert_eq!(found.code, Some(0), "{found:?}");
    let metrics = Metrics::read(Path::new(out)).unwrap().unwrap();
    let [rk4] = &metrics.one_step[..] else { panic!("{metrics:?}") };
    assert!(rk4.errors.rms < 1e-4, "{rk4:?}");
}

/// The shipped loops under a load that acts from the first step have the IAE that
/// docs/measurements.md prints, which an independent program has as well.
#[test]
fn the_shipped_oscillator_under_a_load_has_its_published_iae() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("out");
    let config = repository("configs/estimation/offset-oscillator.toml");
    let mut command = pinc(&["run", "--quiet", "--set", "control.models=[\"rk4\"]"]);
    let found = outcome(command.arg(&config).arg("--out").arg(&out));
    assert_eq!(found.code, Some(0), "{found:?}");
    let table = fs::read_to_string(out.join("sweep.csv")).unwrap();
    let mut rows = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let header = rows.next().unwrap();
    let place = |name: &str| header.iter().position(|known| *known == name).unwrap();
    let (case, iae) = (place("case"), place("rk4_iae_dense_sum"));
    let found: Vec<_> = rows.map(|row| (row[case].to_owned(), row[iae].parse().unwrap())).collect();
    let expected: [(&str, f64); 2] = [("plain", 283.23), ("input", 143.79)];
    assert_eq!(found.len(), expected.len(), "{table}");
    for ((name, iae), (case, published)) in found.iter().zip(expected) {
        let iae: f64 = *iae;
        assert!(name == case && (iae - published).abs() < 5e-3, "{name}: {iae}, not {published}");
    }
}
