//! Every size has an upper limit, and texts from outside do no harm: errors are short, plain, and
//! say what was expected.

use crate::common::{Outcome, outcome, pinc, repository, smoke};
use std::fmt::Write;
use std::fs;

/// Checks the smoke config with these values.
fn check_set(sets: &[&str]) -> Outcome {
    let config = repository("configs/smoke/van-der-pol.toml");
    let mut command = pinc(&["check".as_ref(), config.as_os_str()]);
    for set in sets {
        command.args(["--set", set]);
    }
    outcome(&mut command)
}

#[test]
fn sizes_have_limits() {
    for (set, key) in [
        ("model.hidden_layers=9223372036854775807", "`model.hidden_layers`"),
        ("model.neurons=100000", "`model.neurons`"),
        ("model.neurons=5000", "`model`: a net of"),
        ("model.neurons=200", "`training.phases[0].optimizer`"),
        ("identify={parameters=[], substeps=100000}", "`identify.substeps`"),
        ("training.threads=1000000", "`training.threads`"),
        ("training.collocation_points=100000000", "`training.collocation_points`"),
        ("training.initial_points=100000000", "`training.initial_points`"),
        ("training.phases.0.iterations=9223372036854775807", "`training.phases[0].iterations`"),
        ("training.growth.max_points=4294967296", "`training.growth.max_points`"),
        ("validation.scenarios=4294967296", "`validation.scenarios`"),
        ("validation.scenarios=1000000", "`validation`: "),
        ("validation.duration_s=1e12", "`validation.duration_s`"),
        ("validation.subintervals=4294967296", "`validation.subintervals`"),
        ("validation.one_step_points=4294967296", "`validation.one_step_points`"),
        ("prediction.duration_s=1e12", "`prediction.duration_s`"),
        ("prediction.subintervals=4294967296", "`prediction.subintervals`"),
        ("control.duration_s=1e12", "`control.duration_s`"),
        ("control.repetitions=4294967296", "`control.repetitions`"),
        ("control.rk4_substeps=4294967296", "`control.rk4_substeps`"),
        ("control.rk5_substeps=4294967296", "`control.rk5_substeps`"),
        ("control.rosenbrock_substeps=4294967296", "`control.rosenbrock_substeps`"),
        ("control.n2=4294967296", "`control.n2`"),
        ("control.delay_steps=4294967296", "`control.delay_steps`"),
        ("control.sqp.max_iterations=4294967296", "`control.sqp.max_iterations`"),
        ("control.budget_us=1e300", "`control.budget_us`"),
        ("control.q=[1e300, 1.0]", "`control.q`: 1e300 given, expected weights up to 1e100"),
        ("control.q=[[1e300, 0.0], [0.0, 1e300]]", "`control.q`: 1e300 given"),
    ] {
        check_set(&[set]).assert_refused(&[key, "expected"]);
    }
    let loops = ["control.duration_s=5e6", "control.repetitions=11"];
    check_set(&loops).assert_refused(&["`control.repetitions`", "100000000 steps in all at most"]);
}

/// T may be known by the model file alone.
#[test]
fn a_loop_with_a_models_own_step_is_not_endless() {
    let dir = tempfile::tempdir().unwrap();
    let text = smoke();
    let (begin, rest) = text.split_once("[model]").unwrap();
    let (_, control) = rest.split_once("[control]").unwrap();
    let control = control.split("\n[").next().unwrap();
    let control = control.replacen("duration_s = 5.0", "duration_s = 1e12", 1);
    let path = dir.path().join("loop.toml");
    fs::write(&path, format!("{begin}[control]{control}")).unwrap();
    let model = repository("crates/pinc/tests/data/model.safetensors");
    let mut command = pinc(&["control".as_ref(), path.as_os_str(), "--out".as_ref()]);
    outcome(command.arg(dir.path().join("run")).arg("--model").arg(model))
        .assert_refused(&["step length T", "10000000 steps at most"]);
}

#[test]
fn a_table_that_is_set_lies_over_the_defaults() {
    let outcome = check_set(&["data={files=[\"nowhere.csv\"]}"]);
    assert!(!outcome.stderr.contains("held_out"), "{outcome:?}");
    check_set(&["data={file=[\"a.csv\"]}"])
        .assert_refused(&["`data.file`", "did you mean `files`?"]);
}

#[test]
fn names_are_no_formulas_and_tell_cases_apart() {
    let config = |names: [&str; 2]| {
        let [a, b] = names;
        let sweep = format!(
            "[sweep]\ncases = [{{ name = {a:?}, set = {{ \"control.n2\" = 5 }} }}, \
             {{ name = {b:?}, set = {{ \"control.n2\" = 6 }} }}]\n"
        );
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("sweep.toml");
        fs::write(&path, smoke() + &sweep).unwrap();
        outcome(&mut pinc(&["check".as_ref(), path.as_os_str()]))
    };
    for formula in ["=1+1", "+1", "-1", "@SUM(A1)"] {
        config(["a", formula]).assert_refused(&["`sweep.cases[1].name`", "formula"]);
    }
    config(["a", "a"]).assert_refused(&["`sweep.cases[1].name`", "a name that no earlier one has"]);
}

#[test]
fn messages_are_short_and_plain() {
    let escape = check_set(&["training.lambda=\"\u{1b}]0;title\u{7}\u{1b}[31m\""]);
    assert_eq!(escape.code, Some(2));
    assert!(!escape.stderr.contains(['\u{1b}', '\u{7}']), "{escape:?}");
    assert!(escape.stderr.contains("\\u{1b}"), "{escape:?}");

    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("long.toml");
    let name = "n".repeat(10_000_000);
    fs::write(&path, smoke().replacen("[model]", &format!("[model]\n{name} = 1"), 1)).unwrap();
    let outcome = outcome(&mut pinc(&["check".as_ref(), path.as_os_str()]));
    outcome.assert_refused(&["long.toml:", "characters ..]", "neurons"]);
    assert!(outcome.stderr.len() < 5000, "{}", outcome.stderr.len());
}

/// That reading is linear shows in that these are read at all: they once took a quarter of an hour.
#[test]
fn long_configs_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("long.toml");
    let mut references = String::new();
    for i in 1..100_000 {
        writeln!(references, "    {{ start_s = {i}.0, value = [0.0, 0.0] }},").unwrap();
    }
    let first = "    { start_s = 2.5, value = [-0.5, 0.0] },\n";
    assert!(smoke().contains(first));
    fs::write(&path, smoke().replacen(first, &references, 1)).unwrap();
    let set = ["--set", "control.references.99999.value=[1.0]"];
    outcome(pinc(&["check".as_ref(), path.as_os_str()]).args(set))
        .assert_refused(&["`control.references[99999].value`: 1 values given, expected 2"]);

    let mut unknown = smoke();
    for i in 0..20_000 {
        writeln!(unknown, "[unknown{i}]\na = 1").unwrap();
    }
    fs::write(&path, unknown).unwrap();
    outcome(&mut pinc(&["check".as_ref(), path.as_os_str()])).assert_refused(&["unknown key"]);
}
