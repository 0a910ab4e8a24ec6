//! `pinc export`: what is written compiles, and does what `pinc control` does.

use crate::closed::Closed;
use crate::common::{Outcome, outcome, pinc, repository, smoke};
use crate::ways::{Exported, assert_same, compile, drive};
use pinc_config::ModelKind;
use std::fs;
use std::path::Path;
use std::process::Command;

fn export(arguments: &[&str], dir: &Path) -> Outcome {
    outcome(pinc(&["export", "--to", "c"]).args(arguments).current_dir(dir))
}

/// From where it starts, this loop converges by the exact Hessian only, which generated C lacks.
const CURVED: &str = r#"
name = "curved"
preset = "ours"
seed = 1

[plant.expression]
states = ["a", "b", "c"]
inputs = ["u"]

[plant.expression.derivatives]
a = "-0.7633*a + 1.0674*sin(a) + 1.4868*tanh(u)"
b = "-0.231*b + 0.5315*exp(-b^2) - 0.921*exp(-c^2) - 1.0077*tanh(u)"
c = "-0.2116*c - 0.5983*sin(c) - 0.2709*b^2*exp(-b^2) + 0.3653*exp(-a^2) + 0.7549*u*(1 + 0.3*cos(b))"

[control]
models = ["rk4"]
step_s = 0.2
rk4_substeps = 3
duration_s = 3.0
initial_state = [-0.4105, 0.6368, 0.9837]
initial_input = [0.1969]
controlled = ["a", "b", "c"]
references = [{ start_s = 0.0, value = [0.5681, -0.7563, -0.0927] }]
n2 = 11
nu = 5
q = [2.9998, 2.941, 0.9789]
q_terminal = [[6.7441, -1.6313, -1.1452], [-1.6313, 2.8196, 0.5439], [-1.1452, 0.5439, 2.3699]]
r = [0.0154]
weights_profile = "uniform"
input_low = [-1.1738]
input_high = [1.2425]
"#;

#[test]
fn steps_that_generated_c_does_not_solve_are_said() {
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("curved.toml");
    fs::write(&config, CURVED).unwrap();
    let ran =
        outcome(pinc(&["control"]).arg(&config).args(["--out", "ran"]).current_dir(dir.path()));
    assert!(ran.stdout.contains("15 converged"), "{ran:?}");
    for to in ["c", "fmu"] {
        let mut command = pinc(&["export", "--to", to, "--out", to]);
        let exported = outcome(command.arg(&config).current_dir(dir.path()));
        fine(&exported);
        let said = "iteration limit in 14 of the first 15 steps";
        assert!(exported.stderr.contains(said), "{exported:?}");
        // One that solves them all has nothing to say.
        let sets = ["--set", "control.q=[1.0, 0.0, 0.0]", "--set", "control.sqp.tolerance=1e-4"];
        let easy = ["--unset", "control.q_terminal", "--set", "control.r=[1.0]"];
        let mut command = pinc(&["export", "--to", to, "--out", &format!("{to}-easy")]);
        let exported = outcome(command.arg(&config).args(sets).args(easy).current_dir(dir.path()));
        fine(&exported);
        assert!(!exported.stderr.contains("iteration limit"), "{exported:?}");
    }
}

#[track_caller]
fn fine(outcome: &Outcome) {
    assert_eq!(outcome.code, Some(0), "{outcome:?}");
}

/// The exported controller gets the inputs of the loop that `pinc control` ran, and chooses the
/// same inputs with the same statuses and estimates. Returns the number of steps.
#[track_caller]
fn assert_same_loop(config: &Path, kind: ModelKind, more: &[&str], model: &[&str]) -> usize {
    let dir = tempfile::tempdir().unwrap();
    let given = [more, model].concat();
    let closed = Closed::run(dir.path(), config, kind, &given);
    let exported = Exported::of(dir.path(), config, kind, &given, closed.estimates.is_some());
    let answers = exported.unwrap().answers(&closed.told());
    // A mean of the unscented filter is a difference of near points, times a weight of 1e5.
    let unscented = more.iter().any(|set| set.contains("kind=ukf"));
    let allowed = match &closed.estimates {
        None => 1e-9,
        Some(_) if unscented => 1e-6,
        Some(_) => 1e-8,
    };
    assert_same(&format!("{more:?}"), &closed, &answers, allowed);
    for (k, answer) in answers.iter().enumerate() {
        assert_eq!(answer.status, closed.steps[k].status, "{more:?}: step {k}");
        let estimates = closed.estimates.as_ref().map(|table| &table.rows[k].estimate);
        for (found, expected) in answer.estimate.iter().zip(estimates.into_iter().flatten()) {
            assert!((found - expected).abs() < allowed, "{more:?}: step {k}: {found} {expected}");
        }
        assert_eq!(answer.estimate.len(), estimates.map_or(0, Vec::len));
    }
    answers.len()
}

#[test]
fn loops_with_estimators_in_c_match_the_program() {
    let config = repository("configs/estimation/tanks.toml");
    let ukf = "control.estimator.kind=ukf";
    let (mhe, window) = ("control.estimator.kind=mhe", "control.estimator.window=10");
    let of = |what: &str| format!("control.estimator.disturbance={what}");
    let (output, states) = (of("output"), of("{ states = [\"h1\", \"h2\"] }"));
    let none = [
        &of("none"),
        "control.estimator.disturbance_sd=[]",
        "control.estimator.disturbance_initial_sd=[]",
    ];
    let low = "control.estimator.low=[1.0, 1.0, 0.3, 0.7]";
    let (late, held) = ("control.delay_steps=2", "control.initial_input=[1.6, 4.0]");
    for sets in [
        &[][..],
        &[ukf],
        &[&output, late, held],
        &[ukf, "control.estimator.alpha=1.0", &states, late],
        &[mhe, window, low],
        &[mhe, window, &output, late, held],
        &[&states, low],
        &[ukf, &output, low, held],
        &none,
    ] {
        let mut more = vec!["--set", "control.duration_s=900.0"];
        sets.iter().for_each(|set| more.extend(["--set", *set]));
        assert_same_loop(&config, ModelKind::RK4, &more, &[]);
    }
}

/// A plant whose bounds a tube leaves no room between, with a state without bounds in the thousands, and an output
/// that cannot be kept besides.
const CROSSED: &str = r#"
name = "crossed"
preset = "ours"
seed = 1
[plant.expression]
states = ["a", "b", "c"]
inputs = ["u", "v"]
derivatives = { a = "0.3*a + 0.2*b - 0.4*u - 0.5*v", b = "-1.2*b + 0.15*v", c = "0.6*c - 3000*b + 450*u + 1300*v" }
outputs = { d = "a + b" }
[control]
models = ["rk4"]
step_s = 0.25
duration_s = 5.0
n2 = 12
nu = 12
initial_state = [0.25, -0.15, 630.0]
controlled = ["c", "a"]
q = [1.75e-5, 2.3]
r = [4e-5, 0.02]
input_low = [-5.0, -5.0]
input_high = [5.0, 5.0]
state_low = [-0.6, 0.004, -inf]
state_high = [-0.08, 0.285, inf]
output_low = { d = 0.5 }
output_softness = "exact"
max_failed_share = 1.0
references = [{ start_s = 0.0, value = [1970.0, 0.9] }, { start_s = 2.5, value = [2550.0, -0.9] }]
uncertainty = { probability = "worst-case", boxes = { a = 0.03, b = 0.004, c = 29.0 } }
sqp = { qp = "condensed" }
"#;

/// Where `exact` bounds give way to hard ones, C gives the same way in the same units.
#[test]
fn bounds_that_cannot_all_be_kept_give_way_alike_in_c() {
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("crossed.toml");
    fs::write(&config, CROSSED).unwrap();
    assert_eq!(assert_same_loop(&config, ModelKind::RK4, &[], &[]), 20);
}

#[test]
fn the_oscillators_loop_in_c_matches_the_program() {
    let config = repository("configs/van-der-pol/control.toml");
    assert_eq!(assert_same_loop(&config, ModelKind::RK4, &[], &[]), 120);
    // Weighted differences of inputs.
    let released = ["--set", "preset=\"as-released\"", "--set", "control.duration_s=20.0"];
    assert_eq!(assert_same_loop(&config, ModelKind::RK4, &released, &[]), 40);
}

/// Increments count from the config's input, also after a reset; changes of the reference are known
/// in advance or not, and inputs are delayed or not. The self-test would notice another beginning.
#[test]
fn a_loop_in_c_begins_with_the_input_of_the_config() {
    let config = repository("configs/van-der-pol/control.toml");
    let begun = [
        "control.initial_input=[-0.6]",
        "control.increment_low=[-0.15]",
        "control.increment_high=[0.15]",
        "control.max_failed_share=1.0",
        "control.duration_s=20.0",
        // Some steps are slow, and C has no other Hessian.
        "control.sqp.hessian=gauss-newton",
    ];
    for more in [&["control.preview=false"][..], &["control.delay_steps=2"]] {
        let sets = begun.iter().chain(more).flat_map(|set| ["--set", set]).collect::<Vec<_>>();
        assert_eq!(assert_same_loop(&config, ModelKind::RK4, &sets, &[]), 40);
        let dir = tempfile::tempdir().unwrap();
        let given =
            [&[config.to_str().unwrap(), "--only", "rk4", "--out", "c"], &sets[..]].concat();
        fine(&export(&given, dir.path()));
        let sources = dir.path().join("c");
        compile(&sources, "none");
        let ended = outcome(Command::new(sources.join("program")).current_dir(&sources));
        fine(&ended);
        assert!(ended.stdout.contains("20 steps"), "{ended:?}");
    }
}

/// A cart in mm that is held within tightened bounds of position, speed, a sum of both, and input.
const CART: &str = r#"
name = "cart"
preset = "ours"
seed = 1
[plant.expression]
states = ["x", "v"]
inputs = ["u"]
parameters = { drag = 0.2 }
outputs = { far = "x/1000 + 0.3*v + 1e-7*x^2", force = "u + v" }
[plant.expression.derivatives]
x = "1000*v"
v = "-0.0004*x - drag*v*abs(v) + u"
[control]
models = ["rk4"]
step_s = 0.2
duration_s = 12.0
initial_state = [0.0, 0.0]
controlled = ["x"]
q = [1e-5]
r = [0.1]
n2 = 10
nu = 8
state_low = [-500.0, -0.6]
state_high = [1200.0, 0.6]
state_softness = "exact"
output_high = { far = 1.2 }
output_softness = "exact"
input_low = [-1.0]
input_high = [1.0]
references = [{ start_s = 0.0, value = [1300.0] }, { start_s = 6.0, value = [-600.0] }]
[control.uncertainty]
probability = 0.95
process_sd = [3.0, 0.01]
boxes = { v = 0.01 }
"#;

#[test]
fn a_loop_in_c_keeps_the_distance_of_its_tube() {
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("cart.toml");
    fs::write(&config, CART).unwrap();
    for more in [
        &[][..],
        &["control.uncertainty.feedback=\"none\"", "control.nu=2"],
        &["control.uncertainty.feedback=[[-0.5, -0.7]]", "control.output_high={}"],
        &[
            "control.uncertainty.feedback=[[-0.5, -0.7]]",
            "control.uncertainty.tighten_inputs=false",
        ],
        &["control.uncertainty.boxes={}", "control.initial_input=[0.4]", "control.preview=false"],
        &["control.uncertainty.process_sd=[]", "control.uncertainty.probability=\"worst-case\""],
        // The first guess, a plan at rest that moves, does not end where its last interval does.
        &[
            "plant.expression.outputs.far=\"0.3*v + x^3/1e9\"",
            "control.initial_state=[700.0, 0.5]",
            "control.n2=4",
            "control.nu=4",
        ],
        // So much that nothing is left between some bounds, or that a distance overflows.
        &["control.uncertainty.process_sd=[1e200, 0.01]", "control.max_failed_share=1.0"],
        &["control.uncertainty.boxes={ v = 0.3 }", "control.max_failed_share=1.0"],
    ] {
        let sets = more.iter().flat_map(|set| ["--set", set]).collect::<Vec<_>>();
        assert_eq!(assert_same_loop(&config, ModelKind::RK4, &sets, &[]), 60);
    }
    let depends = "control.output_high={ force = 2.0 }";
    let depends = export(&["cart.toml", "--set", depends], dir.path());
    depends.assert_refused(&["control.uncertainty", "outputs that depend on the input"]);
    for (set, instead) in [
        ("control.uncertainty.parameters={ drag = [0.1, 0.3] }", "use process_sd and boxes"),
        ("control.uncertainty.tightenings=2", "use 1 of them"),
    ] {
        let refused = export(&["cart.toml", "--set", set], dir.path());
        refused.assert_refused(&[set.split('=').next().unwrap(), instead]);
    }
    // The slope of a bounded output may depend on what is estimated since the plan was made.
    let estimator = "control.estimator={ kind = \"ekf\", process_sd = [1.0, 0.01], measurement_sd = [1.0], \
        initial_estimate = [0.0, 0.0], initial_sd = [1.0, 0.1], disturbance = \"output\", \
        disturbance_sd = [0.1], disturbance_initial_sd = [1.0] }";
    let measurement = "control.measurement={ measured = [\"x\"], noise_sd = [1.0] }";
    let sets = ["cart.toml", "--set", measurement, "--set", estimator];
    export(&sets, dir.path()).assert_refused(&["bounds on outputs", "output disturbance"]);
}

#[test]
fn the_tanks_loop_in_c_matches_the_program() {
    let config = repository("configs/four-tanks/control.toml");
    assert_eq!(assert_same_loop(&config, ModelKind::RK4, &[], &[]), 240);
}

/// A controller with a trained net, which is trained once.
#[test]
fn a_loop_with_a_net_in_c_matches_the_program() {
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("smoke.toml");
    fs::write(&config, smoke()).unwrap();
    let trained =
        pinc(&["train", "smoke.toml", "--quiet", "--out", "net"]).current_dir(dir.path()).status();
    assert!(trained.unwrap().success());
    let model = dir.path().join("net/model.safetensors");
    let model = ["--model", model.to_str().unwrap()];
    assert_eq!(assert_same_loop(&config, ModelKind::Pinc, &[], &model), 10);
    // Increments so small that bounds on states cannot be met.
    let slow = ["--set", "control.increment_high=[0.1]", "--set", "control.max_failed_share=1.0"];
    assert_eq!(assert_same_loop(&config, ModelKind::Pinc, &slow, &model), 10);
}

#[test]
fn an_exported_net_passes_its_self_test() {
    let dir = tempfile::tempdir().unwrap();
    let model = repository("crates/pinc/tests/data/model.safetensors");
    let exported = export(&["--model", model.to_str().unwrap()], dir.path());
    fine(&exported);
    assert_eq!(exported.stdout.trim(), "exports/model-c");
    let out = dir.path().join("exports/model-c");
    compile(&out, "none");
    let lines = drive(&out, String::new());
    assert!(lines[0].starts_with("model: 12 cases"), "{lines:?}");
    assert!(fs::read_to_string(out.join("README.md")).unwrap().contains("model_net_step"));
}

#[test]
fn what_cannot_be_exported_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let config = |name: &str| repository(name).to_str().unwrap().to_owned();
    let refused = |arguments: &[&str], parts: &[&str]| {
        export(arguments, dir.path()).assert_refused(parts);
        assert!(!dir.path().join("exports").exists());
    };
    let servo = config("configs/costly/servo.toml");
    refused(&[&servo, "--only", "rosenbrock"], &["`rosenbrock`", "hydraulic-servo", "`rk4`"]);
    let oscillator = config("configs/van-der-pol/control.toml");
    let method = "control.sqp.qp=\"clarabel\"";
    refused(&[&oscillator, "--only", "rk4", "--set", method], &["QP method", "condensed"]);
    let real_time = "control.sqp.real_time=true";
    refused(&[&oscillator, "--only", "rk4", "--set", real_time], &["real-time"]);
    let missing = ["--only: ", "control.toml: control.models does not contain `rk5`, it has"];
    refused(&[&oscillator, "--only", "rk5"], &missing);
    refused(&[&oscillator], &["--model FILE"]);
    refused(&[&oscillator, "--only", "rk4", "--name", "2nd"], &["`2nd`", "a letter"]);
    let training = config("configs/van-der-pol/training.toml");
    refused(&[&training, "--only", "rk4"], &["[control]", "pinc export"]);
    let net = ["--model", "none.safetensors"];
    refused(&net, &["none.safetensors", "cannot be read"]);
    for (more, parts) in [
        (&["--double"][..], ["--double", "`--to onnx`"]),
        (&["--fmi3"], ["--fmi3", "`--to fmu`"]),
        (&["--set", "no.such.key=1"], ["--set", "a config"]),
        (&["--unset", "control.n2"], ["--unset", "a config"]),
    ] {
        refused(&[&net[..], more].concat(), &parts);
    }
}

/// Every target writes its files; FMUs are archives with sources and, where this machine can make
/// one, a binary.
#[test]
fn all_targets_are_written() {
    let dir = tempfile::tempdir().unwrap();
    let model = repository("crates/pinc/tests/data/model.safetensors");
    let config = repository("configs/van-der-pol/control.toml");
    let (model, config) = (model.to_str().unwrap(), config.to_str().unwrap());
    let export = |arguments: &[&str]| {
        let mut command = pinc(&["export", "--name", "it", "--out", "out", "--to"]);
        outcome(command.args(arguments).current_dir(dir.path()))
    };
    let read = |file: &str| fs::read(dir.path().join("out").join(file)).unwrap();
    let contains = |bytes: &[u8], part: &str| {
        bytes.windows(part.len()).any(|window| window == part.as_bytes())
    };
    fine(&export(&["casadi", "--model", model]));
    assert!(contains(&read("it_casadi.c"), "jac_jac_it"));
    fine(&export(&["onnx", "--model", model]));
    let single = read("it.onnx");
    fine(&export(&["onnx", "--model", model, "--double"]));
    // 80 weights and biases with four bytes more, less the note of what rounding takes.
    assert!(read("it.onnx").len() >= single.len() + 320 - 100);
    assert!(contains(&single, "rounding") && !contains(&read("it.onnx"), "rounding"));
    for arguments in [
        &["fmu", "--model", model][..],
        &["fmu", config, "--only", "rk4"],
        &["fmu", config, "--plant"],
        &["fmu", "--model", model, "--fmi3"],
    ] {
        fine(&export(arguments));
        let fmu = read("it.fmu");
        assert!(fmu.starts_with(b"PK"));
        let binary = cfg!(all(target_os = "linux", target_arch = "x86_64"));
        let folder = if arguments.contains(&"--fmi3") { "x86_64-linux" } else { "linux64" };
        let place = format!("binaries/{folder}/it.so");
        assert_eq!(contains(&fmu, &place), binary, "{arguments:?}");
        assert!(contains(&fmu, "sources/it_fmu.c") && contains(&fmu, "canHandleVariable"));
    }
    // Without a compiler there is no FMU, rather than one without its binary.
    let fmu = dir.path().join("out-without/it.fmu");
    let arguments = ["export", "--to", "fmu", "--model", model, "--name", "it", "--out"];
    let mut without = pinc(&arguments);
    without.arg(fmu.parent().unwrap()).env("PATH", dir.path());
    if cfg!(all(target_os = "linux", target_arch = "x86_64")) {
        outcome(&mut without).assert_refused(&["export", "`cc` failed", "No such file"]);
        assert!(!fmu.exists());
    }
    export(&["onnx", config, "--only", "rk4"]).assert_refused(&["--to onnx", "takes a net"]);
    export(&["casadi", config, "--plant"]).assert_refused(&["--to casadi", "takes no plant"]);
    for set in [
        "control.delay_steps=2",
        "control.loads=[{ start_s = 0.0, rates = { x1 = 0.1 } }]",
        "control.plant_schedule=[{ start_s = 0.0, values = { mu = 1.5 } }]",
    ] {
        let key = set.split('=').next().unwrap();
        export(&["fmu", config, "--plant", "--set", set])
            .assert_refused(&[key, "the FMU of a plant has no"]);
    }
    let outside = "control.outside_domain=refuse";
    let arguments = ["c", config, "--only", "pinc", "--model", model, "--set", outside];
    export(&arguments).assert_refused(&["control.outside_domain", "`pinc serve`"]);
}

/// An export into a directory with files of one's own of these names leaves them alone; it replaces
/// those of an earlier one.
#[test]
fn an_export_replaces_no_file_but_its_own() {
    let dir = tempfile::tempdir().unwrap();
    let config = repository("configs/smoke/rk4-only.toml");
    let export = |name: &str| {
        let mut command = pinc(&["export", "--to", "c", "--name", name, "--out"]);
        outcome(command.arg(dir.path()).arg(&config))
    };
    for own in ["README.md", "Makefile", "CMakeLists.txt"] {
        let path = dir.path().join(own);
        fs::write(&path, "my own").unwrap();
        export("tank").assert_refused(&[own, "not of an earlier export of tank", "--out"]);
        // A name that is part of the file's is none of an earlier export.
        export("e").assert_refused(&[own, "not of an earlier export of e"]);
        assert_eq!(fs::read_to_string(&path).unwrap(), "my own");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
        fs::remove_file(&path).unwrap();
    }
    for _ in 0..2 {
        let found = export("tank");
        assert_eq!(found.code, Some(0), "{found:?}");
    }
    export("other").assert_refused(&["not of an earlier export of other"]);
}
