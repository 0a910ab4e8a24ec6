//! The seams between the program's closed loop and the ways in which its controller leaves it: of every shipped
//! config, and of every key of `[control]`, the served and the exported controller choose the inputs of the
//! loop, or refuse by name. What was found is `docs/ways-out.md`, whose tables this test writes.

use crate::closed::Closed;
use crate::common::{Outcome, outcome, pinc, repository};
use crate::ways::{Exported, Served, assert_same};
use pinc_config::{Experiment, ModelKind, ParameterStep, Plants};
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// So many steps of each loop are taken.
const STEPS: usize = 8;

/// How far inputs may differ, relative to 1 + |u|.
const ALLOWED: f64 = 1e-9;

/// The tables that say what was found, of docs/ways-out.md. With `PINC_WRITE` set they are written.
const TABLES: &str = "docs/tables/ways-out";

/// What a way out does with the controller of a loop.
#[derive(Clone, Debug, PartialEq)]
enum Found {
    /// It chooses the same inputs.
    Same,
    /// It refuses, with this message.
    Refused(String),
}

impl Found {
    #[track_caller]
    fn refused(outcome: &Outcome) -> Self {
        outcome.assert_refused(&[]);
        let message = outcome.stderr.trim_start_matches("error: ").trim();
        // Tables do not name the file.
        Self::Refused(message.split_once(".toml: ").map_or(message, |(_, rest)| rest).to_owned())
    }

    fn in_words(&self, same: &str) -> String {
        match self {
            Self::Same => same.to_owned(),
            Self::Refused(message) => format!("refused: {message}"),
        }
    }
}

/// Runs a loop, asks the served controller for the same inputs, and the exported one.
#[track_caller]
fn compare(config: &Path, kind: ModelKind, sets: &[&str]) -> (Closed, [Found; 2]) {
    let dir = tempfile::tempdir().unwrap();
    let closed = Closed::run(dir.path(), config, kind, sets);
    let told = closed.told();
    let way = |name: &str| format!("{name}, {}, {sets:?}", config.display());
    let served = match Served::refusal(config, kind, sets) {
        Some(refused) => Found::refused(&refused),
        None => {
            let mut served = Served::of(config, kind, sets);
            let answers = served.answers(&told, &measured_parameters(&closed));
            assert_same(&way("served"), &closed, &answers, ALLOWED);
            served.end();
            Found::Same
        }
    };
    let in_c = match Exported::of(dir.path(), config, kind, sets, closed.estimates.is_some()) {
        Ok(exported) => {
            assert_same(&way("in C"), &closed, &exported.answers(&told), ALLOWED);
            Found::Same
        }
        Err(refused) => Found::refused(&refused),
    };
    (closed, [served, in_c])
}

/// The values of the parameters that the controller of a loop is told, step by step; none where it
/// is told none.
fn measured_parameters(closed: &Closed) -> Vec<Vec<f64>> {
    let spec = &closed.spec;
    if spec.measured_parameters.is_empty() {
        return Vec::new();
    }
    let value = |name: &String, t: f64| {
        let begun = |step: &&ParameterStep| step.start_s <= t + 1e-9;
        let changed = spec.plant_schedule.iter().filter(begun);
        changed.filter_map(|step| step.values.get(name)).next_back().or(closed.parameters.get(name))
    };
    let at = |k: usize| {
        let t = k as f64 * closed.sample_time_s;
        spec.measured_parameters.iter().map(|name| *value(name, t).unwrap()).collect()
    };
    (0..closed.steps.len()).map(at).collect()
}

/// All files below `dir` that are configs, in order.
fn configs(dir: &Path, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<_> = fs::read_dir(dir).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            configs(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "toml") {
            found.push(path);
        }
    }
}

/// Folders whose loops take too long without optimization: they are there for measuring times, of
/// plants that are expensive.
const EXPENSIVE: [&str; 3] = ["pareto", "costly", "distributed"];

/// Configs whose first plan takes many iterations over a long horizon: they get a shorter one.
const LONG: [&str; 2] = ["polymerization", "ethanol"];

/// A row of the page for each shipped config with a loop that has an integrator as a model.
fn rows_of_configs() -> Vec<[String; 4]> {
    let mut all = Vec::new();
    configs(&repository("configs"), &mut all);
    let mut rows = Vec::new();
    for config in all {
        let folder = config.parent().and_then(Path::file_name).unwrap();
        if EXPENSIVE.iter().any(|name| folder == *name) {
            continue;
        }
        // A list of configs is none.
        let Ok(experiment) = Experiment::load(&config, &[], &Plants::built_in()) else { continue };
        let Some(control) = &experiment.control else { continue };
        let Some(kind) = control.models.iter().copied().find(|k| k.integrator().is_some()) else {
            continue;
        };
        let duration_s = experiment.sample_time_s().unwrap() * STEPS as f64;
        let duration = format!("control.duration_s={duration_s:?}");
        // What would begin later is refused.
        let schedules = [
            ("plant_schedule", control.plant_schedule.iter().map(|of| of.start_s).collect()),
            (
                "parameter_schedule",
                control.parameter_schedule.iter().map(|of| of.start_s).collect(),
            ),
            ("bound_schedule", control.bound_schedule.iter().map(|of| of.start_s).collect()),
            ("loads", control.loads.iter().map(|of| of.start_s).collect::<Vec<_>>()),
        ];
        let later = schedules.iter().filter(|(_, starts)| starts.iter().any(|s| *s >= duration_s));
        let later: Vec<_> = later.map(|(key, _)| format!("control.{key}=[]")).collect();
        let long = LONG.iter().any(|name| config.file_stem().is_some_and(|stem| stem == *name));
        let horizon: &[&str] = if long { &["control.n2=4", "control.nu=4"] } else { &[] };
        let shorter = [duration.as_str(), "control.max_failed_share=1.0", "control.close_ups_s=[]"];
        let shorter = shorter.iter().chain(horizon).copied();
        let shorter = shorter.chain(later.iter().map(String::as_str));
        let sets: Vec<_> = shorter.flat_map(|set| ["--set", set]).collect();
        let (_, ways) = compare(&config, kind, &sets);
        let [served, in_c] = ways.map(|found| found.in_words("same"));
        let name = config.strip_prefix(repository("")).unwrap().display().to_string();
        rows.push([format!("`{name}`"), kind.title().to_owned(), served, in_c]);
    }
    rows
}

/// A loop in which each key of `[control]` can make a difference.
const BASE: &str = r#"
name = "keys"
preset = "ours"
seed = 1

[plant.expression]
states = ["x", "v"]
inputs = ["u"]

[plant.expression.parameters]
k = 1.0

[plant.expression.derivatives]
x = "v"
v = "k*(1 - x^2)*v - x + u"

[plant.expression.outputs]
y = "x + 0.2*u"

[domain]
state_low = [-3.0, -3.0]
state_high = [3.0, 3.0]
input_low = [-1.0]
input_high = [1.0]

[domain.parameters]
k = [0.5, 1.5]

[control]
models = ["rk4"]
step_s = 0.5
duration_s = 6.0
initial_state = [0.9, 0.2]
controlled = ["x"]
q = [10.0]
r = [1.0]
input_low = [-1.0]
input_high = [1.0]
references = [
    { start_s = 0.0, value = [0.0] },
    { start_s = 2.0, value = [-0.4] },
    { start_s = 4.0, value = [0.3] },
]
repetitions = 1
max_failed_share = 1.0
"#;

/// The net in place of the controller of this loop.
const POLICY_DIR: &str = concat!(env!("CARGO_TARGET_TMPDIR"), "/keys-policy");
const POLICY: &str =
    concat!("control.policy=\"", env!("CARGO_TARGET_TMPDIR"), "/keys-policy/policy.json\"");

/// What a key is about.
#[derive(Clone, Copy, PartialEq)]
enum About {
    /// The controller: with it other inputs are chosen than without.
    Controller,
    /// The simulated loop around the controller, or what is said of it.
    Loop,
    /// How long things take, or a net, which this test does not look at.
    Unseen,
}

const ESTIMATOR: [&str; 7] = [
    "control.measurement={ measured = [\"x\"] }",
    "control.estimator.kind=ekf",
    "control.estimator.process_sd=[0.01, 0.01]",
    "control.estimator.measurement_sd=[0.01]",
    "control.estimator.initial_estimate=[0.8, 0.0]",
    "control.estimator.initial_sd=[0.1, 0.1]",
    "control.estimator.disturbance=none",
];

const SOFT: &str = "control.state_softness={ penalty = [0.5, 0.5] }";

const OFFSET: [&str; 3] = [
    "control.estimator.disturbance=input",
    "control.estimator.disturbance_sd=[0.1]",
    "control.estimator.disturbance_initial_sd=[0.3]",
];

const SCENARIOS: &str = "control.scenarios.values={ k = [1.0, 1.4, 0.6] }";

/// A bound that the second reference is at.
const LOW: &str = "control.state_low=[-0.4, -3.0]";
const CHANCE: [&str; 2] = [LOW, "control.uncertainty.probability=0.9"];
const WORST: [&str; 2] = [LOW, "control.uncertainty.probability=\"worst-case\""];
const BOXES: &str = "control.uncertainty.boxes={ x = 0.05 }";
const UKF: &str = "control.estimator.kind=ukf";
const MHE: [&str; 2] = ["control.estimator.kind=mhe", "control.estimator.window=4"];

/// Every key, with values that differ from the base's, and what it is about. Groups of values that
/// belong together are named by what follows.
fn keys() -> Vec<(&'static str, Vec<&'static str>, About)> {
    use About::{Controller, Loop, Unseen};
    let with = |more: &[&'static str]| [&ESTIMATOR[..], more].concat();
    let offset = |more: &[&'static str]| [&ESTIMATOR[..], &OFFSET, more].concat();
    let mhe = |more: &[&'static str]| [&ESTIMATOR[..], &MHE, more].concat();
    let chance = |more: &[&'static str]| [&CHANCE[..], more].concat();
    let worst = |more: &[&'static str]| [&WORST[..], more].concat();
    let of_k = "control.estimator.parameters=[{ name = \"k\", initial = 0.8, initial_sd = 0.2, \
                drift_sd = 0.01 }]";
    vec![
        ("models", vec!["control.models=[\"rk5\"]"], Controller),
        ("policy", vec!["control.models=[\"rk4\", \"policy\"]", POLICY], Controller),
        ("plant", vec!["control.plant.van-der-pol={ mu = 0.6 }"], Unseen),
        ("measurement.measured", with(&[]), Controller),
        ("noise_seed", with(&["control.noise_seed=5"]), Loop),
        ("measurement.noise_sd", with(&["control.measurement.noise_sd=[0.05]"]), Loop),
        ("estimator.kind", with(&["control.estimator.kind=ukf"]), Controller),
        ("estimator.process_sd", with(&["control.estimator.process_sd=[0.2, 0.01]"]), Controller),
        ("estimator.measurement_sd", with(&["control.estimator.measurement_sd=[0.1]"]), Controller),
        (
            "estimator.initial_estimate",
            with(&["control.estimator.initial_estimate=[0.7, 0.4]"]),
            Controller,
        ),
        ("estimator.initial_sd", with(&["control.estimator.initial_sd=[0.3, 0.3]"]), Controller),
        ("estimator.disturbance", offset(&[]), Controller),
        (
            "estimator.disturbance_sd",
            offset(&["control.estimator.disturbance_sd=[0.02]"]),
            Controller,
        ),
        (
            "estimator.disturbance_initial_sd",
            offset(&["control.estimator.disturbance_initial_sd=[0.05]"]),
            Controller,
        ),
        ("estimator.parameters", with(&[of_k]), Controller),
        ("estimator.alpha", with(&[UKF, "control.estimator.alpha=1.0"]), Controller),
        ("estimator.window", mhe(&["control.estimator.window=2"]), Controller),
        ("estimator.low", mhe(&["control.estimator.low=[-0.1, -0.1]"]), Controller),
        ("estimator.high", with(&["control.estimator.high=[0.5, 0.1]"]), Controller),
        ("estimator.gate", with(&["control.measurement.noise_sd=[2.0]"]), Controller),
        ("duration_s", vec!["control.duration_s=5.0"], Loop),
        ("initial_state", vec!["control.initial_state=[0.5, -0.2]"], Loop),
        ("parameters", vec!["control.parameters={ k = 0.7 }"], Controller),
        (
            "measured_parameters",
            vec![
                "control.measured_parameters=[\"k\"]",
                "control.plant_schedule=[{ start_s = 1.0, values = { k = 1.4 } }]",
            ],
            Controller,
        ),
        ("scenarios.values", vec![SCENARIOS], Controller),
        (
            "scenarios.robust_horizon",
            vec![SCENARIOS, "control.scenarios.robust_horizon=2"],
            Controller,
        ),
        (
            "scenarios.weights",
            vec![SCENARIOS, "control.scenarios.weights=[1.0, 5.0, 1.0]"],
            Controller,
        ),
        (
            "scenarios.combine",
            vec![SCENARIOS, "control.scenarios.combine={ draws = 2 }"],
            Controller,
        ),
        ("uncertainty.probability", worst(&[BOXES]), Controller),
        (
            "uncertainty.process_sd",
            chance(&["control.uncertainty.process_sd=[0.02, 0.05]"]),
            Controller,
        ),
        ("uncertainty.boxes", worst(&["control.uncertainty.boxes={ v = 0.1 }"]), Controller),
        (
            "uncertainty.parameters",
            worst(&["control.uncertainty.parameters={ k = [0.5, 1.4] }"]),
            Controller,
        ),
        (
            "uncertainty.estimate",
            [offset(&[]), chance(&["control.uncertainty.estimate=true"])].concat(),
            Controller,
        ),
        ("uncertainty.net_error", vec![], Unseen),
        (
            "uncertainty.feedback",
            worst(&[BOXES, "control.uncertainty.feedback=\"none\""]),
            Controller,
        ),
        (
            "uncertainty.tighten_inputs",
            worst(&[
                BOXES,
                "control.uncertainty.feedback=[[-1.5, -1.5]]",
                "control.uncertainty.tighten_inputs=false",
            ]),
            Controller,
        ),
        (
            "uncertainty.tightenings",
            worst(&[BOXES, "control.uncertainty.tightenings=3"]),
            Controller,
        ),
        (
            "parameter_schedule",
            vec![
                "control.parameters={ k = 0.8 }",
                "control.parameter_schedule=[{ start_s = 1.0, values = { k = 1.4 } }]",
            ],
            Controller,
        ),
        (
            "parameter_preview",
            vec![
                "control.parameter_schedule={ k = \"0.8 + 0.1*t\" }",
                "control.parameter_preview=true",
            ],
            Controller,
        ),
        (
            "plant_schedule",
            vec!["control.plant_schedule=[{ start_s = 1.0, values = { k = 1.4 } }]"],
            Loop,
        ),
        ("loads", vec!["control.loads=[{ start_s = 0.0, inputs = { u = -0.2 } }]"], Loop),
        (
            "initial_input",
            vec!["control.initial_input=[0.8]", "control.increment_high=[0.3]"],
            Controller,
        ),
        ("first_plan", vec!["control.first_plan={ input = [0.5] }"], Unseen),
        ("controlled", vec!["control.controlled=[\"y\"]"], Controller),
        ("n1", vec!["control.n1=2"], Controller),
        ("n2", vec!["control.n2=8"], Controller),
        ("nu", vec!["control.nu=2"], Controller),
        (
            "stages_s",
            vec!["control.n2=3", "control.nu=3", "control.stages_s=[0.5, 0.5, 1.0]"],
            Controller,
        ),
        (
            "free_time",
            vec![
                "control.free_time=\"u\"",
                "control.input_low=[0.1]",
                "control.initial_input=[0.5]",
                "control.references=[{ start_s = 0.0, value = [0.3] }]",
            ],
            Controller,
        ),
        ("end_state", vec!["control.end_state={ x = 0.1 }", SOFT], Controller),
        ("periodic", vec!["control.periodic=[\"x\"]"], Controller),
        ("integer", vec!["control.integer=[\"u\"]"], Controller),
        (
            "integer_programs",
            vec!["control.integer=[\"u\"]", "control.integer_programs=1"],
            Controller,
        ),
        (
            "target",
            with(&[
                "control.target=true",
                "control.controlled=[\"x\", \"u\"]",
                "control.q=[10.0, 1.0]",
                "control.references=[{ start_s = 0.0, value = [0.3, 0.0] }]",
            ]),
            Controller,
        ),
        ("q", vec!["control.q=[3.0]"], Controller),
        ("r", vec!["control.r=[0.1]"], Controller),
        ("cost", vec!["control.cost={ stage = \"u^2 - x\", terminal = \"x^2\" }"], Controller),
        ("q_terminal", vec!["control.q_terminal=[100.0]"], Controller),
        ("weights_profile", vec!["control.weights_profile=\"cumulative\""], Controller),
        (
            "input_differences",
            vec!["control.input_differences=[{ between = [-1, 1], weight = [3.0] }]"],
            Controller,
        ),
        ("state_low", vec!["control.state_low=[-0.2, -0.5]"], Controller),
        ("state_high", vec!["control.state_high=[2.0, 0.1]"], Controller),
        (
            "state_softness",
            vec![
                "control.state_low=[-0.2, -0.5]",
                "control.state_softness={ penalty = [0.5, 0.5] }",
            ],
            Controller,
        ),
        ("output_low", vec!["control.output_low=[-0.2]"], Controller),
        ("output_high", vec!["control.output_high=[0.6]"], Controller),
        (
            "output_softness",
            vec!["control.output_low=[-0.2]", "control.output_softness={ penalty = [0.5] }"],
            Controller,
        ),
        ("input_low", vec!["control.input_low=[-0.3]"], Controller),
        ("input_high", vec!["control.input_high=[0.2]"], Controller),
        ("increment_low", vec!["control.increment_low=[-0.2]"], Controller),
        ("increment_high", vec!["control.increment_high=[0.1]"], Controller),
        ("delay_steps", vec!["control.delay_steps=2"], Controller),
        (
            "bound_schedule",
            vec![
                "control.state_low=[-2.0, -2.0]",
                "control.bound_schedule={ state_low = { x = \"-0.3 + 0.1*t\" }, \
                 input_high = { u = 0.2 } }",
            ],
            Controller,
        ),
        ("preview", vec!["control.preview=false"], Controller),
        ("budget_us", vec!["control.budget_us=1e7"], Unseen),
        ("outside_domain", vec!["control.outside_domain=\"refuse\""], Unseen),
        ("error_tolerance", vec![], Unseen),
        ("on_error", vec![], Unseen),
        ("max_failed_share", vec!["control.max_failed_share=0.5"], Loop),
        ("settled_within", vec!["control.settled_within=[0.1]"], Loop),
        ("rk4_substeps", vec!["control.rk4_substeps=1"], Controller),
        ("rk5_substeps", vec!["control.models=[\"rk5\"]", "control.rk5_substeps=1"], Controller),
        (
            "rosenbrock_substeps",
            vec!["control.models=[\"rosenbrock\"]", "control.rosenbrock_substeps=1"],
            Controller,
        ),
        ("repetitions", vec!["control.repetitions=2"], Loop),
        ("plant_tolerance", vec!["control.plant_tolerance=1e-5"], Loop),
        ("step_s", vec!["control.step_s=0.25"], Controller),
        ("references", vec!["control.references={ x = \"0.5*sin(t)\" }"], Controller),
        ("close_ups_s", vec!["control.close_ups_s=[[0.0, 2.0]]"], Loop),
        ("sqp.tolerance", vec!["control.sqp.tolerance=1e-2"], Controller),
        ("sqp.max_iterations", vec!["control.sqp.max_iterations=1"], Controller),
        ("sqp.real_time", vec!["control.sqp.real_time=true"], Controller),
        ("sqp.hessian", vec!["control.sqp.hessian=\"adaptive\""], Unseen),
        ("sqp.starts", vec!["control.sqp.starts=4"], Unseen),
        ("sqp.qp", vec!["control.sqp.qp=\"clarabel\""], Unseen),
    ]
}

/// The keys that a table of the config may have, as the message of an unknown one lists them.
fn known(table: &str, sets: &[&str]) -> BTreeSet<String> {
    let unknown = format!("{table}.nonsense=1");
    let sets: Vec<_> = sets.iter().chain([&unknown.as_str()]).map(|s| (*s).to_owned()).collect();
    let refused = Experiment::parse("keys.toml".as_ref(), BASE, &sets, &Plants::built_in());
    let message = refused.unwrap_err().to_string();
    let (_, list) = message.split_once("expected one of ").unwrap_or_else(|| panic!("{message}"));
    let names = list.split([';', '\n']).next().unwrap().split(", ");
    names.map(|name| name.trim_matches('`').to_owned()).collect()
}

#[test]
fn every_key_is_looked_at() {
    let of = |table: &str, sets: &[&str]| {
        let inner = table.trim_start_matches("control").trim_start_matches('.');
        let name = |key: String| if inner.is_empty() { key } else { format!("{inner}.{key}") };
        known(table, sets).into_iter().map(name).collect::<BTreeSet<_>>()
    };
    let mut expected = of("control", &[]);
    for inner in ["measurement", "estimator", "scenarios", "uncertainty", "sqp"] {
        assert!(expected.remove(inner), "{inner}");
        expected.extend(of(&format!("control.{inner}"), &ESTIMATOR));
    }
    let found: BTreeSet<String> = keys().into_iter().map(|(key, ..)| key.to_owned()).collect();
    assert_eq!(found, expected);
}

/// A row of the page for each key.
fn rows_of_keys() -> Vec<[String; 4]> {
    let dir = tempfile::tempdir().unwrap();
    let config = dir.path().join("keys.toml");
    fs::write(&config, BASE).unwrap();
    let sizes = ["--samples", "300", "--iterations", "30", "--neurons", "6", "--loops", "2"];
    // That of an earlier test run may be of another config.
    let _ = fs::remove_dir_all(POLICY_DIR);
    let mut shrink = pinc(&["shrink", "--only", "rk4", "--out"]);
    let shrunk = outcome(shrink.arg(POLICY_DIR).args(sizes).arg(&config));
    assert_eq!(shrunk.code, Some(0), "{shrunk:?}");
    let kind_of = |sets: &[&str]| {
        let named =
            |kind: &ModelKind| sets.iter().any(|set| set.ends_with(&format!("\"{kind}\"]")));
        ModelKind::ALL.into_iter().find(named).unwrap_or(ModelKind::RK4)
    };
    let inputs = |sets: &[&str]| {
        let given: Vec<_> = sets.iter().flat_map(|set| ["--set", set]).collect();
        let (closed, ways) = compare(&config, kind_of(sets), &given);
        (closed.inputs, ways)
    };
    let (plain, _) = inputs(&[]);
    let (estimated, _) = inputs(&ESTIMATOR);
    let mut rows = Vec::new();
    for (key, sets, about) in keys() {
        if key == "plant" {
            let cells = [&format!("`{key}`"), "yes", "of the loop", "of the loop"];
            rows.push(cells.map(str::to_owned));
            continue;
        }
        let (found, ways) = inputs(&sets);
        if about == About::Controller {
            let before = if sets.starts_with(&ESTIMATOR) && sets.len() > ESTIMATOR.len() {
                &estimated
            } else {
                &plain
            };
            assert_ne!(&found, before, "{key} makes no difference");
        }
        let same = match about {
            About::Controller => "yes",
            About::Loop => "of the loop",
            About::Unseen => "not compared",
        };
        let [served, in_c] = ways.map(|found| found.in_words(same));
        rows.push([format!("`{key}`"), "yes".to_owned(), served, in_c]);
    }
    rows
}

/// Compares a table with what was found.
#[track_caller]
fn assert_table(name: &str, heads: [&str; 4], rows: Vec<[String; 4]>) {
    let mut table = csv::Writer::from_writer(Vec::new());
    table.write_record(heads).unwrap();
    for row in rows {
        table.write_record(row).unwrap();
    }
    let table = String::from_utf8(table.into_inner().unwrap()).unwrap();
    let path = repository(TABLES).join(name);
    if std::env::var_os("PINC_WRITE").is_some() {
        fs::create_dir_all(repository(TABLES)).unwrap();
        fs::write(&path, &table).unwrap();
    }
    let found = fs::read_to_string(&path).unwrap_or_default();
    assert!(
        found == table,
        "{TABLES}/{name} differs: PINC_WRITE=1 cargo test -p pinc --test suite seams\n{table}"
    );
}

const WAYS: [&str; 2] = ["`pinc serve`, Python", "C, FMU"];

#[test]
fn the_table_of_keys_matches_the_refusals() {
    assert_table("keys.csv", ["key", "`pinc control`", WAYS[0], WAYS[1]], rows_of_keys());
}

#[test]
fn the_table_of_configs_matches_the_refusals() {
    assert_table("configs.csv", ["config", "model", WAYS[0], WAYS[1]], rows_of_configs());
}
