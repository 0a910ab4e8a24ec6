//! A fit on data that it has not seen.

use crate::IdentifyError;
use crate::identify::identify;
use crate::problem::{Criterion, Problem, Recording};
use crate::result::outputs;
use crate::trajectory::{Evaluation, Trajectory};
use pinc_ode::Model;

/// The measured quantities along a recording, `[rows, channels]`, as the model has them with the
/// parameters `p`, from an initial state on that is fitted to the first `rows` of them if the
/// problem has a free one.
///
/// # Errors
///
/// As [`identify`]; [`IdentifyError::NotFinite`] if the model has no finite values to the end.
///
/// # Panics
///
/// If a method of the model does.
pub fn simulate_held_out(
    model: &mut dyn Model,
    problem: &Problem,
    p: &[f64],
    recording: Recording<'_>,
    rows: usize,
) -> Result<Vec<f64>, IdentifyError> {
    let (dims, channels) = (model.dims(), problem.channels.len());
    let (parameters, unknown, criterion) = (p.to_vec(), Vec::new(), Criterion::Chosen);
    let known = Problem { parameters, unknown, criterion, ..problem.clone() };
    let all = recording.rows(channels);
    let mut x = known.initial_state.values().to_vec();
    if known.initial_state.is_free() {
        let rows = rows.min(all);
        let first = Recording {
            u: &recording.u[..rows * dims.nu],
            y: &recording.y[..rows * channels],
            ..recording
        };
        let found = identify(model, &known, &[first])?;
        x = found.initial_states[0].iter().map(|of| of.value).collect();
    }
    let mut with = Evaluation::new(model);
    let mut to = Trajectory::new(dims.nx, all, 1);
    with.simulate(&known, recording, (&[0], &x, p), &mut to);
    if !to.is_finite() {
        return Err(IdentifyError::NotFinite { recording: 0 });
    }
    Ok(outputs(&known, recording, (&to, p), &mut with))
}
