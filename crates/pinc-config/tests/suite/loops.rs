//! The control problem of a config, and what is refused of a closed loop.

use crate::common::{parse, read};
use pinc_config::{Experiment, Profile};
use pinc_mpc::Softness;
use pinc_ode::Variable;

fn experiment(config: &str, sets: &[&str]) -> Experiment {
    parse(&read(config), sets).unwrap_or_else(|error| panic!("{sets:?}: {error}"))
}

/// Each of these is refused with these words.
fn refused(config: &str, all: &[(&[&str], &str)]) {
    let text = read(config);
    for (sets, expected) in all {
        let error = parse(&text, sets).unwrap_err();
        assert!(error.contains(expected), "{sets:?}: {error}");
    }
}

const LOOP: &str = "configs/smoke/rk4-only.toml";

/// Of five stages of 10 s, the first counts 5*10 times and the last 10 times, in Q and in R.
#[test]
fn cumulative_weights_fall_along_the_horizon() {
    let sets = ["control.weights_profile=cumulative", "control.n2=5", "control.nu=3"];
    let experiment = experiment(LOOP, &sets);
    let problem = experiment.control.unwrap().problem(&experiment.plant.variables(), 10.0);
    let q = |i: usize| problem.weights.q.at(i).entry(0, 0);
    assert_eq!([0, 1, 2, 3, 4].map(q).to_vec(), [500.0, 400.0, 300.0, 200.0, 100.0]);
    let r = |i: usize| problem.weights.r.at(i).entry(0, 0);
    assert_eq!([0, 1, 2].map(r).to_vec(), [50.0, 40.0, 30.0]);
    assert_eq!(Profile::Uniform.factors(5, 10.0), None);
}

/// A state at the end of the horizon is held by both bounds of the last stage; all others are free.
#[test]
fn the_state_at_the_end_is_bounded_in_the_last_stage() {
    let experiment = experiment("configs/gallery/minimum-time.toml", &[]);
    let problem = experiment.control.unwrap().problem(&experiment.plant.variables(), 0.2);
    let (low, high) = (&problem.state_bounds.low, &problem.state_bounds.high);
    assert_eq!((low.len(), high.len()), (20, 20));
    assert!(low[..18].iter().all(|v| *v == f64::NEG_INFINITY), "{low:?}");
    assert!(high[..18].iter().all(|v| *v == f64::INFINITY), "{high:?}");
    assert_eq!((&low[18..], &high[18..]), (&[1.0, 0.0][..], &[1.0, 0.0][..]));
    assert_eq!(problem.end_states, [0, 1]);
}

/// Bounds and weights are given for outputs that are no states, and lie at the places of these.
#[test]
fn bounds_of_outputs_leave_out_those_that_are_states() {
    let experiment = experiment(LOOP, &[]);
    let mut variables = experiment.plant.variables();
    let [y, z] = ["y", "z"].map(|name| Variable::new(name, ""));
    variables.outputs = vec![y, variables.states[0].clone(), z];
    let mut control = experiment.control.unwrap();
    control.output_low = Some(vec![1.0, 2.0]);
    control.output_high = Some(vec![5.0, 6.0]);
    control.output_softness = Softness::Penalty(vec![7.0, 8.0]);
    let problem = control.problem(&variables, 10.0);
    let bounds = problem.output_bounds.unwrap();
    assert_eq!(bounds.low, [1.0, f64::NEG_INFINITY, 2.0]);
    assert_eq!(bounds.high, [5.0, f64::INFINITY, 6.0]);
    assert_eq!(problem.output_softness, Softness::Penalty(vec![7.0, 1.0, 8.0]));
}

/// A window begins in the run, and may end after it.
#[test]
fn windows_of_a_chart_begin_within_the_run() {
    let window = |window: &str| parse(&read(LOOP), &[&format!("control.close_ups_s=[{window}]")]);
    for right in ["[0.0, 10.0]", "[190.0, 200.0]", "[199.0, 300.0]"] {
        assert!(window(right).is_ok(), "{right}");
    }
    for wrong in ["[-1.0, 10.0]", "[200.0, 300.0]", "[10.0, 10.0]", "[20.0, 10.0]"] {
        let error = window(wrong).unwrap_err();
        let expected = "expected [from, to] with from within 0 to 200 s and less than to";
        assert!(error.contains("control.close_ups_s[0]") && error.contains(expected), "{error}");
    }
}

/// Two starts are several.
#[test]
fn several_starts_do_not_go_with_one_iteration_per_step() {
    let real_time = "control.sqp.real_time=true";
    refused(LOOP, &[(&["control.sqp.starts=2", real_time], "`control.sqp.starts`: 2 given")]);
    experiment(LOOP, &["control.sqp.starts=1", real_time]);
    experiment(LOOP, &["control.sqp.starts=2"]);
}

/// An input that stretches time is a factor: never 0, and with an upper bound.
#[test]
fn a_factor_on_time_is_positive() {
    let low = |low: &str| format!("control.input_low={{ acceleration = -1.0, stretch = {low} }}");
    let config = "configs/gallery/minimum-time.toml";
    let expected = "expected a positive number: stretch is a factor on lengths of stages";
    refused(config, &[(&[&low("0.0")], expected), (&[&low("-0.1")], expected)]);
    experiment(config, &[&low("0.01")]);
}

/// One disturbance per input or per measured quantity.
#[test]
fn disturbances_are_as_many_as_there_are_places_for() {
    let tanks = "configs/estimation/tanks.toml";
    let with = |kind: &str, count: usize| {
        let numbers =
            |key: &str| format!("control.estimator.disturbance{key}={:?}", vec![0.1; count]);
        let kind = format!("control.estimator.disturbance={kind}");
        let measured = "control.measurement.measured=[\"h1\", \"h2\", \"h3\"]".to_owned();
        let sd = "control.estimator.measurement_sd=[0.1, 0.1, 0.1]".to_owned();
        let noise = "control.measurement.noise_sd=[0.1, 0.1, 0.1]".to_owned();
        let sets = [kind, numbers("_sd"), numbers("_initial_sd"), measured, sd, noise];
        let sets: Vec<&str> = sets.iter().map(String::as_str).collect();
        parse(&read(tanks), &sets)
    };
    for (kind, count) in [("none", 0), ("input", 2), ("output", 3), ("{ states = [\"h4\"] }", 1)] {
        with(kind, count).unwrap_or_else(|error| panic!("{kind}: {error}"));
        let error = with(kind, count + 1).unwrap_err();
        let expected = format!("{} values given, expected {count}", count + 1);
        assert!(error.contains(&expected), "{kind}: {error}");
    }
}

/// Models are told what is measured of the plant when it changes, and nothing else of it.
#[test]
fn models_are_told_the_changes_of_measured_parameters_alone() {
    let experiment = experiment(
        "configs/four-tanks/family.toml",
        &[
            "control.measured_parameters=[\"k2\"]",
            "control.plant_schedule=[{ start_s = 100.0, values = { k1 = 3.1, k2 = 3.2 } }, \
             { start_s = 200.0, values = { k1 = 3.0 } }]",
        ],
    );
    let schedule = experiment.model_schedule(10.0);
    assert_eq!(schedule.names, ["k1", "k2"]);
    let values = schedule.values.unwrap();
    let at = |step: usize| values.at(step).to_vec();
    assert_eq!([0, 9, 10, 25].map(at), [[2.664, 2.68], [2.664, 2.68], [2.664, 3.2], [2.664, 3.2]]);
}

/// The loop's steps are those of the first stage, however long the net's are.
#[test]
fn functions_of_time_are_looked_up_at_control_steps() {
    let sets = ["control.references={ h1 = \"t\", h2 = 1 }", "control.duration_s=50"];
    let control = experiment("configs/four-tanks/few-stages.toml", &sets).control.unwrap();
    let found: Vec<_> = control.references.iter().map(|r| (r.start_s, r.value[0])).collect();
    assert_eq!(found, [(0.0, 10.0), (10.0, 20.0), (20.0, 30.0), (30.0, 40.0), (40.0, 50.0)]);
}
