//! The settings of an estimator in a config.

use crate::common::{parse, read};
use pinc_estimate::Gate;

fn gate(set: &str) -> Result<Gate, String> {
    let tanks = read("configs/estimation/tanks.toml");
    let experiment = parse(&tanks, &[set])?;
    let control = experiment.control.unwrap();
    Ok(control.estimator.as_ref().unwrap().tuning(&control).gate)
}

#[test]
fn the_gate_is_a_width_or_off() {
    let of = |value: &str| gate(&format!("control.estimator.gate={value}"));
    assert_eq!(gate("seed=1"), Ok(Gate::Sd(30.0)));
    assert_eq!(of("5.5"), Ok(Gate::Sd(5.5)));
    assert_eq!(of("4"), Ok(Gate::Sd(4.0)));
    assert_eq!(of("off"), Ok(Gate::Off));
    assert_eq!(of("\"off\""), Ok(Gate::Off));
    let refused = |value: &str, said: &str| {
        let error = of(value).unwrap_err();
        assert!(error.contains("control.estimator.gate") && error.contains(said), "{error}");
    };
    for value in ["0", "0.0", "-1"] {
        refused(value, "a positive and finite number of standard deviations, or \"off\"");
    }
    for value in ["inf", "nan"] {
        refused(value, "expected a finite number");
    }
    for value in ["on", "Off", "true", "[]", "{ sd = 3.0 }"] {
        refused(value, "expected a number of standard deviations, or \"off\"");
    }
}

#[test]
fn a_gate_in_a_file_is_refused_with_its_place() {
    let tanks = read("configs/estimation/tanks.toml");
    for (gate, said) in [("0.0", "positive and finite"), ("\"wide\"", "expected a number")] {
        let text = tanks
            .replace("[control.estimator]\n", &format!("[control.estimator]\ngate = {gate}\n"));
        let error = parse(&text, &[]).unwrap_err();
        assert!(error.contains("test.toml") && error.contains("gate"), "{error}");
        assert!(error.contains(said), "{error}");
    }
}

/// A state moves between its bounds in the loop; without both of them, nothing is known.
#[test]
fn ranges_come_from_the_loops_bounds() {
    let tanks = read("configs/estimation/tanks.toml");
    let range = |sets: &[&str]| {
        let control = parse(&tanks, sets).unwrap().control.unwrap();
        control.estimator.as_ref().unwrap().tuning(&control).range
    };
    let (low, high) = ("control.state_low=[-1, 0, 2, 1]", "control.state_high=[3, 4, 2.5, 1]");
    assert_eq!(range(&[low, high]), [4.0, 4.0, 0.5, 0.0]);
    let control = parse(&tanks, &[]).unwrap().control.unwrap();
    let mut one_sided = control.clone();
    one_sided.state_high = Some(vec![20.0, f64::INFINITY, 20.0, 20.0]);
    one_sided.state_low = Some(vec![2.0, 2.0, f64::NEG_INFINITY, 5.0]);
    assert_eq!(one_sided.state_ranges(), [18.0, 0.0, 0.0, 15.0]);
    one_sided.state_low = None;
    assert!(one_sided.state_ranges().is_empty());
}

/// What one key says and another one takes back.
#[test]
fn keys_that_contradict_the_estimator_are_refused() {
    let oscillator = read("configs/van-der-pol/control.toml");
    let estimator = [
        "control.measurement={ measured = [\"x1\"] }",
        "control.estimator={ kind = \"ekf\", process_sd = [0.1, 0.1], measurement_sd = [0.1], \
         initial_estimate = [0.0, 0.0], initial_sd = [0.1, 0.1] }",
    ];
    let refused = |more: &[&str], expected: &str| {
        let error = parse(&oscillator, &[&estimator[..], more].concat()).unwrap_err();
        assert!(error.contains(expected), "{more:?}: {error}");
    };
    assert!(parse(&oscillator, &estimator).is_ok());
    let output = [
        "control.estimator.disturbance=output",
        "control.estimator.disturbance_sd=[0.1]",
        "control.estimator.disturbance_initial_sd=[0.1]",
        "control.cost={ stage = \"x1^2\" }",
    ];
    refused(
        &output,
        "`control.estimator.disturbance`: \"output\" given, expected another one with",
    );
    let target = [
        "control.target=true",
        "control.bound_schedule=[{ start_s = 5.0, input_high = { u = 0.5 } }]",
    ];
    refused(&target, "`control.target`: true given");
    let mu = |rest: &str| {
        let name = "name = \"mu\", initial_sd = 0.1, drift_sd = 0.0";
        format!("control.estimator.parameters=[{{ {name}, {rest} }}]")
    };
    let outside = mu("initial = 1.0, low = 1.2, high = 1.3");
    refused(
        &[&outside],
        "`control.estimator.parameters[0].initial`: 1 given, expected a value within its limits, 1.2 to 1.3",
    );
}

/// A value that no model would use.
#[test]
fn an_estimated_parameter_has_no_other_value() {
    let text = read("configs/estimation/adaptive.toml");
    let estimated = parse(&text, &[]).unwrap().control.unwrap().estimator.unwrap();
    let name = &estimated.parameters[0].name;
    let error = parse(&text, &[&format!("control.parameters={{ {name} = 1.0 }}")]).unwrap_err();
    assert!(
        error.contains(&format!("`control.parameters.{name}`: 1 given, expected no value")),
        "{error}"
    );
}

/// States first, then disturbances, then parameters: each with what the config says of it, and a
/// bound wherever any of them has one.
#[test]
fn numbers_of_the_estimator_are_those_of_all_that_is_estimated() {
    let text = read("configs/estimation/adaptive.toml");
    let experiment = parse(&text, &[]).unwrap();
    let mut control = experiment.control.unwrap();
    let mut spec = control.estimator.take().unwrap();
    spec.parameters.truncate(1);
    let of = &mut spec.parameters[0];
    (of.initial, of.initial_sd, of.drift_sd, of.low, of.high) = (1.5, 0.3, 0.07, None, Some(2.5));
    spec.initial_estimate = vec![1.0, 2.0];
    spec.initial_sd = vec![0.1, 0.2];
    spec.process_sd = vec![0.01, 0.02];
    (spec.disturbance_sd, spec.disturbance_initial_sd) = (vec![0.05], vec![0.5]);
    (spec.low, spec.high) = (None, None);
    let tuning = spec.tuning(&control);
    assert_eq!(tuning.initial_estimate, [1.0, 2.0, 0.0, 1.5]);
    assert_eq!(tuning.initial_sd, [0.1, 0.2, 0.5, 0.3]);
    assert_eq!(tuning.process_sd, [0.01, 0.02, 0.05, 0.07]);
    assert_eq!(tuning.high, [f64::INFINITY, f64::INFINITY, f64::INFINITY, 2.5]);
    assert!(tuning.low.is_empty(), "{:?}", tuning.low);
    spec.low = Some(vec![-3.0, f64::NEG_INFINITY]);
    let none = f64::NEG_INFINITY;
    assert_eq!(spec.tuning(&control).low, [-3.0, none, none, none]);
}
