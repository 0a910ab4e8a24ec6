//! Checks of single values, each by its key.

use super::{Finding, Problem};

pub(super) fn value(key: &str, found: impl ToString, expected: &str) -> Finding {
    let problem = Problem::Value { found: found.to_string(), expected: expected.to_owned() };
    Err((key.to_owned(), problem))
}

pub(super) fn present(section: &'static str, is: bool, needed: &'static str) -> Finding {
    if is { Ok(()) } else { Err((section.to_owned(), Problem::Section(needed))) }
}

pub(super) fn positive(key: &str, number: f64) -> Finding {
    if number > 0.0 { Ok(()) } else { value(key, number, "a positive number") }
}

pub(super) fn not_negative(key: &str, number: f64) -> Finding {
    if number >= 0.0 { Ok(()) } else { value(key, number, "0 or a positive number") }
}

pub(super) fn tolerance(key: &str, number: f64) -> Finding {
    if number > 0.0 && number < 1.0 {
        Ok(())
    } else {
        value(key, number, "a number between 0 and 1")
    }
}

pub(super) fn at_least_one(key: &str, number: usize) -> Finding {
    if number > 0 { Ok(()) } else { value(key, number, "1 or more") }
}

pub(super) fn length(key: &str, values: &[f64], expected: usize, per: &'static str) -> Finding {
    let found = values.len();
    if found == expected {
        Ok(())
    } else {
        Err((key.to_owned(), Problem::Length { found, expected, per }))
    }
}

/// The lists `<key>_low` and `<key>_high`.
pub(super) fn bounds(
    key: &str,
    low: &[f64],
    high: &[f64],
    expected: usize,
    per: &'static str,
) -> Finding {
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

/// Whether a duration is a positive whole number of T, to a relative 1e-9.
pub(super) fn whole_steps(key: &str, duration_s: f64, sample_time_s: Option<f64>) -> Finding {
    positive(key, duration_s)?;
    if let Some(sample_time_s) = sample_time_s {
        let steps = duration_s / sample_time_s;
        if steps.round() < 1.0 || (steps - steps.round()).abs() > 1e-9 * steps {
            let expected = format!("a whole number of steps of T = {sample_time_s} s");
            return value(key, duration_s, &expected);
        }
    }
    Ok(())
}
