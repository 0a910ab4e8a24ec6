//! Checks of single values, each by its key.

use super::{Checked, Problem};
use crate::problem::nearest;
use crate::registry::Variables;
use std::collections::BTreeMap;

pub(super) fn value(key: &str, found: impl ToString, expected: &str) -> Checked {
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

pub(super) fn at_least_one(key: &str, number: usize) -> Checked {
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

/// The lists `<key>_low` and `<key>_high`.
pub(super) fn bounds(
    key: &str,
    low: &[f64],
    high: &[f64],
    expected: usize,
    per: &'static str,
) -> Checked {
    length(&format!("{key}_low"), low, expected, per)?;
    length(&format!("{key}_high"), high, expected, per)?;
    for (i, (low, high)) in low.iter().zip(high).enumerate() {
        if low > high {
            let expected = format!("at most the upper end, {high}");
            return value(&format!("{key}_low[{i}]"), low, &expected);
        }
    }
    Ok(())
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

/// Checks that a time that is not negative is at least `least` whole steps; without T it may be
/// any.
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
        if !known.contains(name) {
            let (found, nearest) = (name.clone(), nearest(name, &known));
            return Err((key, Problem::Word { found, known, nearest }));
        }
        positive(&key, *tolerance)?;
    }
    Ok(())
}
