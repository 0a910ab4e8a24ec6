//! The first plan of a loop, where the config gives one.

use crate::RunError;
use pinc_config::{ControlSpec, Variables};
use pinc_ode::PiecewiseConstant;
use pinc_record::{read_file, recorded_inputs};

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
    let signal = recorded_inputs(variables, &read_file(path)?);
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
