//! A plant as a process, from its samples to the loop: this program is the plant, if its argument
//! says so, and else the tests.

#![expect(clippy::print_stdout, reason = "it says which tests it runs, and answers as a process")]

use pinc::bench::{ChooseOptions, Timed, choose};
use pinc_config::{Experiment, ModelKind, Plants};
use pinc_export::FmiVersion;
use pinc_ode::{DynPlant, DynRhs, Model, Rk4, Simulator};
use pinc_plants::VanDerPol;
use pinc_record::{ControlMetrics, RunDir};
use pinc_runs::{Options, Target, Verbosity, check, export_plant, run};
use serde_json::{Value, json};
use std::io::{BufRead, Write, stdin, stdout};
use std::path::Path;
use std::process::ExitCode;
use std::sync::atomic::AtomicBool;

/// The last argument of this program as a plant: the oscillator, or one of its defects.
const PLANT: &str = "plant";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().collect();
    if let [_, first, kind] = &arguments[..]
        && first == PLANT
    {
        be_the_plant(kind);
        return ExitCode::SUCCESS;
    }
    // `cargo test -- --list` and filters work as for other test programs.
    let filter = arguments.iter().skip(1).find(|argument| !argument.starts_with('-'));
    for (name, test) in TESTS {
        if filter.is_none_or(|filter| name.contains(filter)) {
            println!("test {name}");
            test();
        }
    }
    ExitCode::SUCCESS
}

const TESTS: [(&str, fn()); 8] = [
    ("it_starts_only_where_it_is_allowed", it_starts_only_where_it_is_allowed),
    ("many_requests_are_answered_in_order", many_requests_are_answered_in_order),
    ("what_is_no_answer_is_explained", what_is_no_answer_is_explained),
    ("wrong_answers_to_the_controller_end_the_run", wrong_answers_to_the_controller_end_the_run),
    ("an_exported_plant_is_a_plant", an_exported_plant_is_a_plant),
    ("outputs_of_an_fmu_are_controlled", outputs_of_an_fmu_are_controlled),
    ("it_is_distilled_and_controlled_like_its_equation", it_is_distilled_and_controlled),
    ("a_net_is_chosen_beside_it", a_net_is_chosen_beside_it),
];

/// Answers the requests on standard input.
fn be_the_plant(kind: &str) {
    let mut output = stdout().lock();
    for (number, line) in stdin().lock().lines().enumerate() {
        let request: Value = serde_json::from_str(&line.unwrap()).unwrap();
        let numbers = |key: &str| -> Vec<f64> {
            request[key].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
        };
        let (x, u, t) = (numbers("x"), numbers("u"), request["t"].as_f64().unwrap());
        let mut next = vec![0.0; 2];
        Rk4::new(VanDerPol::default(), t, 64).step(&x, &u, &[], &mut next);
        let answer = match kind {
            "words" => json!("here I am"),
            "short" => json!({ "x": [1.0] }),
            "fails" if x[0] > 2.0 => json!({ "error": "x1 is beyond 2" }),
            "ends" if number == 2 => return,
            "miscounts" if number >= 60 => json!({ "x": next, "id": 0 }),
            // Until it is ended.
            "hangs" if number == 2 => loop {
                std::thread::park();
            },
            _ => json!({ "x": next }),
        };
        writeln!(output, "{answer}").unwrap();
        output.flush().unwrap();
    }
}

/// A config of the oscillator, whose plant is `plant`.
fn config(plant: &str) -> String {
    format!(
        r#"
name = "black-box"
preset = "ours"
seed = 1
[plant]
{plant}
[model]
horizon_s = 0.5
hidden_layers = 2
neurons = 12
[domain]
state_low = [-3.0, -4.35]
state_high = [3.0, 4.35]
input_low = [-1.0]
input_high = [1.0]
[training]
source = "integrator"
collocation_points = 512
[validation]
duration_s = 5.0
one_step_points = 512
[validation.domain]
state_low = [-2.0, -2.0]
state_high = [2.0, 2.0]
input_low = [-1.0]
input_high = [1.0]
[control]
models = ["pinc", "MODEL"]
duration_s = 20.0
initial_state = [1.0, 0.0]
controlled = ["x1", "x2"]
q = [10.0, 10.0]
r = [1.0]
state_low = [-1.0, -1.0]
state_high = [1.0, 1.0]
input_low = [-1.0]
input_high = [1.0]
references = [
    {{ start_s = 0.0, value = [0.0, 0.0] }},
    {{ start_s = 10.0, value = [-0.5, 0.0] }},
]
"#
    )
}

/// The config with this program as the plant.
fn as_process(kind: &str) -> String {
    let program = std::env::current_exe().unwrap();
    let command = json!([program, PLANT, kind]);
    let plant =
        format!("process = {{ command = {command}, states = [\"x1\", \"x2\"], inputs = [\"u\"] }}");
    config(&plant).replace("MODEL", "black-box")
}

fn parse(text: &str, plants: &Plants) -> Result<Experiment, String> {
    let sets = ["training.phases.0.iterations=1000".to_owned()];
    Experiment::parse(Path::new("b.toml"), text, &sets, plants).map_err(|error| error.to_string())
}

fn allowed() -> Plants {
    Plants::built_in().allowing_processes()
}

/// The plant that this program is.
fn plant(kind: &str) -> Box<dyn DynPlant> {
    parse(&as_process(kind), &allowed()).unwrap().plant.dyn_plant()
}

fn it_starts_only_where_it_is_allowed() {
    let error = parse(&as_process("oscillator"), &Plants::built_in()).unwrap_err();
    assert!(error.contains("`plant.process`") && error.contains("--allow-process"), "{error}");
    let experiment = parse(&as_process("oscillator"), &allowed()).unwrap();
    assert_eq!(parse(&experiment.to_toml(), &allowed()).unwrap(), experiment);
    for (from, to, parts) in [
        ("\"black-box\"", "\"rk4\"", ["control.models[1]", "no equation"]),
        ("source = \"integrator\"", "", ["training.source", "distilled"]),
        ("states = [\"x1\", \"x2\"]", "states = []", ["plant.process.states", "one or more"]),
        ("inputs = [\"u\"]", "inputs = [\"u\"], nominal = { y = 1.0 }", ["nominal.y", "a state"]),
        ("inputs = [\"u\"]", "inputs = [\"u\"], difference_step = 0.0", ["difference_step", "pos"]),
        ("inputs = [\"u\"]", "inputs = [\"u\"], time_limit_s = 0.0", ["time_limit_s", "positive"]),
    ] {
        let text = as_process("oscillator");
        assert!(text.contains(from));
        let error = parse(&text.replace(from, to), &allowed()).unwrap_err();
        assert!(parts.iter().all(|part| error.contains(part)), "{to}: {error}");
    }
}

/// More than the pipes hold at a time, from two threads.
fn many_requests_are_answered_in_order() {
    let plant = plant("oscillator");
    let flow = plant.black_box().unwrap().flow.clone();
    let ask = |shift: f64| {
        let start = |i: i32| [f64::from(i) / 1000.0 - 1.0, shift];
        let mut x: Vec<f64> = (0..2000).flat_map(start).collect();
        flow.advance(&mut x, &vec![0.3; 2000], 0.1).unwrap();
        for (i, x) in (0..2000).zip(x.chunks_exact(2)) {
            let mut next = [0.0; 2];
            Rk4::new(VanDerPol::default(), 0.1, 64).step(&start(i), &[0.3], &[], &mut next);
            assert_eq!(x.map_bits(), next.map_bits(), "{i}");
        }
    };
    std::thread::scope(|scope| {
        scope.spawn(|| ask(0.5));
        scope.spawn(|| ask(-0.5));
    });
}

/// Numbers pass through the pipes without a change of any bit.
trait MapBits {
    fn map_bits(&self) -> Vec<u64>;
}

impl MapBits for [f64] {
    fn map_bits(&self) -> Vec<u64> {
        self.iter().map(|value| value.to_bits()).collect()
    }
}

fn what_is_no_answer_is_explained() {
    for (kind, part) in [
        ("words", "answered \"\\\"here I am\\\"\", expected one line {\"x\":[..]} with 2 numbers"),
        ("short", "with 2 numbers"),
        ("fails", "x1 is beyond 2"),
        ("ends", "ended without an answer"),
        ("hangs", "did not answer within 0.2 s"),
    ] {
        // Far longer than an answer of the others takes.
        let limit = if kind == "hangs" { "0.2" } else { "60.0" };
        let text = as_process(kind);
        let text =
            text.replace("inputs = [\"u\"]", &format!("inputs = [\"u\"], time_limit_s = {limit}"));
        let plant = parse(&text, &allowed()).unwrap().plant.dyn_plant();
        let mut simulator = Simulator::new(&*plant as &dyn DynRhs, 1e-9);
        let mut ask = || simulator.integrate(&mut [2.5, 0.0], &[0.0], 0.1);
        let error = (0..3).find_map(|_| ask().err()).unwrap().to_string();
        assert!(error.contains(part), "{kind}: {error}");
    }
    let missing = as_process("oscillator").replace("command = [\"", "command = [\"/nowhere");
    let plant = parse(&missing, &allowed()).unwrap().plant.dyn_plant();
    let mut simulator = Simulator::new(&*plant as &dyn DynRhs, 1e-9);
    let error = simulator.integrate(&mut [0.0; 2], &[0.0], 0.1).unwrap_err().to_string();
    assert!(error.contains("/nowhere") && error.contains("cannot be started"), "{error}");
}

/// A config without what a net is trained by.
fn without_net(text: &str) -> String {
    let (head, rest) = text.split_once("[training]").unwrap();
    let (_, control) = rest.split_once("[control]").unwrap();
    format!("{head}[control]{control}").replace("\"pinc\", ", "")
}

/// Not only those to the loop, whose plant takes but one step at a time.
fn wrong_answers_to_the_controller_end_the_run() {
    let text = without_net(&as_process("miscounts"));
    let experiment = Experiment::parse(Path::new("b.toml"), &text, &[], &allowed()).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let error = run(&experiment, dir.path(), &quietly(&AtomicBool::new(false))).unwrap_err();
    assert!(error.to_string().contains("answered request 0 when"), "{error}");
}

/// The IAE of the loop with the one model of a config.
fn iae(experiment: &Experiment) -> f64 {
    let dir = tempfile::tempdir().unwrap();
    let run = run_of(experiment, dir.path());
    let [control] = &run.metrics().control[..] else { panic!("one model") };
    control.iae_dense_sum
}

/// The oscillator as an FMU of our own: its 100 steps of RK4 per T are exact to 1e-9, and the loop
/// with it as plant and as model equals the equation's.
fn an_exported_plant_is_a_plant() {
    let dir = tempfile::tempdir().unwrap();
    let equation = config("van-der-pol = { mu = 1.0 }").replace("MODEL", "rk4");
    let read = |text: &str| Experiment::parse(Path::new("b.toml"), text, &[], &allowed()).unwrap();
    let expected =
        iae(&read(&without_net(&equation).replace("[control]", "[control]\nrk4_substeps = 32")));
    let equation = parse(&equation, &allowed()).unwrap();
    for version in [FmiVersion::Two, FmiVersion::Three] {
        let out = dir.path().join(format!("{version:?}"));
        export_plant(&equation, Target::Fmu(version), Some("osc"), Some(&out)).unwrap();
        let plant = |variables: &str| {
            let file = json!(out.join("osc.fmu"));
            let fmu = format!(
                "fmu = {{ file = {file}, states = [\"x1\", \"x2\"], inputs = [\"u\"], {variables} }}"
            );
            config(&fmu).replace("MODEL", "black-box")
        };
        let names = "variables = { x1 = 'x1', x2 = 'x2', u = 'u' }";
        let starts = "start_variables = { x1 = 'x1_start', x2 = 'x2_start' }";
        for kind in ["co-simulation", "model-exchange"] {
            let text = plant(&format!("{names}, {starts}, kind = '{kind}'"));
            let found = parse(&text, &allowed()).unwrap().plant.dyn_plant();
            let mut found = Simulator::new(&*found as &dyn DynRhs, 1e-9);
            let mut truth = Simulator::new(&VanDerPol::default(), 1e-12);
            for (x, u) in [([1.0, 0.0], 0.3), ([-2.0, 1.5], -1.0), ([1.0, 0.0], 0.3)] {
                let (mut of_fmu, mut expected) = (x, x);
                found.integrate(&mut of_fmu, &[u], 0.5).unwrap();
                truth.integrate(&mut expected, &[u], 0.5).unwrap();
                for (a, b) in of_fmu.iter().zip(&expected) {
                    assert!((a - b).abs() < 1e-8, "{version:?} {kind} {x:?}: {a} {b}");
                }
            }
            let found = iae(&read(&without_net(&text)));
            assert!(
                (found / expected - 1.0).abs() < 1e-6,
                "{version:?} {kind}: {found} {expected}"
            );
        }
        let parsed = |variables: &str| parse(&plant(variables), &allowed());
        let error = parsed("variables = { x1 = 'height' }").unwrap_err();
        assert!(error.contains("`plant.fmu.variables`") && error.contains("`height`"), "{error}");
    }
    let text = config("fmu = { file = 'tests/Cargo.toml', states = ['x'], inputs = ['u'] }");
    let error = parse(&text.replace("MODEL", "black-box"), &allowed()).unwrap_err();
    assert!(error.contains("plant.fmu.file"), "{error}");
}

/// An output that depends on the input is controlled, bounded, and all that the estimator measures: the
/// loop with the exported plant as plant and as model equals the equation's.
fn outputs_of_an_fmu_are_controlled() {
    let dir = tempfile::tempdir().unwrap();
    let config = |plant: &str, model: &str, kind: &str| {
        format!(
            r#"
name = "outputs"
preset = "ours"
seed = 1
[plant.{plant}]
states = [{{ name = "x", unit = "m" }}, {{ name = "v", unit = "m/s" }}]
inputs = [{{ name = "u", unit = "N" }}]
{}
[control]
models = ["{model}"]
step_s = 0.5
duration_s = 10.0
initial_state = [0.8, 0.0]
initial_input = [0.1]
controlled = ["force"]
q = [10.0]
r = [1.0]
n2 = 8
nu = 8
input_low = [-1.0]
input_high = [1.0]
output_high = {{ force = 0.62 }}
output_softness = "exact"
rk4_substeps = 50
references = [{{ start_s = 0.0, value = [0.4] }}, {{ start_s = 5.0, value = [0.65] }}]
[control.measurement]
measured = ["force"]
noise_sd = [0.01]
[control.estimator]
kind = "ekf"
process_sd = [0.01, 0.01]
measurement_sd = [0.01]
initial_estimate = [0.7, 0.1]
initial_sd = [0.2, 0.2]
"#,
            match plant {
                "expression" => {
                    "[plant.expression.derivatives]\nx = \"v\"\nv = \"u - x - 0.4*v*abs(v)\"\n\
                     [plant.expression.outputs]\n\
                     force = { expression = \"0.6*x + 0.3*v + 0.2*u\", unit = \"N\" }\n"
                        .to_owned()
                }
                _ => format!(
                    "file = {}\nkind = \"{kind}\"\noutputs = [{{ name = \"force\", unit = \"N\" }}]\n\
                     start_variables = {{ x = \"x_start\", v = \"v_start\" }}\n",
                    json!(dir.path().join("made/plant.fmu"))
                ),
            }
        )
    };
    let read = |plant: &str, model: &str, kind: &str| {
        let text = config(plant, model, kind);
        Experiment::parse(Path::new("b.toml"), &text, &[], &allowed()).unwrap()
    };
    let equation = read("expression", "rk4", "");
    let expected = iae(&equation);
    for version in [FmiVersion::Two, FmiVersion::Three] {
        let out = dir.path().join("made");
        export_plant(&equation, Target::Fmu(version), Some("plant"), Some(&out)).unwrap();
        // Differences of steps whose substeps adapt are less smooth.
        for (kind, allowed) in [("co-simulation", 1e-6), ("model-exchange", 1e-5)] {
            let of_fmu = read("fmu", "black-box", kind);
            let found = iae(&of_fmu);
            let off = (found / expected - 1.0).abs();
            assert!(off < allowed, "{version:?} {kind}: {found} {expected}");
        }
        std::fs::remove_dir_all(&out).unwrap();
    }
}

/// How all is run here; the flag is for an interrupt.
fn quietly(interrupt: &AtomicBool) -> Options<'_> {
    Options { resume: false, verbosity: Verbosity::Quiet, interrupt, arguments: &[] }
}

fn run_of(experiment: &Experiment, dir: &Path) -> RunDir {
    let findings = check(experiment);
    assert!(findings.iter().all(|f| f.severity < pinc_runs::Severity::Error), "{findings:?}");
    run(experiment, dir, &quietly(&AtomicBool::new(false))).unwrap()
}

/// The black box sets the standard, and nets are distilled from it.
fn a_net_is_chosen_beside_it() {
    let dir = tempfile::tempdir().unwrap();
    let experiment = parse(&as_process("oscillator"), &allowed()).unwrap();
    let how = ChooseOptions { within: 0.05, budget_s: 20.0, timed: Timed::Program };
    let never = AtomicBool::new(false);
    let choice = choose(&experiment, dir.path(), &allowed(), &quietly(&never), how).unwrap();
    let said = choice.to_string();
    assert!(said.contains("the most exact model, black box"), "{said}");
    assert!(!said.contains("RK4") && !said.contains("no net was tried"), "{said}");
    let text = std::fs::read_to_string(&choice.recommended).unwrap();
    let again = parse(&text, &allowed()).unwrap();
    assert!(again.plant.is_black_box() && again.control.unwrap().models.len() == 1);
}

/// Net and loops of the process agree with the equation: the samples differ by its rounding, and
/// its 64 steps of RK4 by less than 1e-9.
fn it_is_distilled_and_controlled() {
    let (one, other) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let equation = config("van-der-pol = { mu = 1.0 }").replace("MODEL", "rk4");
    let run_of = |text: &str, dir| run_of(&parse(text, &allowed()).unwrap(), dir);
    let equation =
        run_of(&equation.replace("[control]", "[control]\nrk4_substeps = 32"), one.path());
    let process = run_of(&as_process("oscillator"), other.path());
    let rms =
        |of: &RunDir| of.metrics().validation.as_ref().unwrap().domain_error.as_ref().unwrap().rms;
    let (of_equation, of_process) = (rms(&equation), rms(&process));
    assert!(of_equation < 2e-4, "{of_equation}");
    // Its outputs are scaled by displacements and not by velocities, which makes it another net, as
    // another seed does: short trainings differ by two to three times.
    assert!(of_process < 4.0 * of_equation, "{of_process} {of_equation}");
    let [net, black_box] = &process.metrics().control[..] else { panic!("two models") };
    let [_, rk4] = &equation.metrics().control[..] else { panic!("two models") };
    assert_eq!(black_box.model, ModelKind::BlackBox);
    let apart = |of: &ControlMetrics, share: f64| {
        let difference = (of.iae_dense_sum - rk4.iae_dense_sum).abs();
        assert!(
            difference < share * rk4.iae_dense_sum,
            "{} {}",
            of.iae_dense_sum,
            rk4.iae_dense_sum
        );
    };
    // Jacobians by differences are not exact; the loop's plant is.
    apart(black_box, 1e-6);
    apart(net, 1e-2);
    let report = std::fs::read_to_string(other.path().join("report.html")).unwrap();
    assert!(report.contains("black box"));
}
