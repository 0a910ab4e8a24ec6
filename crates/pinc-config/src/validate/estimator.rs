//! Checks of `[control.measurement]` and `[control.estimator]`.

use super::values::{
    MEASURED, at_least_one, bounds, each, known_to_net, length, names, not_negative, ordered,
    parameters, positive, value,
};
use super::{Checked, Problem};
use crate::registry::Variables;
use crate::{
    ControlSpec, DisturbanceSpec, EstimatorKind, EstimatorSpec, Experiment, GateSpec,
    LoopParameters,
};
use pinc_estimate::EstimateError;

/// The sections.
const MEASUREMENT: &str = "control.measurement";
const ESTIMATOR: &str = "control.estimator";

/// Both sections.
pub(super) fn output_feedback(
    experiment: &Experiment,
    spec: &ControlSpec,
    variables: &Variables,
) -> Checked {
    let measurement = spec.measurement.clone().unwrap_or_default();
    let mut known = variables.state_names();
    known.extend(variables.own_output_names());
    let measured = measurement.names(variables);
    if let Some(measured) = &measurement.measured {
        some_names(&format!("{MEASUREMENT}.measured"), measured, &known)?;
    }
    if let Some(sd) = &measurement.noise_sd {
        let key = format!("{MEASUREMENT}.noise_sd");
        length(&key, sd, measured.len(), MEASURED)?;
        each(&key, sd, not_negative)?;
    }
    match (&spec.estimator, &spec.measurement) {
        (None, None) => Ok(()),
        (None, Some(_)) => {
            let needed = "a controller that sees measurements needs [control.estimator]";
            Err((ESTIMATOR.to_owned(), Problem::Section(needed)))
        }
        (Some(estimator), _) => {
            tuned(estimator, variables, measured.len())?;
            unknown_parameters(estimator, spec, experiment)?;
            let LoopParameters { values, estimated, known, .. } = experiment.loop_parameters();
            let parameters = (&values[..], &estimated[..], &known[..]);
            let augmentation = estimator.augmentation(&measurement, variables, parameters);
            let dims = variables.dims().with_parameters(values.len());
            augmentation.validate(dims).map_err(|error| finding(&error))
        }
    }
}

/// The numbers of an estimator.
fn tuned(spec: &EstimatorSpec, variables: &Variables, measured: usize) -> Checked {
    let states = variables.states.len();
    let key = |name: &str| format!("{ESTIMATOR}.{name}");
    for (name, sd) in [("process_sd", &spec.process_sd), ("initial_sd", &spec.initial_sd)] {
        length(&key(name), sd, states, "state")?;
        each(&key(name), sd, not_negative)?;
    }
    length(&key("initial_estimate"), &spec.initial_estimate, states, "state")?;
    length(&key("measurement_sd"), &spec.measurement_sd, measured, MEASURED)?;
    each(&key("measurement_sd"), &spec.measurement_sd, positive)?;
    let disturbances = match &spec.disturbance {
        DisturbanceSpec::None => 0,
        DisturbanceSpec::Input => variables.inputs.len(),
        DisturbanceSpec::Output => measured,
        DisturbanceSpec::States(disturbed) => {
            some_names(&key("disturbance.states"), disturbed, &variables.state_names())?;
            disturbed.len()
        }
    };
    for (name, sd) in [
        ("disturbance_sd", &spec.disturbance_sd),
        ("disturbance_initial_sd", &spec.disturbance_initial_sd),
    ] {
        length(&key(name), sd, disturbances, "disturbance")?;
        each(&key(name), sd, not_negative)?;
    }
    if let Some(GateSpec::Sd(sd)) = spec.gate
        && !(sd > 0.0 && sd.is_finite())
    {
        let expected = "a positive and finite number of standard deviations, or \"off\"";
        return value(&key("gate"), sd, expected);
    }
    let is_alpha = |alpha: f64| spec.kind == EstimatorKind::Ukf && alpha > 0.0 && alpha <= 1.0;
    if let Some(alpha) = spec.alpha.filter(|alpha| !is_alpha(*alpha)) {
        return value(&key("alpha"), alpha, "more than 0, and 1 or less, for kind = \"ukf\" alone");
    }
    bounds(&key(""), [spec.low.as_deref(), spec.high.as_deref()], states, "state")?;
    match (spec.kind, spec.window) {
        (EstimatorKind::Mhe, None) => {
            value(&key("window"), "nothing", "the length of the window of mhe in steps")
        }
        (EstimatorKind::Mhe, Some(window)) => {
            at_least_one(&key("window"), window)?;
            let most = pinc_estimate::Mhe::LONGEST;
            let expected = format!("at most {most}");
            if window <= most { Ok(()) } else { value(&key("window"), window, &expected) }
        }
        (_, Some(window)) => value(&key("window"), window, "no such key: it is for kind = \"mhe\""),
        (_, None) => Ok(()),
    }
}

fn unknown_parameters(
    spec: &EstimatorSpec,
    control: &ControlSpec,
    experiment: &Experiment,
) -> Checked {
    let key = |i: usize, name: &str| format!("{ESTIMATOR}.parameters[{i}].{name}");
    let listed = spec.parameters.iter().map(|parameter| &parameter.name);
    parameters(|i| key(i, "name"), listed, experiment)?;
    for (i, parameter) in spec.parameters.iter().enumerate() {
        not_negative(&key(i, "initial_sd"), parameter.initial_sd)?;
        not_negative(&key(i, "drift_sd"), parameter.drift_sd)?;
        let [low, high] = [parameter.low, parameter.high];
        if let (Some(low), Some(high)) = (low, high) {
            ordered(&key(i, "low"), low, high)?;
        }
        let within = low.unwrap_or(f64::NEG_INFINITY)..=high.unwrap_or(f64::INFINITY);
        if !within.contains(&parameter.initial) {
            let expected =
                format!("a value within its limits, {} to {}", within.start(), within.end());
            return value(&key(i, "initial"), parameter.initial, &expected);
        }
        if let Some(fixed) = control.parameters.get(&parameter.name) {
            let expected = format!("no value: it is estimated, from `{}` on", key(i, "initial"));
            return value(&format!("control.parameters.{}", parameter.name), fixed, &expected);
        }
        let name = &parameter.name;
        if control.tells(name) {
            let expected = "a parameter that is neither measured nor in control.parameter_schedule";
            return value(&key(i, "name"), name, expected);
        }
        known_to_net(&key(i, "name"), format!("{name:?}"), name, (experiment, control))?;
    }
    Ok(())
}

/// Names of which each is known and given once.
pub(super) fn some_names(key: &str, given: &[String], known: &[String]) -> Checked {
    if given.is_empty() {
        return value(key, "[]", &format!("one or more of {}", known.join(", ")));
    }
    names(key, given, known)
}

/// A finding from an error of pinc-estimate.
fn finding(error: &EstimateError) -> (String, Problem) {
    let expected = match error {
        EstimateError::TooManyDisturbances { disturbances, measured } => format!(
            "at most one disturbance per measured quantity: {disturbances} cannot be told apart by \
             {measured} measured"
        ),
        other => other.to_string(),
    };
    let problem = Problem::Value { found: "its disturbances".to_owned(), expected };
    (format!("{ESTIMATOR}.disturbance"), problem)
}
