//! The timing of signals in a closed loop, and its messages.

use pinc_config::{Experiment, ModelKind, Plants};
use pinc_record::{ControlMetrics, ControlReader, ControlRow, Metrics, file};
use pinc_runs::{Follow, LiveController, Options, Verbosity};
use pinc_sensitivity::{Given, Regularity};
use std::fs;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// A lag that is to go from 1 to 0, with an input too weak to matter.
const DRIFT: &str = r#"
name = "drift"
preset = "ours"
seed = 1
[plant.expression]
states = [{ name = "x", unit = "m" }]
inputs = ["u"]
parameters = { a = 0.0 }
derivatives = { x = "u - a*x" }
[control]
models = ["rk4", "rk5"]
step_s = 1.0
duration_s = 6.0
initial_state = [0.0]
controlled = ["x"]
q = [1.0]
r = [1.0]
n2 = 2
nu = 2
input_low = [-1e-9]
input_high = [1e-9]
references = [{ start_s = 0.0, value = [0.0] }]
repetitions = 1
"#;

fn experiment(text: &str, sets: &[&str]) -> Experiment {
    let sets: Vec<_> = sets.iter().map(|set| (*set).to_owned()).collect();
    Experiment::parse(Path::new("test.toml"), text, &sets, &Plants::built_in()).unwrap()
}

/// Runs the loops of a config in `dir`.
fn control(dir: &Path, experiment: &Experiment, resume: bool, only: Option<ModelKind>) -> Metrics {
    let options = Options {
        resume,
        verbosity: Verbosity::Quiet,
        interrupt: &AtomicBool::new(false),
        arguments: &[],
    };
    pinc_runs::control(experiment, dir, &options, None, only).unwrap().metrics().clone()
}

/// The loop with RK4 alone: its metrics and its trace.
fn run(text: &str, sets: &[&str]) -> (ControlMetrics, Vec<ControlRow>) {
    let dir = tempfile::tempdir().unwrap();
    let experiment = experiment(text, sets);
    let metrics = control(dir.path(), &experiment, false, Some(ModelKind::RK4));
    let path = dir.path().join(file::control(ModelKind::RK4, 1));
    let states = experiment.plant.variables().states.len();
    let reader = ControlReader::open(&path, [states, 1], &["x".to_owned()]).unwrap().unwrap();
    (metrics.control[0].clone(), reader.collect::<Result<_, _>>().unwrap())
}

/// The states at the ends of steps.
fn at_steps(rows: &[ControlRow]) -> Vec<f64> {
    rows.iter().step_by(9).map(|row| row.state[0]).collect()
}

#[track_caller]
fn near(found: &[f64], expected: &[f64]) {
    let off = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(found.len() == expected.len() && off < 1e-7, "{found:?} {expected:?}");
}

#[test]
fn a_load_acts_from_the_step_that_begins_with_it() {
    let load = |start: &str, end: &str| {
        let load = format!("control.loads=[{{ start_s = {start}{end}, rates = {{ x = 1.0 }} }}]");
        at_steps(&run(DRIFT, &[&load]).1)
    };
    near(&load("0.0", ""), &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    near(&load("1.0", ""), &[0.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
    near(&load("0.0", ", end_s = 2.0"), &[0.0, 1.0, 2.0, 2.0, 2.0, 2.0, 2.0]);
    near(&load("2.0", ", end_s = 3.0"), &[0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]);
}

/// The trace with a plant that changes at 3 s is the one without a change up to there, to the bit,
/// and then decays.
#[test]
fn a_plant_changes_at_the_step_given() {
    let begin = "control.initial_state=[1.0]";
    let change = "control.plant_schedule=[{ start_s = 3.0, values = { a = 0.5 } }]";
    let (same, changed) = (run(DRIFT, &[begin]).1, run(DRIFT, &[begin, change]).1);
    let first =
        (0..same.len()).find(|&i| same[i].state[0].to_bits() != changed[i].state[0].to_bits());
    // Row 27 is the end of step 2: the first that differs is the one after it.
    assert_eq!(first, Some(28));
    let decay = |steps: f64| (-0.5 * steps).exp();
    near(&at_steps(&changed), &[1.0, 1.0, 1.0, 1.0, decay(1.0), decay(2.0), decay(3.0)]);
}

/// One percent of the largest error, 2 at the start.
#[test]
fn a_quantity_is_settled_within_a_hundredth_of_its_largest_error() {
    let (metrics, rows) =
        run(DRIFT, &["control.initial_state=[2.0]", "plant.expression.parameters.a=2.1"]);
    let within = metrics.references.settled_within["x"];
    assert!((within - 0.02).abs() < 1e-12, "{within}");
    // exp(-2.1 * 2) = 0.015 is within two hundredths only, exp(-2.1 * 3) within one.
    assert!((rows[18].state[0] / 2.0 - 0.015).abs() < 1e-3, "{}", rows[18].state[0]);
    assert_eq!(metrics.references.settle_s, [Some(3.0)]);
}

/// The band is a hundredth of the largest error, of x = 2 exp(-0.1 t) after 6 s, whatever the bounds.
#[test]
fn wide_bounds_do_not_settle_a_quantity() {
    let sets = |wide: &str| {
        [
            "control.references=[{ start_s = 0.0, value = [2.0] }]".to_owned(),
            "control.initial_state=[2.0]".to_owned(),
            format!("control.state_low=[-{wide}]"),
            format!("control.state_high=[{wide}]"),
            "control.input_low=[0.0]".to_owned(),
            "control.input_high=[0.0]".to_owned(),
            "plant.expression.parameters.a=0.1".to_owned(),
        ]
    };
    for wide in ["10.0", "1e3", "1e6"] {
        let sets = sets(wide);
        let sets: Vec<&str> = sets.iter().map(String::as_str).collect();
        let (metrics, _) = run(DRIFT, &sets);
        assert!(metrics.references.settled_within["x"] <= 0.02, "{wide}: {:?}", metrics.references);
        let band = 0.02 * (1.0 - (-0.6_f64).exp());
        near(&[metrics.references.settled_within["x"]], &[band]);
        assert_eq!(metrics.references.settle_s, [None], "{wide}");
    }
}

/// Bounds that stand for none do not make units in which nothing is left to do.
#[test]
fn bounds_far_away_change_nothing() {
    let inputs = ["control.input_low=[-1.0]", "control.input_high=[1.0]"];
    let references =
        "control.references=[{ start_s = 0.0, value = [0.5] }, { start_s = 3.0, value = [-2.0] }]";
    let with = |more: &[&str]| {
        let sets = [&inputs[..], &[references], more].concat();
        let (metrics, rows) = run(DRIFT, &sets);
        assert_eq!(metrics.status.get("converged"), Some(&6), "{more:?}: {:?}", metrics.status);
        at_steps(&rows)
    };
    let free = with(&[]);
    for wide in ["1e5", "1e8", "1e12", "1e30"] {
        let bounds = ["low=[-", "high=["].map(|side| format!("control.state_{side}{wide}]"));
        let bounded = with(&[&bounds[0], &bounds[1]]);
        near(&bounded, &free);
    }
}

/// A bound is broken by the plant that the model knows nothing of: which one, by how much, when.
#[test]
fn a_broken_bound_is_named_with_its_unit_and_time() {
    let load = "control.loads=[{ start_s = 0.0, end_s = 4.0, rates = { x = 1.0 } }]";
    let bounds = ["control.state_low=[-1.0]", "control.state_high=[2.5]"];
    let (metrics, _) = run(DRIFT, &[load, bounds[0], bounds[1]]);
    let [broken] = &metrics.violations[..] else { panic!("{:?}", metrics.violations) };
    assert_eq!((&*broken.of, &*broken.unit, &*broken.side), ("x", "m", "high"));
    near(&[broken.bound, broken.amount, broken.at_steps, broken.share], &[2.5, 1.5, 1.5, 0.375]);
    assert!((broken.time_s - 4.0).abs() < 2.0 && broken.hard, "{broken:?}");
    assert_eq!(metrics.max_violation_of.as_ref(), Some(broken));
    assert_eq!(metrics.max_violation.to_bits(), broken.amount.to_bits());
    let (within, _) = run(DRIFT, &[bounds[0], bounds[1]]);
    assert_eq!((within.violations.len(), within.max_violation_of), (0, None));
}

/// If one of two loops is done, the other is not left out.
#[test]
fn a_run_is_resumed_with_the_loop_that_is_missing() {
    let dir = tempfile::tempdir().unwrap();
    let experiment = experiment(DRIFT, &["control.initial_state=[1.0]"]);
    let whole = control(dir.path(), &experiment, false, None);
    let kinds = |metrics: &Metrics| metrics.control.iter().map(|of| of.model).collect::<Vec<_>>();
    assert_eq!(kinds(&whole), [ModelKind::RK4, ModelKind::RK5]);
    let path = dir.path().join("metrics.json");
    let mut text: serde_json::Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    text["control"].as_array_mut().unwrap().truncate(1);
    fs::write(&path, serde_json::to_vec(&text).unwrap()).unwrap();
    let second = dir.path().join(file::control(ModelKind::RK5, 2));
    fs::remove_file(&second).unwrap();
    let resumed = control(dir.path(), &experiment, true, None);
    assert_eq!(kinds(&resumed), [ModelKind::RK4, ModelKind::RK5]);
    assert!(second.exists());
    for (one, other) in whole.control.iter().zip(&resumed.control) {
        assert_eq!(one.iae_dense_sum.to_bits(), other.iae_dense_sum.to_bits());
    }
}

/// A lag whose reading has the input in it, begun where the first estimate is right.
const READ: &str = r#"
name = "read"
preset = "ours"
seed = 1
[plant.expression]
states = ["x"]
inputs = ["u"]
derivatives = { x = "0.1*(u - x)" }
outputs = { y = "x + 2*u" }
[control]
models = ["rk4"]
step_s = 1.0
duration_s = 6.0
initial_state = [0.5]
initial_input = [1.5]
controlled = ["x"]
q = [1.0]
r = [0.1]
n2 = 4
nu = 4
input_low = [-2.0]
input_high = [2.0]
references = [{ start_s = 0.0, value = [1.0] }]
repetitions = 1
[control.measurement]
measured = ["y"]
[control.estimator]
kind = "ekf"
process_sd = [0.01]
measurement_sd = [0.1]
initial_estimate = [0.5]
initial_sd = [1.0]
"#;

/// In the loop, step by step and over recorded data alike, the first reading is expected under the
/// initial input: 0.5 + 2 * 1.5.
#[test]
fn the_first_reading_is_under_the_initial_input() {
    for kind in ["ekf", "ukf", "mhe"] {
        let kind = format!("control.estimator.kind={kind:?}");
        let window = if kind.contains("mhe") { "control.estimator.window=3" } else { "seed=1" };
        let experiment = experiment(READ, &[&kind, window]);
        let dir = tempfile::tempdir().unwrap();
        control(dir.path(), &experiment, false, None);
        let path = dir.path().join(file::estimates(ModelKind::RK4, 1));
        let text = fs::read_to_string(path).unwrap();
        let column = |name: &str| {
            let mut rows = csv::Reader::from_reader(text.as_bytes());
            let place = rows.headers().unwrap().iter().position(|head| head == name).unwrap();
            rows.records().map(|row| row.unwrap()[place].parse().unwrap()).collect::<Vec<f64>>()
        };
        // The model is the plant: nothing is ever to be corrected.
        near(&column("y_y")[..1], &[3.5]);
        near(&column("innovation_y"), &[0.0; 6]);

        let mut live = LiveController::new(&experiment, None, None, "serve").unwrap();
        for _ in 0..2 {
            near(live.step(&[3.5], Follow::Config, None).unwrap().x, &[0.5]);
            live.reset().unwrap();
        }
    }
}

/// The target moves with the references and the estimate; derivatives would leave that out.
#[test]
fn a_plan_to_a_target_has_no_derivatives() {
    for target in [false, true] {
        let experiment = experiment(READ, &[&format!("control.target={target}")]);
        let mut live = LiveController::new(&experiment, None, None, "it").unwrap();
        live.step(&[3.5], Follow::Config, None).unwrap();
        let refused = live.sensitivity(None).err().map(|error| error.to_string());
        assert_eq!(refused.is_some_and(|error| error.contains("`control.target`")), target);
    }
}

/// Without an initial input the first row of recorded data is read under its own.
#[test]
fn the_first_row_of_recorded_data_is_read_under_the_input_before_it() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data.csv");
    fs::write(&data, "t,u,y_y\n0,-1,3.5\n1,2,\n").unwrap();
    let filtered = |text: &str| {
        let output = dir.path().join("estimates.csv");
        let experiment = experiment(text, &["control.estimator.initial_sd=[10.0]"]);
        pinc_runs::estimate(&experiment, &data, Some(&output), None, None).unwrap();
        let text = fs::read_to_string(output).unwrap();
        let row = text.lines().nth(1).unwrap();
        row.split(',').nth(1).unwrap().parse::<f64>().unwrap()
    };
    // The reading is believed up to 0.01 / 100.01.
    let expected = |x: f64| 0.5 + (x - 0.5) * 100.0 / 100.01;
    near(&[filtered(READ)], &[expected(3.5 - 2.0 * 1.5)]);
    let unknown = READ.replace("initial_input = [1.5]\n", "");
    near(&[filtered(&unknown)], &[expected(3.5 + 2.0)]);
}

#[test]
fn recorded_data_have_a_row_per_step() {
    let dir = tempfile::tempdir().unwrap();
    let data = dir.path().join("data.csv");
    let experiment = experiment(READ, &[]);
    let step_s = experiment.sample_time_s().unwrap();
    for (late, fits) in [(0.0, true), (1e-9, true), (1e-3, false), (-1e-3, false)] {
        let second = step_s * (1.0 + late);
        fs::write(&data, format!("t,u,y_y\n0,-1,3.5\n{second},2,\n")).unwrap();
        let found = pinc_runs::estimate(&experiment, &data, None, None, None);
        let Err(error) = found else {
            assert!(fits, "{late}");
            continue;
        };
        let error = error.to_string();
        assert!(
            !fits && error.contains("csv:3: column `t`") && error.contains("steps of T"),
            "{error}"
        );
    }
}

/// To save a controller is no step: with a tube, and with a step prepared ahead, too.
#[test]
fn asking_for_the_state_changes_no_input() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    for set in [
        "control.uncertainty={ probability = \"worst-case\", boxes = { x1 = 0.01, x2 = 0.01 } }",
        "control.sqp.real_time=true",
    ] {
        let (config, sets) = (root.join("configs/van-der-pol/control.toml"), [set.to_owned()]);
        let experiment = Experiment::load(&config, &sets, &Plants::built_in()).unwrap();
        let make = || LiveController::new(&experiment, None, Some(ModelKind::RK4), "the test");
        let mut both = [make().unwrap(), make().unwrap()];
        for k in 0..12_u8 {
            let t = 0.5 * f64::from(k);
            let x = [0.8 * t.cos(), -0.7 * (1.1 * t).sin()];
            let [asked, left] = both.each_mut().map(|controller| {
                let u = controller.step(&x, Follow::Config, None).unwrap().u[0];
                controller.prepare();
                u
            });
            assert_eq!(asked.to_bits(), left.to_bits(), "{set}, step {k}: {asked} {left}");
            both[0].state();
        }
    }
}

/// A controller in the state of another one knows the input from which the next plan begins.
#[test]
fn the_plan_after_a_saved_state_has_derivatives() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let config = root.join("configs/van-der-pol/control.toml");
    let experiment = Experiment::load(&config, &[], &Plants::built_in()).unwrap();
    let make = || LiveController::new(&experiment, None, Some(ModelKind::RK4), "the test").unwrap();
    let (mut first, mut second) = (make(), make());
    first.step(&[0.3, 0.1], Follow::Config, None).unwrap();
    second.set_state(&first.state()).unwrap();
    let [of_first, of_second] = [first, second].map(|mut live| {
        live.step(&[0.31, 0.12], Follow::Config, None).unwrap();
        let mut sensitivity = live.sensitivity(None).unwrap();
        assert_eq!(sensitivity.regularity(), Regularity::Regular);
        sensitivity.adjoint(&[], &[1.0]).unwrap().get(Given::State).to_vec()
    });
    near(&of_first, &of_second);
}

/// A tank of unknown gain, to be filled to a bound.
const TANK: &str = r#"
name = "tank"
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
duration_s = 4.0
initial_state = [0.5]
initial_input = [0.5]
controlled = ["x"]
q = [10.0]
r = [0.01]
n2 = 6
nu = 6
state_high = [1.5]
input_low = [0.0]
input_high = [10.0]
references = [{ start_s = 0.0, value = [1.5] }]
repetitions = 1
measurement = { measured = ["x"] }
[control.estimator]
kind = "ekf"
process_sd = [0.0]
measurement_sd = [0.01]
initial_estimate = [0.5]
initial_sd = [0.01]
parameters = [{ name = "k", initial = 1.0, initial_sd = 0.15, drift_sd = 0.0 }]
[control.uncertainty]
probability = 0.95
estimate = true
tightenings = 20
"#;

/// With a = exp(-T/10) the level after a step is a x + (1 - a) k u, of variance
/// a^2 var x + ((1 - a) u)^2 var k.
#[test]
fn a_tube_counts_what_the_estimator_does_not_know_of_a_parameter() {
    let (a, z) = ((-0.2_f64).exp(), 1.644_853_626_951_472_2);
    let variance_of_x = 0.01_f64.powi(2) / 2.0;
    let highest = |u: f64| {
        let sd = (a * a * variance_of_x + ((1.0 - a) * u * 0.15).powi(2)).sqrt();
        a * 0.5 + (1.0 - a) * u + z * sd
    };
    // A first step has no plan before it, along which the bounds would be tightened.
    for sets in [&[][..], &["control.uncertainty.tightenings=1"]] {
        let (_, rows) = run(TANK, sets);
        let experiment = experiment(TANK, sets);
        let mut live = LiveController::new(&experiment, None, Some(ModelKind::RK4), "it").unwrap();
        let of_live = live.step(&[0.5], Follow::Config, None).unwrap().u[0];
        for u in [rows[0].input[0], of_live] {
            assert!((highest(u) - 1.5).abs() < 1e-6, "{sets:?} {u}: {}", highest(u));
        }
    }
}

#[test]
fn noise_follows_its_own_seed() {
    let input = |sets: &[&str]| -> Vec<u64> {
        let noisy = ["control.measurement.noise_sd=[0.05]", "--unset control.uncertainty"];
        let (_, rows) = run(TANK, &[&noisy[..], sets].concat());
        rows.iter().map(|row| row.input[0].to_bits()).collect()
    };
    let own = input(&[]);
    assert_eq!(input(&["control.noise_seed=1"]), own);
    assert_eq!(input(&["control.noise_seed=1", "seed=7"]), own);
    assert_ne!(input(&["control.noise_seed=2"]), own);
}

/// A stirred-tank reactor for three rates, with bounds on increments and one on a state that is active.
const TREE: &str = r#"
name = "tree"
preset = "ours"
seed = 1
[plant.expression]
states = ["a", "b", "reactor", "jacket"]
inputs = ["flow", "heat"]
parameters = { rate = 1.287e12 }
[plant.expression.let]
kelvin = "reactor + 273.15"
k1 = "rate*exp(-9758.3/kelvin)*a"
k2 = "1.287e12*exp(-9758.3/kelvin)*b"
k3 = "9.043e9*exp(-8560.0/kelvin)*a^2"
wall = "866.88*(reactor - jacket)"
[plant.expression.derivatives]
a = "(flow*(5.1 - a) - k1 - k3)/3600"
b = "(k1 - k2 - flow*b)/3600"
reactor = "((11.0*k2 + 41.85*k3 - 4.2*k1)/2.812 + flow*(130 - reactor) - wall/28.15)/3600"
jacket = "(heat + wall)/36000"
[control]
models = ["rk4"]
step_s = 60.0
rk4_substeps = 4
duration_s = 600.0
initial_state = [2.14, 1.09, 114.2, 112.9]
initial_input = [14.19, -1113.5]
controlled = ["reactor", "b"]
q = [50.0, 4e5]
r = [50.0, 1e-3]
n2 = 10
nu = 10
input_low = [3.0, -8500.0]
input_high = [35.0, 0.0]
increment_low = [-5.0, -1000.0]
increment_high = [5.0, 1000.0]
state_low = [0.1, 0.1, 80.0, 60.0]
state_high = [4.0, 2.0, 116.5, 140.0]
state_softness = "exact"
references = [{ start_s = 0.0, value = [116.0, 1.05] }]
repetitions = 1
scenarios = { values = { rate = [1.287e12, 1.35135e12, 1.22265e12] } }
"#;

/// A factor of all weights moves no minimum, and leaves no step without one.
#[test]
fn trees_are_solved_at_any_scale_of_the_weights() {
    let inputs = |factor: f64| {
        let [q, r] = [[50.0, 4e5], [50.0, 1e-3]].map(|weights| weights.map(|w| w * factor));
        let sets = [format!("control.q={q:?}"), format!("control.r={r:?}")];
        let experiment = experiment(TREE, &[&sets[0], &sets[1]]);
        let dir = tempfile::tempdir().unwrap();
        let metrics = control(dir.path(), &experiment, false, None);
        assert_eq!(metrics.control[0].status.get("converged"), Some(&10), "{factor}");
        metrics.control[0].iae
    };
    let expected = inputs(1e-3);
    for factor in [1.0, 1e3, 1e5] {
        assert!((inputs(factor) / expected - 1.0).abs() < 1e-5, "{factor}");
    }
}
