//! Checks of `[control.measurement]` and `[control.estimator]`.

use super::values::{MEASURED, at_least_one, bounds, length, not_negative, positive, value};
use super::{Checked, Problem};
use crate::problem::nearest;
use crate::registry::Variables;
use crate::{
    ControlSpec, DisturbanceSpec, EstimatorKind, EstimatorSpec, Experiment, GateSpec,
    LoopParameters, ModelKind,
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
        names(&format!("{MEASUREMENT}.measured"), measured, &known)?;
    }
    if let Some(sd) = &measurement.noise_sd {
        let key = format!("{MEASUREMENT}.noise_sd");
        length(&key, sd, measured.len(), MEASURED)?;
        none_negative(&key, sd)?;
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
            let LoopParameters { values, estimated, .. } = experiment.loop_parameters();
            let parameters = (&values[..], &estimated[..]);
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
        none_negative(&key(name), sd)?;
    }
    length(&key("initial_estimate"), &spec.initial_estimate, states, "state")?;
    length(&key("measurement_sd"), &spec.measurement_sd, measured, MEASURED)?;
    for (i, &sd) in spec.measurement_sd.iter().enumerate() {
        positive(&key(&format!("measurement_sd[{i}]")), sd)?;
    }
    let disturbances = match &spec.disturbance {
        DisturbanceSpec::None => 0,
        DisturbanceSpec::Input => variables.inputs.len(),
        DisturbanceSpec::Output => measured,
        DisturbanceSpec::States(disturbed) => {
            names(&key("disturbance.states"), disturbed, &variables.state_names())?;
            disturbed.len()
        }
    };
    for (name, sd) in [
        ("disturbance_sd", &spec.disturbance_sd),
        ("disturbance_initial_sd", &spec.disturbance_initial_sd),
    ] {
        length(&key(name), sd, disturbances, "disturbance")?;
        none_negative(&key(name), sd)?;
    }
    for (name, side) in [("low", &spec.low), ("high", &spec.high)] {
        if let Some(side) = side {
            length(&key(name), side, states, "state")?;
        }
    }
    if let Some(GateSpec::Sd(sd)) = spec.gate
        && !(sd > 0.0 && sd.is_finite())
    {
        let expected = "a positive and finite number of standard deviations, or \"off\"";
        return value(&key("gate"), sd, expected);
    }
    if let (Some(low), Some(high)) = (&spec.low, &spec.high) {
        bounds(ESTIMATOR, low, high, states, "state")?;
    }
    match (spec.kind, spec.window) {
        (EstimatorKind::Mhe, None) => {
            value(&key("window"), "nothing", "the length of the window of mhe in steps")
        }
        (EstimatorKind::Mhe, Some(window)) => {
            at_least_one(&key("window"), window)?;
            let most = pinc_estimate::Mhe::LONGEST;
            if window <= most {
                Ok(())
            } else {
                value(&key("window"), window, &format!("at most {most}"))
            }
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
    let known: Vec<String> = experiment.plant.parameters().into_keys().collect();
    for (i, parameter) in spec.parameters.iter().enumerate() {
        let key = |name: &str| format!("{ESTIMATOR}.parameters[{i}].{name}");
        if known.is_empty() {
            let expected = "no such key: the plant has no parameters that can vary";
            return value(&key("name"), format!("{:?}", parameter.name), expected);
        }
        let twice = spec.parameters[..i].iter().any(|before| before.name == parameter.name);
        if twice {
            return value(&key("name"), format!("{:?}", parameter.name), "each parameter once");
        }
        if !known.contains(&parameter.name) {
            let nearest = nearest(&parameter.name, &known);
            let found = parameter.name.clone();
            return Err((key("name"), Problem::Word { found, known, nearest }));
        }
        not_negative(&key("initial_sd"), parameter.initial_sd)?;
        not_negative(&key("drift_sd"), parameter.drift_sd)?;
        if let (Some(low), Some(high)) = (parameter.low, parameter.high)
            && low > high
        {
            return value(&key("low"), low, &format!("at most the upper end, {high}"));
        }
        let of_the_net = experiment.varying().contains(&parameter.name.as_str());
        if control.models.contains(&ModelKind::Pinc) && !of_the_net {
            let expected = "one of domain.parameters, with the model \"pinc\": the net is of these";
            return value(&key("name"), format!("{:?}", parameter.name), expected);
        }
    }
    Ok(())
}

/// Names of which each is known and given once.
pub(super) fn names(key: &str, names: &[String], known: &[String]) -> Checked {
    if names.is_empty() {
        return value(key, "[]", &format!("one or more of {}", known.join(", ")));
    }
    for (i, name) in names.iter().enumerate() {
        let key = format!("{key}[{i}]");
        if !known.contains(name) {
            let (known, nearest) = (known.to_vec(), nearest(name, known));
            return Err((key, Problem::Word { found: name.clone(), known, nearest }));
        }
        if names[..i].contains(name) {
            return value(&key, format!("{name:?}"), "each of them once");
        }
    }
    Ok(())
}

fn none_negative(key: &str, numbers: &[f64]) -> Checked {
    let mut numbers = numbers.iter().enumerate();
    numbers.try_for_each(|(i, &number)| not_negative(&format!("{key}[{i}]"), number))
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
