//! `pinc choose`: which model should be in a loop.

use crate::common::{Outcome, outcome, pinc, repository};
use pinc_config::{Experiment, ModelKind, Plants};
use pinc_record::Metrics;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// The oscillator with trainings that end before their nets are any good.
const TINY: [&str; 6] = [
    "--set",
    "training.phases.0.iterations=8",
    "--set",
    "training.collocation_points=64",
    "--set",
    "control.duration_s=5.0",
];

/// A lag so fast that explicit methods are unstable with any number of substeps that is tried.
const FAST: &str = r#"
name = "fast"
preset = "ours"
seed = 1
[plant.expression]
states = ["x"]
inputs = ["u"]
derivatives = { x = "2e4*(u - x)" }
[control]
step_s = 0.1
duration_s = 0.5
initial_state = [0.0]
controlled = ["x"]
n2 = 2
nu = 2
q = [10.0]
r = [1.0]
input_low = [-5.0]
input_high = [5.0]
references = [{ start_s = 0.0, value = [1.0] }]
repetitions = 1
plant_tolerance = 1e-6
"#;

fn choose(config: &Path, out: &Path, more: &[&str]) -> Outcome {
    let mut command = pinc(&["choose", "--out"]);
    command.arg(out).arg(config).args(more);
    if !more.iter().any(|argument| argument.starts_with("--budget-s")) {
        command.args(["--budget-s", "1000"]);
    }
    outcome(&mut command)
}

fn iae_of(config: &Path, out: &Path) -> f64 {
    let mut command = pinc(&["control", "--quiet", "--set", "control.repetitions=1", "--out"]);
    let ended = outcome(command.arg(out).arg(config));
    assert_eq!(ended.code, Some(0), "{ended:?}");
    let metrics = fs::read(out.join("metrics.json")).unwrap();
    let metrics: Metrics = serde_json::from_slice(&metrics).unwrap();
    metrics.control[0].iae_dense_sum
}

/// When each result of a trial and each net was written.
fn written(out: &Path) -> BTreeMap<PathBuf, SystemTime> {
    let mut found = BTreeMap::new();
    for (folder, name) in [("trials", "result.json"), ("nets", "model.safetensors")] {
        for entry in fs::read_dir(out.join(folder)).unwrap() {
            let path = entry.unwrap().path().join(name);
            let time = fs::metadata(&path).unwrap().modified().unwrap();
            found.insert(path, time);
        }
    }
    found
}

/// The table and the advice, without the progress.
fn table(outcome: &Outcome) -> String {
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
    outcome.stdout.clone()
}

#[test]
fn the_recommended_config_keeps_its_promise_and_a_resumed_run_repeats_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("choice");
    let config = repository("configs/smoke/van-der-pol.toml");
    let one_step = dir.path().join("config.toml");
    let text = fs::read_to_string(config).unwrap();
    fs::write(&one_step, format!("{text}\n[one_step]\npoints = 64\nmeasure_s = 0.001\n")).unwrap();
    let first = table(&choose(&one_step, &out, &TINY));
    // The nets are bad after so short a training, so that an integrator it is.
    assert!(first.contains("Use RK"), "{first}");
    assert!(first.contains("RK4 x4 ") && first.contains("distilled 2x16"), "{first}");
    assert!(out.join("tried/report.html").exists());
    for (file, column) in [("sweep.csv", "iae_dense_sum"), ("timings.csv", "step_us")] {
        let text = fs::read_to_string(out.join("tried").join(file)).unwrap();
        let head: Vec<&str> = text.lines().next().unwrap().split(',').collect();
        for model in ["pinc", "rk4", "rk5"] {
            assert!(head.contains(&format!("{model}_{column}").as_str()), "{file}: {head:?}");
        }
    }

    let recommended = out.join("recommended.toml");
    let chosen = Experiment::load(&recommended, &[], &Plants::built_in()).unwrap();
    let comments = fs::read_to_string(&recommended).unwrap();
    assert!(comments.starts_with("# Use RK"), "{comments}");
    let models = &chosen.control.as_ref().unwrap().models;
    assert!(models.len() == 1 && models[0] != ModelKind::Pinc, "{models:?}");
    let promised = iae_of(&recommended, &dir.path().join("run"));
    assert!(first.contains(&format!("its IAE of {promised:.6} is")), "{promised} {first}");
    let exact = ["--set", "control.models=[\"rk4\"]", "--set", "control.rk4_substeps=64"];
    let exact_config = dir.path().join("exact.toml");
    fs::write(&exact_config, chosen.to_toml()).unwrap();
    let mut command = pinc(&["control", "--quiet", "--out"]);
    let ran = dir.path().join("exact");
    assert_eq!(outcome(command.arg(&ran).arg(&exact_config).args(exact)).code, Some(0));
    let metrics = fs::read(ran.join("metrics.json")).unwrap();
    let metrics: Metrics = serde_json::from_slice(&metrics).unwrap();
    assert!(promised <= 1.01 * metrics.control[0].iae_dense_sum, "{promised}");

    // All is there: nothing is run or trained again, and the same is said.
    let before = written(&out);
    assert!(before.len() > 8, "{before:?}");
    let resumed = choose(&one_step, &out, &[&TINY[..], &["--resume"]].concat());
    assert_eq!(table(&resumed), first);
    assert_eq!(written(&out), before);

    // Another config has another directory.
    choose(&one_step, &out, &["--resume"]).assert_refused(&["another config"]);
}

#[test]
fn the_steps_of_exported_c_are_timed() {
    let dir = tempfile::tempdir().unwrap();
    let config = repository("configs/smoke/van-der-pol.toml").canonicalize().unwrap();
    // A relative directory, as the default is.
    let in_c = ["choose", "--budget-s", "1000", "--target", "c", "--out", "runs/out"];
    let mut command = pinc(&in_c);
    let table = table(&outcome(command.args(TINY).arg(config).current_dir(dir.path())));
    assert!(table.contains("Note: times are of the exported C"), "{table}");
    let times = |line: &str| -> Option<[f64; 2]> {
        let words: Vec<&str> = line.strip_suffix("   good")?.split_whitespace().collect();
        Some([words[3].parse().unwrap(), words[4].parse().unwrap()])
    };
    let good: Vec<_> = table.lines().filter_map(times).collect();
    assert!(good.len() > 1 && good.iter().all(|[p50, p99]| *p50 > 0.0 && p99 >= p50), "{table}");
}

/// Nets have to keep the tolerances of the config: they are trained until their errors are proven to,
/// and one whose estimated error is beyond its tolerance in the loop is not good.
#[test]
fn nets_have_to_keep_their_tolerances() {
    let dir = tempfile::tempdir().unwrap();
    let config = repository("configs/smoke/van-der-pol.toml");
    let choose_with = |name: &str, sets: &[&str]| {
        let out = dir.path().join(name);
        let sets = sets.iter().flat_map(|set| ["--set", set]);
        let more: Vec<&str> = TINY.into_iter().chain(sets).chain(["--within", "50%"]).collect();
        (table(&choose(&config, &out, &more)), out)
    };
    let rows = |said: &str| -> Vec<String> {
        let is_net = |line: &&str| line.starts_with("distilled ") || line.starts_with("PINC ");
        said.lines().filter(is_net).map(str::to_owned).collect()
    };
    let loose = "training.proven_tolerance={ x1 = 10.0, x2 = 20.0 }";
    let (said, out) = choose_with("loose", &[loose, "control.error_tolerance={ x1 = 1e-9 }"]);
    let nets = rows(&said);
    let judged = nets.iter().filter(|row| row.contains("beyond control.error_tolerance in "));
    assert!(judged.count() > 0 && nets.iter().all(|row| !row.ends_with("good")), "{said}");
    assert!(said.contains("Use RK"), "{said}");
    let recommended = fs::read_to_string(out.join("recommended.toml")).unwrap();
    assert!(!recommended.contains("error_tolerance"), "{recommended}");
    for entry in fs::read_dir(out.join("nets")).unwrap() {
        let bytes = fs::read(entry.unwrap().path().join("model.safetensors")).unwrap();
        let net = pinc_net::PincNet::from_bytes(&bytes).unwrap();
        assert!(pinc_runs::certificate(&net).unwrap().proven["x1"] <= 10.0);
    }
    // A tube around the error of a net leaves integrators as they are, and tries nets with it.
    let tube = "control.uncertainty={ probability = \"worst-case\", net_error = true }";
    let (said, _) = choose_with("tube", &[tube]);
    assert!(said.contains("Use RK") && !rows(&said).is_empty(), "{said}");
    let tight = "training.proven_tolerance={ x1 = 1e-9 }";
    let (said, _) = choose_with("tight", &[tight, "training.time_limit_s=0.2"]);
    for row in rows(&said) {
        assert!(row.contains("training.proven_tolerance: training.time_limit_s is over"), "{said}");
    }
}

#[test]
fn a_stiff_plant_gets_the_method_for_stiff_plants() {
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("fast.toml");
    fs::write(&config, FAST).unwrap();
    let out = dir.path().join("choice");
    let said = table(&choose(&config, &out, &[]));
    assert!(said.contains("Use Rosenbrock with"), "{said}");
    assert!(said.contains("no net was tried and no error of one step measured"), "{said}");
    let chosen = Experiment::load(&out.join("recommended.toml"), &[], &Plants::built_in()).unwrap();
    assert_eq!(chosen.control.unwrap().models, [ModelKind::ROSENBROCK]);
}

#[test]
fn a_plant_without_a_working_loop_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("bolting.toml");
    // x is infinite before the second step ends, whatever u is.
    fs::write(&config, FAST.replace("2e4*(u - x)", "100*(1 + x^2) + 0.01*u")).unwrap();
    let ended = choose(&config, &dir.path().join("choice"), &[]);
    assert_eq!(ended.code, Some(1), "{ended:?}");
    for part in ["no model can be chosen", "no loop succeeded that others", "RK4 x4: "] {
        assert!(ended.stderr.contains(part), "{ended:?}");
    }
    assert!(!ended.stderr.contains("panicked"), "{ended:?}");
}

#[test]
fn what_cannot_be_chosen_for_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("choice");
    let config = dir.path().join("plant.toml");
    let (plant, _) = FAST.split_once("[control]").unwrap();
    fs::write(&config, plant).unwrap();
    choose(&config, &out, &[]).assert_refused(&["no section [control]", "pinc choose"]);
    fs::write(&config, FAST.replace("step_s = 0.1", "")).unwrap();
    choose(&config, &out, &[]).assert_refused(&["no section [model]"]);
    fs::write(&config, FAST).unwrap();
    for (option, value) in
        [("--within", "0%"), ("--within", "much"), ("--within", "-1%"), ("--budget-s", "-3")]
    {
        for words in [vec![option, value], vec![&*format!("{option}={value}")]] {
            let ended = outcome(pinc(&["choose"]).arg(&config).args(words));
            ended.assert_refused(&[option, "expected a"]);
        }
    }
}

/// With no time at all nothing is tried, which a later call makes up for.
#[test]
fn a_run_whose_time_was_up_can_be_resumed() {
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("fast.toml");
    let out = dir.path().join("choice");
    fs::write(&config, FAST.replace("2e4", "2")).unwrap();
    let ended = choose(&config, &out, &["--budget-s=1e-9"]);
    assert_eq!(ended.code, Some(1), "{ended:?}");
    assert!(ended.stderr.contains("the time was up"), "{ended:?}");
    let said = table(&choose(&config, &out, &["--resume"]));
    assert!(said.contains("Use RK"), "{said}");
}
