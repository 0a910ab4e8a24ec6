//! Checks of what changes during a closed loop: parameters, bounds and loads.

use super::Checked;
use super::control::NO_OUTPUTS;
use super::values::{alone, distinct, place, step_mark, value, whole_steps};
use crate::{ControlSpec, Experiment, OnError, ParameterStep, Variables, steps};
use std::collections::BTreeMap;

/// Key of the parameters that the models are told.
const PARAMETERS: &str = "control.parameter_schedule";

/// Key of the bounds.
const BOUNDS: &str = "control.bound_schedule";

/// Key of the parameters that the plant in the loop has.
const PLANT: &str = "control.plant_schedule";

/// Key of the loads.
const LOADS: &str = "control.loads";

pub(super) fn schedules(experiment: &Experiment, spec: &ControlSpec) -> Checked {
    let varying: Vec<String> = experiment.varying().into_iter().map(str::to_owned).collect();
    let own = experiment.plant_in_the_loop().parameter_names();
    measured(spec, &varying)?;
    schedule(PARAMETERS, &spec.parameter_schedule, &varying, spec.duration_s)?;
    schedule(PLANT, &spec.plant_schedule, &own, spec.duration_s)?;
    let variables = experiment.plant.variables();
    bounds(spec, &variables)?;
    preview(spec)?;
    loads(spec, &variables)
}

/// Parameters that are known in advance.
fn preview(spec: &ControlSpec) -> Checked {
    let schedule = &spec.parameter_schedule;
    let key = "control.parameter_preview";
    if !spec.parameter_preview {
        return Ok(());
    }
    if schedule.is_empty() && spec.measured_parameters.is_empty() {
        let expected = "control.parameter_schedule or control.measured_parameters beside it";
        return value(key, "true", expected);
    }
    let others = [
        ("control.delay_steps", spec.delay_steps > 0),
        ("control.on_error = \"integrator\"", spec.on_error == OnError::Integrator),
    ];
    alone(key, "true", "key", &others)
}

/// Bounds that change.
fn bounds(spec: &ControlSpec, variables: &Variables) -> Checked {
    let starts = spec.bound_schedule.iter().map(|step| step.start_s);
    increasing(BOUNDS, starts, spec.duration_s)?;
    let names = [variables.state_names(), variables.input_names(), variables.own_output_names()];
    let mut now: BTreeMap<(&str, usize), f64> = BTreeMap::new();
    for (i, step) in spec.bound_schedule.iter().enumerate() {
        let (sides, mut given) = (step.sides(), Vec::new());
        for (at, ((side, bounds), known)) in sides.into_iter().zip(names.iter().cycle()).enumerate()
        {
            for (name, &number) in bounds {
                let key = format!("{BOUNDS}[{i}].{side}.{name}");
                if known.is_empty() {
                    return value(&key, number, NO_OUTPUTS);
                }
                let place = place(&key, name, known)?;
                if !spec.bound(at, place).is_some_and(f64::is_finite) {
                    let expected = format!("a bound of {name} in control.{side} to start from");
                    return value(&key, number, &expected);
                }
                now.insert((side, place), number);
                given.push((key, at, place, number));
            }
        }
        for (key, at, place, number) in given {
            // Upper bounds come after all lower ones.
            let is_low = at < names.len();
            let across = (at + names.len()) % sides.len();
            let (other, _) = sides[across];
            let bound = now.get(&(other, place)).copied();
            let bound = bound.or_else(|| spec.bound(across, place)).unwrap_or(f64::INFINITY);
            let crossed = if is_low { number > bound } else { number < bound };
            if crossed && bound.is_finite() {
                let limit = if is_low { "at most" } else { "at least" };
                let expected = format!("{limit} {bound}, its {other} from {} s on", step.start_s);
                return value(&key, number, &expected);
            }
        }
    }
    // The length of a step does not matter for what is checked here.
    let problem = spec.problem(variables, 1.0);
    let fine = 1e-12 * spec.duration_s;
    let Err(error) = spec.bound_schedule(&problem, variables, fine) else { return Ok(()) };
    value(BOUNDS, error, "lower bounds below upper bounds at all times")
}

/// Checks that the loop ends, and that everything in it begins and ends, with a step. Without T
/// every positive time may be the mark of a step.
pub(super) fn times(spec: &ControlSpec, sample_time_s: Option<f64>) -> Checked {
    whole_steps("control.duration_s", spec.duration_s, sample_time_s)?;
    if let Some(most) = sample_time_s.map(|length_s| steps(spec.duration_s, length_s) - 1)
        && spec.delay_steps > most
    {
        let expected = format!("at most {most}: no input would reach the plant within the run");
        return value("control.delay_steps", spec.delay_steps, &expected);
    }
    let starts_of = |changes: &[ParameterStep]| changes.iter().map(|of| of.start_s).collect();
    let starts: [(&str, Vec<f64>); 5] = [
        ("control.references", spec.references.iter().map(|of| of.start_s).collect()),
        (PARAMETERS, starts_of(&spec.parameter_schedule)),
        (PLANT, starts_of(&spec.plant_schedule)),
        (BOUNDS, spec.bound_schedule.iter().map(|of| of.start_s).collect()),
        (LOADS, spec.loads.iter().map(|of| of.start_s).collect()),
    ];
    for (key, starts) in starts {
        for (i, start_s) in starts.into_iter().enumerate() {
            step_mark(&format!("{key}[{i}].start_s"), start_s, sample_time_s)?;
        }
    }
    for (i, end_s) in spec.loads.iter().enumerate().filter_map(|(i, of)| Some((i, of.end_s?))) {
        whole_steps(&format!("{LOADS}[{i}].end_s"), end_s, sample_time_s)?;
    }
    Ok(())
}

fn loads(spec: &ControlSpec, variables: &Variables) -> Checked {
    for (i, load) in spec.loads.iter().enumerate() {
        let key = |name: &str| format!("{LOADS}[{i}].{name}");
        if load.start_s >= spec.duration_s {
            let expected = format!("less than the duration of the run, {}", spec.duration_s);
            return value(&key("start_s"), load.start_s, &expected);
        }
        if let Some(end_s) = load.end_s
            && end_s <= load.start_s
        {
            let expected = format!("more than {}, the start of the load", load.start_s);
            return value(&key("end_s"), end_s, &expected);
        }
        if load.inputs.is_empty() && load.rates.is_empty() {
            let expected = "what the load adds: `inputs = { .. }` or `rates = { .. }`";
            return value(&format!("{LOADS}[{i}]"), "nothing", expected);
        }
        for (table, found, known) in [
            ("inputs", &load.inputs, variables.input_names()),
            ("rates", &load.rates, variables.state_names()),
        ] {
            for name in found.keys() {
                place(&key(&format!("{table}.{name}")), name, &known)?;
            }
        }
    }
    Ok(())
}

/// Checks the parameters that are measured.
fn measured(spec: &ControlSpec, varying: &[String]) -> Checked {
    let measured = &spec.measured_parameters;
    let key = "control.measured_parameters";
    let none = "no such key: the models' parameters that vary are in [domain.parameters]";
    distinct(|i| format!("{key}[{i}]"), measured, varying, [none, "each parameter once"])?;
    let both = !measured.is_empty() && !spec.parameter_schedule.is_empty();
    let others = [("control.parameter_schedule, which gives them", both)];
    alone(key, format!("{measured:?}"), "key", &others)
}

fn schedule(key: &str, changes: &[ParameterStep], known: &[String], duration_s: f64) -> Checked {
    increasing(key, changes.iter().map(|change| change.start_s), duration_s)?;
    for (i, change) in changes.iter().enumerate() {
        for name in change.values.keys() {
            let key = format!("{key}[{i}].values.{name}");
            if known.is_empty() {
                let expected = "no such key: no parameters of the loop can vary; the models' \
                                parameters are in [domain.parameters]";
                return value(&key, name, expected);
            }
            place(&key, name, known)?;
        }
    }
    Ok(())
}

/// Checks the times from which on something holds.
pub(super) fn increasing(key: &str, starts: impl Iterator<Item = f64>, duration_s: f64) -> Checked {
    let mut before = None;
    for (i, start_s) in starts.enumerate() {
        let start = format!("{key}[{i}].start_s");
        if let Some(before) = before.filter(|before| start_s <= *before) {
            return value(&start, start_s, &format!("more than {before}, the start before it"));
        }
        if start_s >= duration_s {
            let expected = format!("less than the duration of the run, {duration_s}");
            return value(&start, start_s, &expected);
        }
        before = Some(start_s);
    }
    Ok(())
}
