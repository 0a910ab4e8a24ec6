//! Checks of single values, each by its key.

use super::{Checked, Problem};
use crate::registry::Variables;
use crate::{ControlSpec, Experiment, ModelKind};
use std::collections::BTreeMap;

pub(crate) fn value(key: &str, found: impl ToString, expected: &str) -> Checked {
    let problem = Problem::Value { found: found.to_string(), expected: expected.to_owned() };
    Err((key.to_owned(), problem))
}

pub(super) fn present(section: &'static str, is: bool, needed: &'static str) -> Checked {
    if is { Ok(()) } else { Err((section.to_owned(), Problem::Section(needed))) }
}

pub(super) fn positive(key: &str, number: f64) -> Checked {
    if number > 0.0 { Ok(()) } else { value(key, number, "a positive number") }
}

pub(super) fn not_negative(key: &str, number: f64) -> Checked {
    if number >= 0.0 { Ok(()) } else { value(key, number, "0 or a positive number") }
}

pub(super) fn tolerance(key: &str, number: f64) -> Checked {
    if number > 0.0 && number < 1.0 {
        Ok(())
    } else {
        value(key, number, "a number between 0 and 1")
    }
}

pub(crate) fn at_least_one(key: &str, number: usize) -> Checked {
    if number > 0 { Ok(()) } else { value(key, number, "1 or more") }
}

pub(super) fn length(key: &str, values: &[f64], expected: usize, per: &'static str) -> Checked {
    let found = values.len();
    if found == expected { Ok(()) } else { wrong_length(key, found, expected, per) }
}

pub(super) fn wrong_length(key: &str, found: usize, expected: usize, per: &'static str) -> Checked {
    Err((key.to_owned(), Problem::Length { found, expected, per, names: Vec::new() }))
}

/// What there is one number of per controlled quantity.
pub(super) const CONTROLLED: &str = "controlled quantity";

/// What there is one number of per measured quantity.
pub(super) const MEASURED: &str = "measured quantity";

/// Checks each of some numbers, by its place in the list.
pub(super) fn each(key: &str, numbers: &[f64], check: fn(&str, f64) -> Checked) -> Checked {
    let mut numbers = numbers.iter().enumerate();
    numbers.try_for_each(|(i, &number)| check(&format!("{key}[{i}]"), number))
}

/// The lists `<key>low` and `<key>high`, each of which may be left out.
pub(super) fn bounds(
    key: &str,
    [low, high]: [Option<&[f64]>; 2],
    expected: usize,
    per: &'static str,
) -> Checked {
    for (side, numbers) in [("low", low), ("high", high)] {
        if let Some(numbers) = numbers {
            length(&format!("{key}{side}"), numbers, expected, per)?;
        }
    }
    let both = low.unwrap_or_default().iter().zip(high.unwrap_or_default());
    for (i, (&low, &high)) in both.enumerate() {
        ordered(&format!("{key}low[{i}]"), low, high)?;
    }
    Ok(())
}

/// Checks the lower end of a range.
pub(crate) fn ordered(key: &str, low: f64, high: f64) -> Checked {
    if low > high { value(key, low, &format!("at most the upper end, {high}")) } else { Ok(()) }
}

/// The place of a name among those known.
pub(super) fn place(key: &str, name: &str, known: &[String]) -> Result<usize, (String, Problem)> {
    let place = known.iter().position(|known| known == name);
    place.ok_or_else(|| (key.to_owned(), Problem::word(name, known)))
}

/// Checks that names are known, and each there once.
pub(super) fn names(key: &str, names: &[String], known: &[String]) -> Checked {
    distinct(|i| format!("{key}[{i}]"), names, known, ["", "each of them once"])
}

/// Checks that names are those of parameters of the plant, and each there once.
pub(super) fn parameters<'a>(
    key: impl Fn(usize) -> String,
    names: impl IntoIterator<Item = &'a String>,
    experiment: &Experiment,
) -> Checked {
    distinct(
        key,
        names,
        &experiment.plant.parameter_names(),
        [NO_PARAMETERS, "each parameter once"],
    )
}

/// What is expected of names of parameters that the plant does not have.
pub(super) const NO_PARAMETERS: &str = "no such key: the plant has no parameters that can vary";

/// Checks that names are known, and each there once; what is expected otherwise, or where none is
/// known, is given in words.
pub(super) fn distinct<'a>(
    key: impl Fn(usize) -> String,
    names: impl IntoIterator<Item = &'a String>,
    known: &[String],
    [none, once]: [&str; 2],
) -> Checked {
    let mut before = Vec::new();
    for (i, name) in names.into_iter().enumerate() {
        if known.is_empty() {
            return value(&key(i), format!("{name:?}"), none);
        }
        place(&key(i), name, known)?;
        if before.contains(&name) {
            return value(&key(i), format!("{name:?}"), once);
        }
        before.push(name);
    }
    Ok(())
}

/// Checks that a net in the loop knows a parameter that takes several values there.
pub(super) fn known_to_net(
    key: &str,
    found: impl ToString,
    name: &str,
    (experiment, control): (&Experiment, &ControlSpec),
) -> Checked {
    if control.models.contains(&ModelKind::Pinc) && !experiment.varying().contains(&name) {
        let expected = "one of domain.parameters, with the model \"pinc\": the net is of these";
        return value(key, found, expected);
    }
    Ok(())
}

/// Checks that none of the others is there beside a key or table, called `what`.
pub(super) fn alone(
    key: &str,
    found: impl ToString,
    what: &str,
    others: &[(&str, bool)],
) -> Checked {
    match others.iter().find(|(_, is_there)| *is_there) {
        Some((other, _)) => value(key, found, &format!("no such {what} with {other}")),
        None => Ok(()),
    }
}

/// Checks that a duration is a positive whole number of T, to a relative 1e-9.
pub(super) fn whole_steps(key: &str, duration_s: f64, sample_time_s: Option<f64>) -> Checked {
    positive(key, duration_s)?;
    multiple(key, duration_s, 1.0, sample_time_s)
}

/// Checks that a time is the beginning of a step, to a relative 1e-9: 0 or a multiple of T.
pub(super) fn step_mark(key: &str, time_s: f64, sample_time_s: Option<f64>) -> Checked {
    not_negative(key, time_s)?;
    multiple(key, time_s, 0.0, sample_time_s)
}

/// Checks that a time that is not negative is at least `least` whole steps; without T it may be any.
fn multiple(key: &str, time_s: f64, least: f64, sample_time_s: Option<f64>) -> Checked {
    let Some(sample_time_s) = sample_time_s else { return Ok(()) };
    let steps = time_s / sample_time_s;
    if steps.round() >= least && (steps - steps.round()).abs() <= 1e-9 * steps {
        return Ok(());
    }
    let [below, above] = [steps.floor(), steps.ceil()].map(|steps| rounded(steps * sample_time_s));
    let nearest = if steps < least { format!("{above}") } else { format!("{below} or {above}") };
    let expected = format!("a whole number of steps of T = {sample_time_s} s: {nearest}");
    value(key, time_s, &expected)
}

/// A number to 12 significant digits, so that a product shows no rounding.
pub(crate) fn rounded(number: f64) -> f64 {
    format!("{number:.11e}").parse().unwrap_or(number)
}

/// Positive numbers by the names of states.
pub(super) fn named_tolerances(
    key: &str,
    named: &BTreeMap<String, f64>,
    variables: &Variables,
) -> Checked {
    let known = variables.state_names();
    for (name, tolerance) in named {
        let key = format!("{key}.{name}");
        place(&key, name, &known)?;
        positive(&key, *tolerance)?;
    }
    Ok(())
}
