//! Sweeps: killed and resumed, shared out and merged, with trials that fail.

use crate::common::{Outcome, leftovers, outcome, pinc};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};

/// Eight trainings of tiny nets, in cells of two seeds and two loops each: 16 trials.
pub(crate) const SWEEP: &str = r#"
name = "sweep"
preset = "ours"
seed = 3

[plant]
one-tank = {}

[model]
horizon_s = 10.0
hidden_layers = 1
neurons = 4

[domain]
state_low = [2.0]
state_high = [20.0]
input_low = [0.5]
input_high = [4.45]

[training]
collocation_points = 256
validation_every = 50
checkpoint_every_s = 0.01
phases = [
    { optimizer = { self-scaled-broyden = { initial_step = 0.1, gradient_tolerance = 1e-14 } }, iterations = 400 },
]

[training.growth]
max_points = 512
fresh_points = 256

[validation]
scenarios = 2
duration_s = 100.0
one_step_points = 32

[validation.domain]
state_low = [4.0]
state_high = [16.0]
input_low = [2.0]
input_high = [3.0]

[control]
duration_s = 100.0
initial_state = [5.0]
controlled = ["h"]
q = [10.0]
r = [1.0]
input_low = [0.5]
input_high = [4.45]
references = [{ start_s = 0.0, value = [9.0] }]
repetitions = 1

[sweep]
seeds = [1, 2]

[[sweep.cases]]
name = "one, layer"
set = { "model.hidden_layers" = 1 }

[[sweep.cases]]
name = "two layers"
set = { "model.hidden_layers" = 2 }

[[sweep.grid]]
key = "model.neurons"
values = [3, 5]

[[sweep.draws]]
name = "initial level"
count = 2
ranges = [{ key = "control.initial_state.0", low = 4.5, high = 5.5 }]
"#;

/// A folder with the sweep's config, `from` replaced by `to`.
pub(crate) fn sweep_with(from: &str, to: &str) -> (tempfile::TempDir, PathBuf) {
    assert!(SWEEP.contains(from), "`{from}` is not in the config");
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("sweep.toml");
    fs::write(&config, SWEEP.replacen(from, to, 1)).unwrap();
    (dir, config)
}

pub(crate) fn run(config: &Path, out: &Path, more: &[&str]) -> Outcome {
    let arguments = ["run".as_ref(), config.as_os_str(), "--quiet".as_ref(), "--out".as_ref()];
    outcome(pinc(&arguments).arg(out).args(more))
}

pub(crate) fn read(dir: &Path, file: &str) -> String {
    fs::read_to_string(dir.join(file)).unwrap()
}

/// The reproducible tables of a sweep.
pub(crate) fn tables(dir: &Path) -> (String, String) {
    (read(dir, "sweep.csv"), read(dir, "summary.csv"))
}

/// A table as rows of cells by column.
pub(crate) fn rows(text: &str) -> Vec<std::collections::HashMap<String, String>> {
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    reader.deserialize().map(Result::unwrap).collect()
}

#[test]
fn every_combination_is_a_trial_and_nets_are_shared() {
    let (dir, config) = sweep_with("seeds", "seeds");
    let out = dir.path().join("out");
    let outcome = run(&config, &out, &[]);
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    let trials = rows(&read(&out, "sweep.csv"));
    assert_eq!(trials.len(), 16);
    // Seeds outermost: the first half of the table has every cell.
    let seeds: Vec<_> = trials.iter().map(|trial| trial["seed"].as_str()).collect();
    assert_eq!(seeds, [["1"; 8], ["2"; 8]].concat());
    assert!(trials[..4].iter().all(|trial| trial["case"] == "one, layer"));
    assert!(trials.iter().all(|trial| trial["status"] == "done"));
    // The loops of one net share its training; the draws are the same for every net.
    assert_eq!(fs::read_dir(out.join("nets")).unwrap().count(), 8);
    assert_eq!(trials[0]["mse_gen"], trials[1]["mse_gen"]);
    assert_ne!(trials[0]["pinc_iae_dense_sum"], trials[1]["pinc_iae_dense_sum"]);
    for (a, b) in trials.iter().zip(&trials[2..]).step_by(2) {
        assert_eq!(a["control.initial_state.0"], b["control.initial_state.0"]);
    }
    for trial in &trials {
        let level: f64 = trial["control.initial_state.0"].parse().unwrap();
        assert!((4.5..5.5).contains(&level));
    }
    // A cell's trials, one per seed and draw, in the summary.
    let summary = rows(&read(&out, "summary.csv"));
    let row_of = |metric: &str| {
        let is_cell = |row: &&std::collections::HashMap<String, String>| {
            row["case"] == "two layers" && row["model.neurons"] == "5" && row["metric"] == metric
        };
        summary.iter().find(is_cell).unwrap()
    };
    let row = row_of("pinc_iae_dense_sum");
    let mut values: Vec<f64> = trials
        .iter()
        .filter(|trial| trial["case"] == "two layers" && trial["model.neurons"] == "5")
        .map(|trial| trial["pinc_iae_dense_sum"].parse().unwrap())
        .collect();
    values.sort_by(f64::total_cmp);
    assert_eq!((&*row["trials"], &*row["failed"], &*row["values"]), ("4", "0", "4"));
    let nets = row_of("mse_gen");
    assert_eq!((&*nets["trials"], &*nets["values"], &*nets["confidence"]), ("4", "2", "0.5"));
    assert_eq!(row["min"].parse(), Ok(values[0]));
    assert_eq!(row["max"].parse(), Ok(values[3]));
    let median: f64 = row["median"].parse().unwrap();
    assert!((median - f64::midpoint(values[1], values[2])).abs() < 1e-12 * median);
}

/// The table of an uninterrupted sweep is the measure of all others.
#[test]
fn a_sweep_killed_anywhere_and_resumed_has_the_same_table() {
    let (dir, config) = sweep_with("seeds", "seeds");
    let whole = dir.path().join("whole");
    let begun = Instant::now();
    assert_eq!(run(&config, &whole, &[]).code, Some(0));
    let duration = begun.elapsed();

    // Killed at moments over the whole length of the sweep, early and late, again and again.
    let killed = dir.path().join("killed");
    for part in [0.15, 0.4, 0.3] {
        let mut command = pinc(&["run".as_ref(), config.as_os_str(), "--out".as_ref()]);
        let mut child = command
            .arg(&killed)
            .args(["--quiet", "--resume"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(duration.mul_f64(part).max(Duration::from_millis(5)));
        // SIGKILL on Unix. A sweep that was faster this time is over, which is as good.
        child.kill().unwrap();
        child.wait().unwrap();
    }
    let resumed = run(&config, &killed, &["--resume"]);
    assert_eq!(resumed.code, Some(0), "{resumed:?}");
    assert_eq!(tables(&killed), tables(&whole));
}

#[test]
fn shards_merged_in_any_order_have_the_same_table() {
    let (dir, config) = sweep_with("seeds", "seeds");
    let at = |name: &str| dir.path().join(name);
    assert_eq!(run(&config, &at("whole"), &[]).code, Some(0));
    for shard in ["1/3", "2/3", "3/3"] {
        let out = at(&shard[..1]);
        assert_eq!(run(&config, &out, &["--shard", shard]).code, Some(0));
        // The table is whole, with the others' trials pending.
        let done = rows(&read(&out, "sweep.csv")).iter().filter(|t| t["status"] == "done").count();
        // Eight trainings with two trials each: no shard trains what another does.
        assert_eq!(done, if shard == "3/3" { 4 } else { 6 });
    }
    let nets = |name: &str| fs::read_dir(at(name).join("nets")).unwrap().count();
    assert_eq!((nets("1"), nets("2"), nets("3")), (3, 3, 2));
    for order in [["1", "2", "3"], ["3", "1", "2"]] {
        let merged = at(&format!("merged-{}", order.concat()));
        let mut command = pinc(&["merge", "--quiet", "--out"]);
        command.arg(&merged).args(order.map(at));
        let outcome = outcome(&mut command);
        assert_eq!(outcome.code, Some(0), "{outcome:?}");
        assert_eq!(tables(&merged), tables(&at("whole")));
    }
    // What has been merged can be gone on with, has nothing left to do, and loses what a process left
    // that was killed.
    for part in ["nets", "trials"].map(|folder| at("merged-123").join(folder)) {
        let dir = fs::read_dir(part).unwrap().next().unwrap().unwrap().path();
        fs::write(dir.join(".pinc-lock"), "1\n").unwrap();
        fs::write(dir.join(".pinc-unfinished-a"), "").unwrap();
    }
    assert_eq!(run(&config, &at("merged-123"), &["--resume"]).code, Some(0));
    assert_eq!(tables(&at("merged-123")), tables(&at("whole")));
    assert!(leftovers(&at("merged-123")).is_empty());
}

#[test]
fn sweeps_of_other_configs_are_not_merged() {
    let (dir, config) = sweep_with("iterations = 400", "iterations = 2");
    let (one, two, merged) = ("one", "two", "merged");
    let at = |name: &str| dir.path().join(name);
    assert_eq!(run(&config, &at(one), &["--shard", "1/16"]).code, Some(0));
    assert_eq!(run(&config, &at(two), &["--shard", "1/16", "--set", "seed=4"]).code, Some(0));
    let mut command = pinc(&["merge", "--out"]);
    outcome(command.arg(at(merged)).args([at(one), at(two)]))
        .assert_refused(&["two: belongs to another sweep than", "one"]);
    let mut command = pinc(&["merge", "--out"]);
    outcome(command.arg(at(merged)).arg(at("nothing"))).assert_refused(&["config.toml"]);
}

#[test]
fn a_failed_trial_is_in_the_table_and_stops_no_other() {
    // Steps so long that the weights overflow.
    let failing = r#"
[[sweep.cases]]
name = "diverges"
set = { "training.phases.0.optimizer" = { adam = { learning_rate = 1e300 } } }

[[sweep.cases]]
name = "works"
set = { "training.phases.0.iterations" = 5 }

[[sweep.grid]]
"#;
    let begin = SWEEP.find("[[sweep.cases]]").unwrap();
    let end = SWEEP.find("[[sweep.grid]]").unwrap() + "[[sweep.grid]]\n".len();
    let (dir, config) = sweep_with(&SWEEP[begin..end], failing);
    let out = dir.path().join("out");
    let outcome = run(&config, &out, &[]);
    assert_eq!(outcome.code, Some(1), "{outcome:?}");
    assert!(outcome.stderr.contains("8 of 16 trials failed"), "{outcome:?}");
    for trial in rows(&read(&out, "sweep.csv")) {
        let failed = trial["case"] == "diverges";
        assert_eq!(trial["status"], if failed { "failed" } else { "done" }, "{trial:?}");
        assert_eq!(trial["error"].contains("NaN or infinite"), failed, "{trial:?}");
        assert_eq!(trial["mse_gen"].is_empty(), failed, "{trial:?}");
    }
    let summary = rows(&read(&out, "summary.csv"));
    // No numbers of the failed cells, and none of theirs in the others.
    assert!(summary.iter().all(|row| row["case"] == "works" && row["failed"] == "0"));
    assert!(out.join("report.html").exists());
}

/// A loop that is refused its net is its trial's failure, not the sweep's, nor the other model's.
#[test]
fn a_model_that_fails_leaves_the_loops_of_the_others() {
    let levels = r#"
[[sweep.grid]]
key = "control.initial_state.0"
values = [1.0, 5.0]
"#;
    let begin = SWEEP.find("[sweep]").unwrap();
    let (dir, config) = sweep_with(&SWEEP[begin..], levels);
    let out = dir.path().join("out");
    let sets = ["control.outside_domain=\"refuse\"", "control.models=[\"pinc\", \"rk4\"]"];
    let outcome = run(&config, &out, &["--set", sets[0], "--set", sets[1]]);
    assert_eq!(outcome.code, Some(1), "{outcome:?}");
    assert!(outcome.stderr.contains("1 of 2 trials failed"), "{outcome:?}");
    let trials = rows(&read(&out, "sweep.csv"));
    for (trial, is_outside) in trials.iter().zip([true, false]) {
        assert_eq!(trial["status"] == "failed", is_outside, "{trial:?}");
        assert_eq!(trial["error"].contains("outside its training domain: h"), is_outside);
        assert_eq!(trial["pinc_iae"].is_empty(), is_outside, "{trial:?}");
        assert!(!trial["rk4_iae"].is_empty(), "{trial:?}");
    }
}

#[test]
fn mistakes_are_found_before_anything_runs() {
    let refused = |from: &str, to: &str, parts: &[&str]| {
        let (dir, config) = sweep_with(from, to);
        run(&config, &dir.path().join("out"), &[]).assert_refused(parts);
        assert!(!dir.path().join("out").exists());
    };
    refused(
        "values = [3, 5]",
        "values = [3, 0]",
        &[
            "`sweep`: in the trial with",
            "model.neurons = 0",
            "`model.neurons`: 0 given, expected at least 1",
        ],
    );
    refused("values = [3, 5]", "values = []", &["`sweep.grid[0].values`", "one value or more"]);
    refused("\"model.neurons\"", "\"model.neuron\"", &["did you mean `neurons`?"]);
    refused("\"model.neurons\"", "\"preset\"", &["`sweep.grid[0].key`", "another key"]);
    refused("low = 4.5, high = 5.5", "low = 6.5, high = 5.5", &["`sweep.draws[0].ranges[0].low`"]);
    refused("count = 2", "count = 0", &["`sweep.draws[0].count`"]);
    refused("count = 2", "cuont = 2", &["did you mean `count`?"]);
    let (dir, config) = sweep_with("seeds", "seeds");
    let out = dir.path().join("out");
    assert_eq!(run(&config, &out, &["--shard", "4/3"]).code, Some(2));
    let smoke = crate::common::repository("configs/smoke/rk4-only.toml");
    run(&smoke, &out, &["--shard", "1/3"]).assert_refused(&["section [sweep]"]);
}

/// Draws are a function of the seed, not of how many there are.
#[test]
fn more_draws_leave_the_first_as_they_were() {
    let levels = |count: &str| {
        let (dir, config) = sweep_with("count = 2", count);
        let out = dir.path().join("out");
        // The table has the draws of all trials, also of those that are others' to run.
        let set = "training.phases.0.iterations=1";
        assert_eq!(run(&config, &out, &["--shard", "1/100", "--set", set]).code, Some(0));
        let trials = rows(&read(&out, "sweep.csv"));
        trials.iter().map(|t| t["control.initial_state.0"].clone()).take(2).collect::<Vec<_>>()
    };
    assert_eq!(levels("count = 2"), levels("count = 3"));
}

#[test]
fn further_keys_of_an_axis_take_its_values_and_the_time_is_drawn() {
    let text =
        fs::read_to_string(crate::common::repository("configs/smoke/rk4-only.toml")).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let (config, out) = (dir.path().join("stages.toml"), dir.path().join("out"));
    let axis = "[[sweep.grid]]\nkey = \"control.n2\"\nvalues = [2, 4]\n";
    fs::write(&config, format!("{text}\n{axis}")).unwrap();
    // Nu = 5 is more than N2 = 2.
    run(&config, &out, &[]).assert_refused(&["`sweep`: in the trial with", "control.n2 = 2"]);
    fs::write(&config, format!("{text}\n{axis}also = [\"control.nu\"]\n")).unwrap();
    assert_eq!(run(&config, &out, &[]).code, Some(0));
    let trials = rows(&read(&out, "sweep.csv"));
    assert!(
        trials.iter().all(|t| t["status"] == "done" && !t["rk4_iae_dense_sum"].is_empty()),
        "{trials:?}"
    );
    assert!(out.join("figures/time.svg").exists());
    let refused = text + "\n" + axis + "also = [\"seed\"]\n";
    fs::write(&config, refused).unwrap();
    run(&config, &dir.path().join("other"), &[]).assert_refused(&["`sweep.grid[0].also`"]);
}

/// Plants whose gain the controller does not know, beside an upper bound.
const DRAWN: &str = r#"
name = "drawn"
preset = "ours"
seed = 1
[plant.expression]
states = [{ name = "x", unit = "m" }]
inputs = ["u"]
parameters = { k = 1.0 }
derivatives = { x = "(k*u - x)/10" }
[control]
models = ["rk4"]
step_s = 2.0
duration_s = 20.0
initial_state = [0.5]
controlled = ["x"]
q = [10.0]
r = [0.01]
n2 = 4
nu = 4
state_high = [1.5]
state_softness = "exact"
input_low = [0.0]
input_high = [10.0]
references = [{ start_s = 0.0, value = [1.5] }]
[[sweep.draws]]
name = "gains"
count = 12
ranges = [{ key = "control.plant.expression.parameters.k", low = 0.7, high = 1.3 }]
"#;

#[test]
fn the_trials_that_broke_a_bound_are_counted() {
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("drawn.toml");
    fs::write(&config, DRAWN).unwrap();
    let out = dir.path().join("out");
    let done = outcome(pinc(&["run"]).arg(&config).arg("--out").arg(&out));
    assert_eq!(done.code, Some(0), "{done:?}");
    let table = fs::read_to_string(out.join("sweep.csv")).unwrap();
    let mut rows = table.lines().map(|line| line.split(',').collect::<Vec<_>>());
    let column = rows.next().unwrap().iter().position(|c| *c == "rk4_violation_share").unwrap();
    let broken = rows.filter(|row| row[column].parse::<f64>().unwrap() > 1e-4).count();
    assert!((2..11).contains(&broken), "{broken} of 12");
    let note = format!("With RK4 a bound was broken in {broken} of 12 trials");
    assert!(done.stdout.contains(&format!("note: {note}")), "{}", done.stdout);
    let report = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(report.contains(&note) && report.contains("largest violation of a bound with RK4"));
}
