//! `pinc tune`: keys of the controller, tuned on drawn plants.

use crate::common::{Outcome, outcome, pinc};
use pinc_config::{Experiment, Plants};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::time::SystemTime;

/// A lag that is controlled far too gently.
const LAG: &str = r#"
name = "lag"
preset = "ours"
seed = 1
[plant.expression]
states = ["x"]
inputs = ["u"]
parameters = { rate = 1.0 }
derivatives = { x = "rate*(u - x)" }
[control]
models = ["rk4"]
step_s = 0.2
duration_s = 6.0
initial_state = [0.0]
controlled = ["x"]
n2 = 4
nu = 4
q = [1.0]
r = [100.0]
input_low = [-3.0]
input_high = [3.0]
references = [{ start_s = 0.0, value = [1.0] }]
plant_tolerance = 1e-6
[control.measurement]
measured = ["x"]
noise_sd = [0.01]
[control.estimator]
kind = "ekf"
process_sd = [0.01]
measurement_sd = [0.01]
initial_sd = [0.1]
initial_estimate = [0.0]
[tune]
candidates = 24
loops = 3
held_out = 4
ranges = [
    { key = "control.r.0", low = 0.01, high = 1000.0, log = true },
    { key = "control.n2", also = ["control.nu"], low = 2, high = 8, whole = true },
    { key = "control.estimator.process_sd.0", low = 0.001, high = 0.1, log = true },
]
draws = [
    { key = "control.plant.expression.parameters.rate", low = 0.7, high = 1.4 },
    { key = "control.references.0.value.0", low = 0.5, high = 2.0 },
]
"#;

fn tune(config: &Path, out: &Path, more: &[&str]) -> Outcome {
    let mut command = pinc(&["tune", "--out"]);
    outcome(command.arg(out).arg(config).args(more))
}

/// When each result of a trial was written.
fn written(out: &Path) -> BTreeMap<String, SystemTime> {
    let entries = fs::read_dir(out.join("trials")).unwrap().map(Result::unwrap);
    let of = |entry: fs::DirEntry| {
        let time = fs::metadata(entry.path().join("result.json")).unwrap().modified().unwrap();
        (entry.file_name().into_string().unwrap(), time)
    };
    entries.map(of).collect()
}

#[test]
fn the_tuned_config_is_better_on_other_plants_and_a_resumed_run_repeats_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let (config, out) = (dir.path().join("lag.toml"), dir.path().join("tuned"));
    fs::write(&config, LAG).unwrap();
    let first = tune(&config, &out, &[]);
    assert_eq!(first.code, Some(0), "{first:?}");
    let line = first.stdout.lines().find(|line| line.starts_with("cost of 4 held-out")).unwrap();
    let costs: Vec<f64> =
        line.split_whitespace().rev().take(2).map(|cost| cost.parse().unwrap()).collect();
    let [tuned, before] = costs[..] else { panic!("{line}") };
    assert!(tuned < 0.7 * before, "{line}");

    assert!(!first.stdout.contains("better as it is written"), "{first:?}");
    let path = out.join("tuned.toml");
    let said = format!("\n# held out: cost {tuned:.4}, as written {before:.4}\n");
    assert!(fs::read_to_string(&path).unwrap().contains(&said), "{said}");
    let experiment = Experiment::load(&path, &[], &Plants::built_in()).unwrap();
    let control = experiment.control.as_ref().unwrap();
    assert_eq!(control.n2, control.nu);
    // What differs from loop to loop is as it was.
    assert!(control.plant.is_none() && (control.references[0].value[0] - 1.0).abs() < 1e-12);
    let mut command = pinc(&["control", "--quiet", "--out"]);
    assert_eq!(outcome(command.arg(dir.path().join("run")).arg(&path)).code, Some(0));
    assert!(out.join("held-out/report.html").exists());
    let page = fs::read_to_string(out.join("held-out/report.html")).unwrap();
    assert!(page.contains("Provenance") && !page.contains("class=\"note\""), "no provenance");
    assert!(!page.contains("validation MSE"), "a loop without a net has none");
    outcome(pinc(&["report"]).arg(&out)).assert_refused(&["pinc tune", "held-out/report.html"]);
    let table = fs::read_to_string(out.join("tune.csv")).unwrap();
    assert_eq!(table.lines().count(), 2 + 24);
    assert!(table.starts_with("candidate,failed,cost,iae_dense_sum,input_travel,violation_share,"));

    // Some trials are lost, as if the run had been killed: only these are made again.
    let before = written(&out);
    let lost = before.keys().next().unwrap();
    fs::remove_file(out.join("trials").join(lost).join("result.json")).unwrap();
    let resumed = tune(&config, &out, &["--resume"]);
    assert_eq!((resumed.code, &resumed.stdout), (Some(0), &first.stdout));
    let after = written(&out);
    let changed: Vec<_> = after.iter().filter(|(id, time)| before[*id] != **time).collect();
    assert!(changed.len() == 1 && changed[0].0 == lost, "{changed:?}");
    assert_eq!(fs::read_to_string(out.join("tune.csv")).unwrap(), table);
}

#[test]
fn what_cannot_be_tuned_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let (config, out) = (dir.path().join("lag.toml"), dir.path().join("tuned"));
    fs::write(&config, LAG.split_once("[tune]").unwrap().0).unwrap();
    tune(&config, &out, &[]).assert_refused(&["no section [tune]"]);
    for (from, to, parts) in [
        ("control.r.0", "plant.r", &["tune.ranges[0].key", "a key of [control]"][..]),
        ("control.r.0", "control.rr", &["tune", "`control.rr`"]),
        ("low = 0.01,", "low = 0.0,", &["tune.ranges[0]", "positive ends"]),
        ("low = 0.7,", "low = 1.7,", &["tune.draws[0].low", "at most the upper end"]),
        ("parameters.rate\", low", "parameters.rat\", low", &["tune", "rat"]),
        ("candidates = 24", "candidates = 0", &["tune.candidates", "from 1 to 100000"]),
        ("candidates = 24", "cost = { iae = -1.0 }", &["tune.cost.iae", "0 or more"]),
        (
            "candidates = 24",
            "cost = { speed = 1.0 }",
            &["lag.toml: `tune.cost`", "\"speed\"", "iae_dense_sum"],
        ),
    ] {
        let text = LAG.replace(from, to);
        assert_ne!(text, LAG);
        fs::write(&config, text).unwrap();
        tune(&config, &out, &[]).assert_refused(parts);
    }
}

/// A candidate is a config of its own, which may be refused where each range by itself is not.
#[test]
fn candidates_that_the_config_does_not_admit_are_counted_and_explained() {
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("lag.toml");
    let lone = LAG.replace("also = [\"control.nu\"], ", "");
    assert_ne!(lone, LAG);
    fs::write(&config, &lone).unwrap();
    let some = tune(&config, &dir.path().join("some"), &[]);
    assert_eq!(some.code, Some(0), "{some:?}");
    let note = some.stdout.lines().find(|line| line.starts_with("Note: ")).unwrap();
    let table = fs::read_to_string(dir.path().join("some/tune.csv")).unwrap();
    let refused = table.lines().filter(|line| line.contains(",all,")).count();
    assert!((1..24).contains(&refused), "{table}");
    let count = format!("Note: the config does not admit {refused} of 24 candidates: ");
    assert!(note.starts_with(&count) && note.contains("control.nu"), "{note}");

    // Only by chance is the duration a whole number of such steps.
    let steps = "tune.ranges=[{ key = \"control.step_s\", low = 0.1, high = 0.3 }]";
    let none = ["--quiet", "--set", steps, "--set", "tune.candidates=5"];
    tune(&config, &dir.path().join("none"), &none).assert_refused(&[
        "tune.ranges",
        "admits no candidate",
        "duration_s",
    ]);
}

/// Where no candidate is better, the config is compared with itself; without the metrics of the cost
/// there is nothing to compare.
#[test]
fn the_config_itself_may_be_best_and_a_cost_without_metrics_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("lag.toml");
    let worse = LAG
        .replace("r = [100.0]", "r = [0.02]")
        .replace("low = 0.01, high = 1000.0", "low = 1e4, high = 1e5")
        .replace("candidates = 24", "candidates = 1");
    fs::write(&config, &worse).unwrap();
    let found = tune(&config, &dir.path().join("worse"), &[]);
    assert_eq!(found.code, Some(0), "{found:?}");
    let line = found.stdout.lines().find(|line| line.starts_with("cost of 4 held-out")).unwrap();
    let costs: Vec<&str> = line.split_whitespace().rev().take(2).collect();
    assert_eq!(costs[0], costs[1], "{line}");
    let economic = worse
        .replace("controlled = [\"x\"]", "controlled = []")
        .replace("q = [1.0]", "cost = { stage = \"(x - 1)^2\" }")
        .replace("references = [{ start_s = 0.0, value = [1.0] }]", "")
        .replace("{ key = \"control.references.0.value.0\", low = 0.5, high = 2.0 },", "");
    fs::write(&config, economic).unwrap();
    let refused = tune(&config, &dir.path().join("economic"), &[]);
    assert_eq!(refused.code, Some(2), "{refused:?}");
    assert!(refused.stderr.contains("`tune.cost`: the loops have no metric"), "{refused:?}");
}
