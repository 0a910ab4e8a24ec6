//! The files of `[data]`: measured trajectories, or measured steps.

use crate::RunError;
use csv::StringRecord;
use pinc_config::Variables;
use pinc_net::{Measurements, Recorded};
use pinc_record::columns::{At, Row, finite, not_later, optional, places, rows};
use pinc_record::read_file;
use sha2::{Digest, Sha256};
use std::path::PathBuf;

/// What the files hold together, and their digest.
pub(crate) struct Data {
    pub(crate) measurements: Measurements,
    pub(crate) digest: [u8; 32],
}

/// Reads measurements for steps of `sample_time_s`. A file with a column `scenario` is one of
/// trajectories, with the columns of `pinc predict`; one with columns `<state>_0`, the states at t = 0,
/// is one of steps, with t, the inputs, and the states at t beside them. Any other is one trajectory,
/// whose states are called `y_<state>` as for `pinc identify`, or by their names.
///
/// # Errors
///
/// [`RunError`], naming file, line and column.
pub(crate) fn read(
    variables: &Variables,
    sample_time_s: f64,
    files: &[PathBuf],
) -> Result<Data, RunError> {
    let mut measurements = Measurements::new(variables.dims());
    let mut hash = Sha256::new();
    for path in files {
        let text = read_file(path)?;
        hash.update(&text);
        let before = measurements.values();
        parse(variables, sample_time_s, &text, &mut measurements)
            .map_err(|(line, problem)| RunError::Csv { path: path.clone(), line, problem })?;
        if measurements.values() == before {
            let problem = format!(
                "nothing to compare a net with: expected a row with all states, and within T = \
                 {sample_time_s} s of it, under the same input, one with a state"
            );
            return Err(RunError::usage(path.display(), problem));
        }
    }
    Ok(Data { measurements, digest: hash.finalize().into() })
}

fn parse(
    variables: &Variables,
    sample_time_s: f64,
    text: &[u8],
    to: &mut Measurements,
) -> Result<(), At> {
    let (header, rows) = rows(text)?;
    let states = variables.state_names();
    let has = |column: &str| header.iter().any(|found| found == column);
    // A state may itself be called `y_b` or `b_0`.
    let has_any = |name: fn(&String) -> String| {
        states.iter().map(name).any(|column| has(&column) && !states.contains(&column))
    };
    if has("scenario") {
        trajectories(variables, (sample_time_s, true, ""), &header, rows, to)
    } else if has_any(|state| format!("{state}_0")) {
        steps(variables, sample_time_s, &header, rows, to)
    } else {
        let prefix = if has_any(|state| format!("y_{state}")) { "y_" } else { "" };
        trajectories(variables, (sample_time_s, false, prefix), &header, rows, to)
    }
}

fn steps(
    variables: &Variables,
    sample_time_s: f64,
    header: &StringRecord,
    rows: impl Iterator<Item = Row>,
    to: &mut Measurements,
) -> Result<(), At> {
    let (inputs, states) = (variables.input_names(), variables.state_names());
    let initial: Vec<String> = states.iter().map(|name| format!("{name}_0")).collect();
    let names = [&["t".to_owned()][..], &inputs, &initial, &states].concat();
    let places = places(header, &names).map_err(|problem| (1, problem))?;
    let (m, n) = (inputs.len(), states.len());
    for row in rows {
        let (line, row) = row?;
        let at = |problem| (line, problem);
        let number = |i: usize| finite(&row[places[i]], &names[i]).map_err(at);
        let t = number(0)?;
        // At t = 0 the state is the row's own.
        if !(t > 0.0 && t <= sample_time_s * (1.0 + 1e-9)) {
            let expected = format!("more than 0, up to T = {sample_time_s} s");
            return Err(at(format!("column `t`: {t} s given, expected {expected}")));
        }
        let u = (1..=m).map(number).collect::<Result<Vec<_>, _>>()?;
        let y0 = (1 + m..=m + n).map(number).collect::<Result<Vec<_>, _>>()?;
        let measured = |i: usize| optional(&row[places[i]], &names[i]).map_err(at);
        let y = (1 + m + n..=m + 2 * n).map(measured).collect::<Result<Vec<_>, _>>()?;
        to.push(t.min(sample_time_s), &y0, &u, &[], &y);
    }
    Ok(())
}

/// Trajectories, by the names in a column `scenario`, or a single one without that column; the columns of
/// the states have `prefix` before their names.
fn trajectories(
    variables: &Variables,
    (sample_time_s, named, prefix): (f64, bool, &str),
    header: &StringRecord,
    rows: impl Iterator<Item = Row>,
    to: &mut Measurements,
) -> Result<(), At> {
    let (inputs, states) = (variables.input_names(), variables.state_names());
    let fixed = ["scenario".to_owned(), "t".to_owned()];
    let fixed = if named { &fixed[..] } else { &fixed[1..] };
    let measured: Vec<_> = states.iter().map(|name| format!("{prefix}{name}")).collect();
    let names = [fixed, &inputs, &measured].concat();
    let places = places(header, &names).map_err(|problem| (1, problem))?;
    let (first, m) = (fixed.len(), inputs.len());
    // In the order in which they begin, so that the sums of the loss have an order.
    let mut scenarios: Vec<(String, Vec<Recorded>)> = Vec::new();
    for row in rows {
        let (line, row) = row?;
        let at = |problem| (line, problem);
        let number = |i: usize| finite(&row[places[i]], &names[i]).map_err(at);
        let measured = |i: usize| optional(&row[places[i]], &names[i]).map_err(at);
        let t = number(first - 1)?;
        let input = (first..first + m).map(number).collect::<Result<_, _>>()?;
        let state = (first + m..names.len()).map(measured).collect::<Result<_, _>>()?;
        let name = if named { &row[places[0]] } else { "" };
        let known = scenarios.iter().position(|(other, _)| other == name);
        let place = known.unwrap_or(scenarios.len());
        if known.is_none() {
            scenarios.push((name.to_owned(), Vec::new()));
        }
        let recorded = &mut scenarios[place].1;
        if let Some(last) = recorded.last().filter(|last| t <= last.t) {
            return Err(at(not_later(t, last.t)));
        }
        recorded.push(Recorded { t, input, state });
    }
    for (_, recorded) in &scenarios {
        to.push_trajectory(sample_time_s, &[], recorded);
    }
    Ok(())
}
