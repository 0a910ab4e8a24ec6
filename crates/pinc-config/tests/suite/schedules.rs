//! Schedules as functions of t and as files.

use crate::common::{parse, read};
use pinc_config::{ControlSpec, Experiment};
use pinc_mpc::{Bounded, NmpcProblem};
use std::fs;

/// A loop of 8 steps of 0.5 s.
const LOOP: &str = r#"
name = "schedules"
preset = "ours"
seed = 1

[plant.expression]
states = ["x", "v"]
inputs = ["u"]
parameters = { a = 1.0, b = 2.0 }
derivatives = { x = "v", v = "b*u - a*x" }

[domain]
state_low = [-3.0, -3.0]
state_high = [3.0, 3.0]
input_low = [-1.0]
input_high = [1.0]
parameters = { a = [0.1, 9.0] }

[control]
models = ["rk4"]
step_s = 0.5
duration_s = 4.0
initial_state = [0.0, 0.0]
controlled = ["x"]
q = [1.0]
r = [1.0]
state_high = [5.0, inf]
input_low = [-1.0]
input_high = [1.0]
references = [{ start_s = 0.0, value = [0.0] }]
"#;

fn experiment(sets: &[&str]) -> Experiment {
    parse(LOOP, sets).unwrap_or_else(|error| panic!("{sets:?}: {error}"))
}

fn control(sets: &[&str]) -> ControlSpec {
    experiment(sets).control.unwrap()
}

/// Start and value of all references.
fn references(sets: &[&str]) -> Vec<(f64, f64)> {
    control(sets).references.iter().map(|step| (step.start_s, step.value[0])).collect()
}

fn refused(set: &str) -> String {
    parse(LOOP, &[set]).unwrap_err()
}

/// A reference is compared with the plant at the ends of steps: it has the value of then.
#[test]
fn references_are_functions_of_t() {
    let found = references(&["control.references={ x = \"3*t^2 + sin(pi*t)\" }"]);
    assert_eq!(found.len(), 8);
    for (k, (start_s, value)) in (0_i32..).zip(found) {
        let end_s = 0.5 * f64::from(k + 1);
        assert!((start_s - (end_s - 0.5)).abs() < 1e-12);
        let expected = 3.0 * end_s * end_s + (std::f64::consts::PI * end_s).sin();
        assert!((value - expected).abs() < 1e-12, "{k}: {value} {expected}");
    }
    assert_eq!(references(&["control.references={ x = 2 }"]), [(0.0, 2.0)]);
    assert_eq!(
        references(&["control.references={ x = \"max(0, t - 3.5)\" }"]),
        [(0.0, 0.0), (3.5, 0.5)]
    );
}

#[test]
fn the_columns_of_a_file_are_steps_or_lines() {
    let dir = tempfile::tempdir().unwrap();
    let file = |text: &str| {
        let path = dir.path().join("day.csv");
        fs::write(&path, text).unwrap();
        path.display().to_string()
    };
    let with = |path: &str, how: &str| {
        format!("control.references={{ file = \"{path}\", interpolation = \"{how}\" }}")
    };
    let path = file("t, x\n0, 1.0\n1.5, 4.0\n2.0, 2.0\n");
    let steps = references(&[&with(&path, "zero-order")]);
    assert_eq!(steps, [(0.0, 1.0), (1.5, 4.0), (2.0, 2.0)]);
    // Lines have no value after their end.
    let short = parse(LOOP, &[&with(&path, "linear")]).unwrap_err();
    assert!(short.contains("line 4: t = 2 given, expected rows to the end of the run, t = 4"));
    let path = file("t,other,x\n0,7,1\n1.25,7,2.25\n5,7,9.75\n");
    let of_x = format!("{{ x = {{ file = \"{path}\", interpolation = \"linear\" }} }}");
    let lines = references(&[&format!("control.references={of_x}")]);
    let expected: Vec<(f64, f64)> = [1.5, 2.0, 2.75, 3.75, 4.75, 5.75, 6.75, 7.75]
        .into_iter()
        .zip(0_i32..)
        .map(|(value, k)| (0.5 * f64::from(k), value))
        .collect();
    assert_eq!(lines.len(), expected.len());
    for (found, expected) in lines.iter().zip(&expected) {
        let off = (found.0 - expected.0).abs() + (found.1 - expected.1).abs();
        assert!(off < 1e-12, "{found:?} {expected:?}");
    }
    for (text, how, expected) in [
        ("t,x\n0,1\n1.02,4\n", "zero-order", "line 3: t = 1.02 given, expected a whole number of"),
        ("t,x\n0,1\n1.02,4\n", "zero-order", "1 or 1.5; or interpolation"),
        ("t,x\n0,1\n1,4\n1,5\n", "zero-order", "line 4: t = 1 given, expected more than 1"),
        ("t,x\n0.5,1\n1,4\n", "zero-order", "expected a first row for t = 0"),
        ("time,x\n0,1\n", "zero-order", "the columns time, x given, expected a column `t`"),
        ("t,x\n0,one\n", "zero-order", "line 2: `one` in the column `x`"),
        ("t,y\n0,1\n", "zero-order", "`y` is not known"),
        ("t,x\n0,1\n", "cubic", "`cubic` is not known; expected one of linear, zero-order"),
    ] {
        let found = parse(LOOP, &[&with(&file(text), how)]).unwrap_err();
        assert!(
            found.contains(expected) && found.contains("control.references"),
            "{text}: {found}"
        );
    }
    let missing = refused(
        "control.references={ x = { file = \"nowhere.csv\", interpolation = \"linear\" } }",
    );
    assert!(missing.contains("`control.references.x.file`: nowhere.csv ("), "{missing}");
}

/// What the plant and the models have is held over each step, from its start.
#[test]
fn parameters_are_functions_of_t() {
    let sets =
        ["control.parameter_schedule={ a = \"1 + t\" }", "control.plant_schedule={ b = \"t/2\" }"];
    let experiment = experiment(&sets);
    let model = experiment.model_schedule(0.5);
    let values = model.values.unwrap();
    assert_eq!((values.at(0)[0], values.at(3)[0], values.at(7)[0]), (1.0, 2.5, 4.5));
    let plants = experiment.plants_in_the_loop(0.5);
    assert_eq!(plants.len(), 8);
    let rate = |k: usize| {
        let mut dx = [0.0; 2];
        plants[k].plant.rhs(&[0.0, 0.0], &[1.0], &[], &mut dx);
        dx[1]
    };
    assert_eq!([rate(0), rate(3), rate(7)].to_vec(), [0.0, 0.75, 1.75]);
}

/// One that is measured is the plant's, whatever `control.parameters` says of it; one that is named
/// there has that value; the others are nominal.
#[test]
fn models_begin_with_what_is_measured() {
    let family = read("configs/four-tanks/family.toml");
    let pumps = "control.plant.four-tanks.pump=[2.7, 2.8]";
    for (set, expected) in [
        ("control.parameters={ k1 = 3.5, k2 = 3.6 }", [2.7, 3.6]),
        ("control.parameters={ k1 = 3.5 }", [2.7, 3.35]),
    ] {
        let sets = [pumps, set, "control.measured_parameters=[\"k1\"]"];
        assert_eq!(parse(&family, &sets).unwrap().model_parameters(), expected, "{set}");
    }
}

/// The bounds of `problem` at its first stage, by step.
fn bounds(sets: &[&str]) -> Vec<(usize, f64, f64)> {
    let experiment = experiment(sets);
    let (variables, control) = (experiment.plant.variables(), experiment.control.unwrap());
    let problem: NmpcProblem = control.problem(&variables, 0.5);
    let steps = control.bound_schedule.iter();
    let of = |step: &pinc_config::BoundStep| {
        let of = |side: &std::collections::BTreeMap<String, f64>, name| side.get(name).copied();
        let (low, high) = (of(&step.input_low, "u"), of(&step.state_high, "x"));
        #[expect(clippy::cast_possible_truncation, reason = "few steps")]
        let k = (step.start_s / 0.5).round() as usize;
        (k, low.unwrap_or(f64::NAN), high.unwrap_or(f64::NAN))
    };
    control.bound_schedule(&problem, &variables, 0.5).unwrap().unwrap();
    steps.map(of).collect()
}

/// Bounds hold at both ends of a step: the tighter one counts.
#[test]
fn bounds_are_functions_of_t() {
    let set = "control.bound_schedule={ state_high = { x = \"4 - t\" }, input_low = { u = \"-1 + t/8\" } }";
    let found = bounds(&[set]);
    assert_eq!(found.len(), 8);
    assert_eq!((found[0], found[3]), ((0, -0.9375, 3.5), (3, -0.75, 2.0)));
    let rising = bounds(&[
        "control.bound_schedule={ state_high = { x = \"1 + t\" }, input_low = { u = -0.5 } }",
    ]);
    assert_eq!((rising[0], rising[7]), ((0, -0.5, 1.0), (7, -0.5, 4.5)));
    let steps = "control.bound_schedule=[{ start_s = 1.0, state_high = { x = 2.0 }, input_low = { u = 0.0 } }]";
    assert_eq!(bounds(&[steps]), [(2, 0.0, 2.0)]);
    for (set, expected) in [
        (
            "[{ start_s = 1.0, state_high = { v = 2.0 } }]",
            "expected a bound of v in control.state_high",
        ),
        ("[{ start_s = 1.0, state_high = { y = 2.0 } }]", "`y` is not known; expected one of x, v"),
        ("[{ start_s = 1.0, input_low = { u = 2.0 } }]", "expected at most 1, its input_high"),
        (
            "[{ start_s = 1.02, input_low = { u = 0.0 } }]",
            "a whole number of steps of T = 0.5 s: 1 or 1.5",
        ),
        ("[{ start_s = 1.0 }, { start_s = 1.0 }]", "more than 1, the start before it"),
        ("[{ start_s = 4.0 }]", "less than the duration of the run"),
        ("[{ start_s = 1.0, state_high = { x = inf } }]", "expected a finite number"),
        ("{ states_high = { x = \"t\" } }", "did you mean `state_high`?"),
        ("{ state_high = \"t\" }", "expected a number, a function of t as text, or"),
    ] {
        let found = refused(&format!("control.bound_schedule={set}"));
        assert!(found.contains(expected) && found.contains("bound_schedule"), "{set}: {found}");
    }
}

/// A bound over the run starts with the value of `[control]` and changes where a step names it.
#[test]
fn a_bound_over_the_run_has_its_changes_only() {
    let steps = "control.bound_schedule=[{ start_s = 1.0, state_high = { x = 2.0 } }, \
                 { start_s = 1.5, input_low = { u = 0.25 } }, { start_s = 2.0, state_high = { x = 1.5 } }]";
    let experiment = experiment(&[steps]);
    let (variables, control) = (experiment.plant.variables(), experiment.control.unwrap());
    let [low, high] = control.bounds_over_time(Bounded::State(0), "x");
    assert_eq!(low, []);
    assert_eq!(high, [(0.0, 5.0), (1.0, 2.0), (2.0, 1.5)]);
    let [low, high] = control.bounds_over_time(Bounded::Input(0), "u");
    assert_eq!(low, [(0.0, -1.0), (1.5, 0.25)]);
    assert_eq!(high, [(0.0, 1.0)]);
    assert_eq!(control.bounds_over_time(Bounded::Output(0), "y"), [vec![], vec![]]);
    // The controller's bounds are the same: a step keeps what the steps before it changed.
    let problem = control.problem(&variables, 0.5);
    let rows = control.bound_schedule(&problem, &variables, 0.5).unwrap().unwrap();
    let at = |step| (rows.at(step, Bounded::State(0))[1], rows.at(step, Bounded::Input(0))[0]);
    let found: Vec<(f64, f64)> = [1, 2, 3, 4].map(at).to_vec();
    assert_eq!(found, [(5.0, -1.0), (2.0, -1.0), (2.0, 0.25), (1.5, 0.25)]);
}

#[test]
fn functions_that_cannot_be_used_are_refused() {
    for (set, expected) in [
        ("control.references={ x = \"2*tt\" }", "did you mean `t`?"),
        ("control.references={ x = \"2*(t\" }", "`control.references.x`"),
        ("control.references={ x = \"1/(t - 1)\" }", "inf at t = 1 given, expected finite numbers"),
        // A bound is looked up at both ends of a step.
        (
            "control.bound_schedule={ state_high = { x = \"9 + 0/(t - 0.5)\" } }",
            "NaN at t = 0.5 given, expected finite numbers",
        ),
        (
            "control.references={ y = \"t\" }",
            "`control.references`: `y` is not known; expected one of x",
        ),
        (
            "control.references={ file = \"day.csv\" }",
            "`control.references.interpolation`: missing; expected \"linear\" or \"zero-order\"",
        ),
        ("control.references={ x = [1.0] }", "expected a number, a function of t as text, or"),
        ("control.parameter_schedule={ c = \"t\" }", "`c` is not known; expected one of a"),
        ("control.parameter_preview=true", "control.parameter_schedule or control.measured"),
    ] {
        let found = refused(set);
        assert!(found.contains(expected), "{set}: {found}");
    }
    let long = ["control.references={ x = \"t\" }", "control.duration_s=5e4", "control.step_s=0.1"];
    assert!(parse(LOOP, &long).unwrap_err().contains("100000 steps at most; it has 500000"));
    let without = LOOP.replace("step_s = 0.5\n", "");
    let found = parse(&without, &["control.references={ x = \"t\" }"]).unwrap_err();
    assert!(found.contains("or also a step, control.step_s"), "{found}");
    let delayed = [
        "control.parameter_schedule={ a = \"1 + t\" }",
        "control.parameter_preview=true",
        "control.delay_steps=1",
    ];
    let found = parse(LOOP, &delayed).unwrap_err();
    assert!(found.contains("no such key with control.delay_steps"), "{found}");
}

/// What goes together at no time, or never, is refused at the key that says it.
#[test]
fn contradictions_are_refused() {
    const COST: &str = "control.cost.stage=\"u^2\"";
    for (sets, expected) in [
        (
            &["control.bound_schedule=[{ start_s = 1.0, input_low = { u = 2.0 } }]"][..],
            "`control.bound_schedule[0].input_low.u`: 2 given, expected at most 1, its input_high \
             from 1 s on",
        ),
        (
            &[
                "control.bound_schedule=[{ start_s = 1.0, input_high = { u = 0.5 } }, { start_s = 2.0, \
               input_low = { u = 0.4 } }, { start_s = 3.0, input_high = { u = 0.3 } }]",
            ],
            "`control.bound_schedule[2].input_high.u`: 0.3 given, expected at least 0.4, its \
             input_low from 3 s on",
        ),
        (
            &[COST, "control.cost.parameters.pi=3.0"],
            "`control.cost.parameters.pi`: the name `pi` is taken: the number pi",
        ),
        (
            &[COST, "control.cost.parameters.w=1.0"],
            "`control.cost.parameters.w`: no expression uses this parameter; remove it",
        ),
        (
            &["control.first_plan={ input = [9.0] }"],
            "`control.first_plan.input[0]`: 9 given, expected from input_low = -1 to input_high = 1",
        ),
        (
            &[COST, "control.sqp.hessian=gauss-newton"],
            "`control.sqp.hessian`: \"gauss-newton\" given, expected \"auto\" or \"adaptive\"",
        ),
        (
            &[
                "control.integer=[\"u\"]",
                "control.uncertainty={ probability = 0.9, process_sd = [0.1, 0.1] }",
            ],
            "`control.integer`: [\"u\"] given, expected no such key with control.uncertainty",
        ),
    ] {
        let refused = parse(LOOP, sets).unwrap_err();
        assert!(refused.contains(expected), "{refused}");
    }
}

/// A resolved config has steps; the trials of a sweep have the function, with their own length of a
/// step.
#[test]
fn schedules_survive_being_written_out_and_swept() {
    let sets = [
        "control.references={ x = \"t\" }",
        "control.bound_schedule={ state_high = { x = \"5 - t\" } }",
    ];
    let experiment = experiment(&sets);
    assert_eq!(parse(&experiment.to_toml(), &[]).unwrap(), experiment);
    let sweep = "[sweep]\ngrid = [{ key = \"control.step_s\", values = [0.5, 1.0] }]\n";
    let swept = parse(&format!("{LOOP}{sweep}"), &sets).unwrap();
    let trials = pinc_config::trials(&swept).unwrap();
    let steps: Vec<usize> = trials
        .iter()
        .map(|trial| trial.experiment.control.as_ref().unwrap().references.len())
        .collect();
    assert_eq!(steps, [8, 4]);
}

/// The states of the oscillator are its only outputs.
#[test]
fn bounds_on_outputs_need_outputs() {
    let oscillator = read("configs/van-der-pol/control.toml");
    for (set, key) in [
        (
            "control.bound_schedule=[{ start_s = 1.0, output_high = { x1 = 0.5 } }]",
            "control.bound_schedule[0].output_high.x1",
        ),
        ("control.output_softness=exact", "control.output_softness"),
        ("control.output_high=[1.0, 1.0]", "control.output_high"),
    ] {
        let error = parse(&oscillator, &[set]).unwrap_err();
        let expected = "expected no such key: the plant has no outputs that are not states";
        assert!(error.contains(&format!("`{key}`: ")) && error.contains(expected), "{error}");
    }
    let error = parse(&oscillator, &["control.duration_s=-3", "control.close_ups_s=[[0.0, 1.0]]"])
        .unwrap_err();
    assert!(error.contains("`control.duration_s`: -3 given"), "{error}");
}
