//! Checks of `[control]`.

use super::values::{
    CONTROLLED, alone, at_least_one, bounds, each, length, named_tolerances, names, not_negative,
    positive, tolerance, value, wrong_length,
};
use super::{Checked, Problem, cost, schedule::increasing};
use crate::registry::Variables;
use crate::{ControlSpec, ModelKind, OnError};
use pinc_mpc::{MpcError, NmpcProblem, Softness, Weight};
use pinc_ode::{ArgumentError, Integrator};

/// What is expected of bounds on outputs where there are none.
pub(super) const NO_OUTPUTS: &str = "no such key: the plant has no outputs that are not states";

/// `[control]`.
pub(super) fn closed_loop(spec: &ControlSpec, variables: &Variables) -> Checked {
    let (states, inputs) = (variables.states.len(), variables.inputs.len());
    models(spec)?;
    positive("control.duration_s", spec.duration_s)?;
    plant_in_the_loop(spec, variables)?;
    if let Some(step_s) = spec.step_s {
        positive("control.step_s", step_s)?;
    }
    length("control.initial_state", &spec.initial_state, states, "state")?;
    if let Some(input) = &spec.initial_input {
        length("control.initial_input", input, inputs, "input")?;
    }
    first_plan(spec, inputs)?;
    cost::parts(spec)?;
    controlled(spec, variables)?;
    horizons(spec)?;
    weights("control.q", &spec.q, spec.controlled.len(), CONTROLLED)?;
    weights("control.r", &spec.input_weight(inputs), inputs, "input")?;
    let terminal = spec.q_terminal.as_ref();
    terminal
        .map_or(Ok(()), |q| weights("control.q_terminal", q, spec.controlled.len(), CONTROLLED))?;
    input_differences(spec, inputs)?;
    let sides = [&spec.input_low, &spec.input_high].map(|side| Some(&side[..]));
    bounds("control.input_", sides, inputs, "input")?;
    let sides = [spec.state_low.as_deref(), spec.state_high.as_deref()];
    bounds("control.state_", sides, states, "state")?;
    output_bounds(spec, variables)?;
    close_ups(spec)?;
    error_tolerance(spec, variables)?;
    verdict(spec)?;
    for integrator in Integrator::ALL {
        let key = format!("control.{}", ControlSpec::substeps_key(integrator));
        at_least_one(&key, spec.own_substeps(integrator))?;
    }
    at_least_one("control.repetitions", spec.repetitions)?;
    tolerance("control.plant_tolerance", spec.plant_tolerance)?;
    positive("control.sqp.tolerance", spec.sqp.tolerance)?;
    at_least_one("control.sqp.max_iterations", spec.sqp.max_iterations)?;
    starts(spec)?;
    if let Some(budget_us) = spec.budget_us {
        positive("control.budget_us", budget_us)?;
    }
    references(spec)?;
    // The length of a step does not matter for what is checked here.
    let problem = spec.problem(variables, 1.0);
    problem.validate(variables.dims()).map_err(|error| mpc_finding(&error))?;
    initial_input(spec, &problem)
}

fn output_bounds(spec: &ControlSpec, variables: &Variables) -> Checked {
    let outputs = variables.own_outputs().len();
    let sides = [spec.output_low.as_deref(), spec.output_high.as_deref()];
    let mut given = ["low", "high"].into_iter().zip(sides);
    let given = given.find_map(|(key, side)| side.map(|side| (key, format!("{side:?}"))));
    let soft = (spec.output_softness != Softness::Hard)
        .then(|| ("softness", format!("{:?}", spec.output_softness).to_lowercase()));
    if let Some((key, found)) = given.or(soft).filter(|_| outputs == 0) {
        return value(&format!("control.output_{key}"), found, NO_OUTPUTS);
    }
    bounds("control.output_", sides, outputs, "output")?;
    if let Softness::Penalty(weights) = &spec.output_softness {
        length("control.output_softness.penalty", weights, outputs, "output")?;
    }
    Ok(())
}

fn error_tolerance(spec: &ControlSpec, variables: &Variables) -> Checked {
    named_tolerances("control.error_tolerance", &spec.error_tolerance, variables)?;
    if !spec.error_tolerance.is_empty() && !spec.models.contains(&ModelKind::Pinc) {
        let expected = "\"pinc\" among control.models: it judges steps of a net";
        return value("control.error_tolerance", "a table", expected);
    }
    if spec.error_tolerance.is_empty() && spec.on_error != OnError::Count {
        let expected = "a table `control.error_tolerance` beside it";
        return value("control.on_error", format!("{:?}", spec.on_error).to_lowercase(), expected);
    }
    Ok(())
}

fn starts(spec: &ControlSpec) -> Checked {
    at_least_one("control.sqp.starts", spec.sqp.starts)?;
    let several = |is_there| is_there && spec.sqp.starts > 1;
    let (real_time, uncertain) = (several(spec.sqp.real_time), several(spec.uncertainty.is_some()));
    let others = [("sqp.real_time", real_time), ("[control.uncertainty]", uncertain)];
    alone("control.sqp.starts", spec.sqp.starts, "number", &others)
}

/// What is judged of a loop.
fn verdict(spec: &ControlSpec) -> Checked {
    let share = spec.max_failed_share;
    if !(0.0..=1.0).contains(&share) {
        return value("control.max_failed_share", share, "a share from 0 to 1");
    }
    let Some(within) = &spec.settled_within else { return Ok(()) };
    length("control.settled_within", within, spec.controlled.len(), CONTROLLED)?;
    each("control.settled_within", within, positive)
}

fn models(spec: &ControlSpec) -> Checked {
    let twice = |kind: ModelKind| spec.models.iter().filter(|&&m| m == kind).count() > 1;
    if spec.models.is_empty() || spec.models.iter().any(|&kind| twice(kind)) {
        let names: Vec<_> = spec.models.iter().map(|m| m.name()).collect();
        let known = ModelKind::ALL.map(|model| format!("\"{}\"", model.name())).join(", ");
        let expected = &format!("one or more of {known}, each once");
        return value("control.models", format!("{names:?}"), expected);
    }
    if spec.models.contains(&ModelKind::Policy) {
        if spec.policy.is_none() {
            let expected = "a file: the model \"policy\" reads it";
            return value("control.policy", "nothing", expected);
        }
        if spec.models.len() == 1 {
            let expected = "another model too, which checks the plans";
            return value("control.models", "[\"policy\"]", expected);
        }
    }
    Ok(())
}

/// Checks that a move within its bounds leads from the input before the loop to the input's bounds.
fn initial_input(spec: &ControlSpec, problem: &NmpcProblem) -> Checked {
    let before = problem.input_bounds.before(&problem.increment_bounds);
    for (i, (least, most)) in before.low.iter().zip(&before.high).enumerate() {
        let given = spec.initial_input.as_ref().map_or(0.0, |input| input[i]);
        if !(least..=most).contains(&&given) {
            let expected = format!("{least} to {most}, from where a move leads to its bounds");
            return value(&format!("control.initial_input[{i}]"), given, &expected);
        }
    }
    Ok(())
}

fn close_ups(spec: &ControlSpec) -> Checked {
    for (i, window) in spec.close_ups_s.iter().enumerate() {
        let [from, to] = *window;
        if !(0.0 <= from && from < to && from < spec.duration_s) {
            let last = spec.duration_s;
            let expected = format!("[from, to] with from within 0 to {last} s and less than to");
            return value(&format!("control.close_ups_s[{i}]"), format!("{window:?}"), &expected);
        }
    }
    Ok(())
}

fn controlled(spec: &ControlSpec, variables: &Variables) -> Checked {
    let mut known = variables.state_names();
    known.extend(variables.own_output_names());
    known.extend(variables.input_names());
    names("control.controlled", &spec.controlled, &known)
}

fn first_plan(spec: &ControlSpec, inputs: usize) -> Checked {
    match spec.first_plan.as_ref().map(|plan| (&plan.input, &plan.file)) {
        None | Some((None, Some(_))) => Ok(()),
        Some((Some(input), None)) => applied("control.first_plan.input", input, spec, inputs),
        Some((Some(_), Some(_)) | (None, None)) => {
            value("control.first_plan", "both or neither", "one of `input` and `file`")
        }
    }
}

/// Checks inputs that are applied: they are within their bounds.
fn applied(key: &str, input: &[f64], spec: &ControlSpec, inputs: usize) -> Checked {
    length(key, input, inputs, "input")?;
    let bounds = spec.input_low.iter().zip(&spec.input_high);
    for (i, (u, (low, high))) in input.iter().zip(bounds).enumerate() {
        if !(low..=high).contains(&u) {
            let expected = format!("from input_low = {low} to input_high = {high}");
            return value(&format!("{key}[{i}]"), u, &expected);
        }
    }
    Ok(())
}

fn horizons(spec: &ControlSpec) -> Checked {
    at_least_one("control.n2", spec.n2)?;
    for (key, steps) in [("control.n1", spec.n1), ("control.nu", spec.nu)] {
        if !(1..=spec.n2).contains(&steps) {
            return value(key, steps, &format!("from 1 to n2 = {}", spec.n2));
        }
    }
    Ok(())
}

fn input_differences(spec: &ControlSpec, inputs: usize) -> Checked {
    for (i, difference) in spec.input_differences.iter().enumerate() {
        let key = format!("control.input_differences[{i}]");
        let last = i64::try_from(spec.nu).unwrap_or(i64::MAX) - 1;
        for (place, input) in difference.between.iter().enumerate() {
            if !(-1..=last).contains(input) {
                let expected = format!(
                    "from -1, the input applied last, to nu - 1 = {last}, the last free one"
                );
                return value(&format!("{key}.between[{place}]"), input, &expected);
            }
        }
        weights(&format!("{key}.weight"), &difference.weight, inputs, "input")?;
    }
    Ok(())
}

fn references(spec: &ControlSpec) -> Checked {
    if let Some(first) = spec.references.first().filter(|first| first.start_s != 0.0) {
        let expected = "0: the run begins with the first reference";
        return value("control.references[0].start_s", first.start_s, expected);
    }
    let starts = spec.references.iter().map(|step| step.start_s);
    increasing("control.references", starts, f64::INFINITY)?;
    spec.references.iter().enumerate().try_for_each(|(i, step)| {
        let key = format!("control.references[{i}].value");
        length(&key, &step.value, spec.controlled.len(), CONTROLLED)
    })
}

/// The plant in the loop: it has the states and inputs of the one that the models are of.
fn plant_in_the_loop(spec: &ControlSpec, variables: &Variables) -> Checked {
    let Some(real) = &spec.plant else { return Ok(()) };
    let found = real.variables();
    for (what, found, expected) in [
        ("states", found.state_names(), variables.state_names()),
        ("inputs", found.input_names(), variables.input_names()),
        ("outputs", found.output_names(), variables.output_names()),
    ] {
        if found != expected {
            let expected = format!("one with the {what} {}", expected.join(", "));
            let found = format!("a plant with the {what} {}", found.join(", "));
            return value("control.plant", found, &expected);
        }
    }
    Ok(())
}

/// A finding from an error of pinc-mpc about the control problem.
fn mpc_finding(error: &MpcError) -> (String, Problem) {
    let (field, found, expected) = match error {
        MpcError::Argument(ArgumentError::Number { field, value, expected, .. }) => {
            (*field, value.to_string(), (*expected).to_owned())
        }
        MpcError::Argument(ArgumentError::Length { field, found, expected }) => {
            (*field, format!("{found} numbers"), format!("{expected}"))
        }
        MpcError::Range { field, found, low, high } => {
            (*field, found.to_string(), format!("from {low} to {high}"))
        }
        MpcError::CrossedBounds { field, index, low, high } => {
            let found = format!("{low} above {high} at place {index}");
            (*field, found, "no lower bound above its upper one".to_owned())
        }
        MpcError::NotSymmetric { field, .. } => {
            (*field, "rows".into(), "a symmetric matrix".into())
        }
        MpcError::NotSemidefinite { field } => {
            (*field, "rows".into(), "a positive semidefinite matrix".into())
        }
        other => ("", "values".into(), other.to_string()),
    };
    let key = match field {
        "weights.q" => "control.q",
        "weights.r" => "control.r",
        "weights.terminal" => "control.q_terminal",
        "weights.input_sequence" => "control.input_differences",
        "state_softness" => "control.state_softness.penalty",
        "output_softness" => "control.output_softness.penalty",
        "increment_bounds" => "control.increment_low, control.increment_high",
        "delay" => "control.delay_steps",
        _ => "control",
    };
    (key.to_owned(), Problem::Value { found, expected })
}

fn weights(key: &str, weight: &Weight, expected: usize, per: &'static str) -> Checked {
    let diagonal = match weight {
        Weight::Diagonal(diagonal) => diagonal,
        Weight::Full(rows) => {
            let lengths = rows.iter().map(Vec::len).chain([rows.len()]);
            let wrong = lengths.into_iter().find(|found| *found != expected);
            return wrong.map_or(Ok(()), |found| wrong_length(key, found, expected, per));
        }
    };
    length(key, diagonal, expected, per)?;
    each(key, diagonal, not_negative)
}
