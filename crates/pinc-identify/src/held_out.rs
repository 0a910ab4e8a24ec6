//! A fit on data that it has not seen.

use crate::IdentifyError;
use crate::identify::identify;
use crate::problem::{Criterion, Problem, Recording};
use crate::result::outputs;
use crate::trajectory::{Evaluation, Trajectory};
use pinc_ode::Model;

/// How many steps of a recording are those to which the initial state is fitted where it is held
/// out: to the end of its first `rows` rows that have a measured value.
///
/// # Errors
///
/// [`IdentifyError::TooFewMeasurements`] if these do not determine a free initial state, and
/// [`IdentifyError::NothingHeldOut`] if no step is left behind them.
pub fn fitted_steps(
    problem: &Problem,
    recording: Recording<'_>,
    rows: usize,
) -> Result<usize, IdentifyError> {
    let channels = problem.channels.len();
    let given = recording.y.chunks_exact(channels).enumerate().filter_map(|(step, y)| {
        let values = y.iter().filter(|y| !y.is_nan()).count();
        (values > 0).then_some((step + 1, values))
    });
    let (steps, measurements) =
        given.take(rows).fold((0, 0), |(_, sum), (steps, values)| (steps, sum + values));
    let unknowns = problem.states.len();
    if problem.initial_state.is_free() && measurements <= unknowns {
        return Err(IdentifyError::TooFewMeasurements { measurements, unknowns });
    }
    if steps >= recording.rows(channels) {
        return Err(IdentifyError::NothingHeldOut { rows });
    }
    Ok(steps)
}

/// The measured quantities along a recording, `[rows, channels]`, as the model has them with the
/// parameters `p`, from an initial state on that is fitted to the first `rows` rows that have a
/// measured value, if the problem has a free one.
///
/// # Errors
///
/// As [`identify`] and [`fitted_steps`]; [`IdentifyError::NotFinite`] if the model has no finite
/// values to the end.
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
        let steps = fitted_steps(&known, recording, rows)?;
        let first = Recording {
            u: &recording.u[..steps * dims.nu],
            y: &recording.y[..steps * channels],
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
