//! The first plan of a loop, where the config gives one.

use crate::RunError;
use pinc_config::{ControlSpec, Variables};
use pinc_ode::PiecewiseConstant;
use pinc_record::columns::{At, rows};
use pinc_record::{RecordedColumns, read_file};

/// The inputs of the first plan, `[Nu, m]`, if the config gives them.
pub(super) fn first_plan(
    spec: &ControlSpec,
    variables: &Variables,
    sample_time_s: f64,
) -> Result<Option<Vec<f64>>, RunError> {
    let Some(given) = &spec.first_plan else { return Ok(None) };
    if let Some(input) = &given.input {
        return Ok(Some(input.repeat(spec.nu)));
    }
    let Some(path) = &given.file else { return Ok(None) };
    let signal = recorded(variables, &read_file(path)?);
    let signal =
        signal.map_err(|(line, problem)| RunError::Csv { path: path.clone(), line, problem })?;
    let signal = PiecewiseConstant::new(signal.0, signal.1)?;
    let lengths = spec.stages(sample_time_s).into_iter();
    let lengths = lengths.flat_map(|(length, count)| std::iter::repeat_n(length, count));
    let mut begin = 0.0;
    let mut inputs = Vec::new();
    for length in lengths.take(spec.nu) {
        inputs.extend_from_slice(signal.at(begin));
        begin += length;
    }
    Ok(Some(inputs))
}

/// The times of a recording, counted from its first row, and its inputs.
fn recorded(variables: &Variables, text: &[u8]) -> Result<(Vec<f64>, Vec<Vec<f64>>), At> {
    let (header, rows) = rows(text)?;
    let columns = RecordedColumns::find(&header, variables, &[], (&[], &[]));
    let columns = columns.map_err(|problem| (1, problem))?.without_truth();
    let (mut times, mut inputs): (Vec<f64>, Vec<Vec<f64>>) = (Vec::new(), Vec::new());
    for row in rows {
        let (line, cells) = row?;
        let row = columns.read(&cells).map_err(|problem| (line, problem))?;
        // Inputs that hold on are one value.
        if inputs.last() != Some(&row.u) {
            times.push(row.t);
            inputs.push(row.u);
        }
    }
    let first = times.first().copied().unwrap_or(0.0);
    times.iter_mut().for_each(|t| *t -= first);
    Ok((times, inputs))
}
