//! The fit in one call: single or multiple shooting, and what is made of its end.

use crate::IdentifyError;
use crate::fit::{Fit, FitStatus};
use crate::method::{Method, Why, segments};
use crate::problem::{Criterion, InitialState, Problem, Recording};
use crate::result::Identified;
use crate::shooting::{Nodes, Shooting};
use crate::starts::Start;
use crate::trajectory::{Evaluation, Trajectory};
use crate::whiteness::of_neighbours;
use pinc_estimate::Measured;
use pinc_ode::{Dims, Model, OutputLinearizationBuffer, Stages};
use std::borrow::Cow;

/// Sensitivities to the initial state, in scales of the states, from which on single shooting is
/// not tried.
const SENSITIVE: f64 = 1e4;
/// The correlation of neighbouring residuals from which on another fit is looked for.
const CORRELATED: f64 = 0.5;

/// Finds the parameters and initial states for which the model is nearest to the recordings, by
/// nonlinear least squares: the sum of the squares of all residuals, divided by the standard
/// deviations of their channels, is smallest within the bounds.
///
/// The method is Gauss-Newton, damped as by Levenberg and Marquardt (Moré, "The Levenberg-Marquardt
/// algorithm: implementation and theory", Lecture Notes in Mathematics 630 (1978)), with the exact
/// derivatives of the model. By single shooting the model runs from the initial state to the end of
/// a recording; by multiple shooting (Bock, "Numerical treatment of inverse problems in chemical
/// reaction kinetics", Springer Series in Chemical Physics 18 (1981)) recordings are cut into
/// segments, each with an initial state of its own, which are fitted one by one at first, and then
/// with the gaps between them closed. [`Identified::method`] says which it was, and why:
///
/// - multiple shooting, if the model from the start is not finite to the end of a recording, or
///   depends on its initial state more than ten-thousandfold;
/// - otherwise single shooting; but if this does not converge, or leaves residuals that hang
///   together, multiple shooting is tried as well, and the better fit is taken.
///
/// # Errors
///
/// [`IdentifyError`] if problem, model and recordings do not fit together, or the model has no
/// finite value at the start.
///
/// # Panics
///
/// If a method of the model does.
pub fn identify(
    model: &mut dyn Model,
    problem: &Problem,
    recordings: &[Recording<'_>],
) -> Result<Identified, IdentifyError> {
    from_own_start(Evaluation::new(model), problem, recordings)
}

/// [`identify`], which may be interrupted.
pub(crate) fn from_own_start(
    mut with: Evaluation<'_>,
    problem: &Problem,
    recordings: &[Recording<'_>],
) -> Result<Identified, IdentifyError> {
    let problem = &*checked(problem, recordings, &mut with)?;
    let begun = Begun::at(problem.start(), problem, recordings, &mut with);
    let start = begun.start.clone();
    let finished = begun.finish(problem, recordings, &mut with);
    if with.is_interrupted() {
        return Err(IdentifyError::Interrupted);
    }
    let (fit, method) = finished?;
    let starts = vec![Start::of(problem, &fit)];
    Ok(Identified::of(problem, (fit, method), starts, &start, &mut with))
}

/// The problem, with K if its criterion has one.
pub(crate) fn checked<'p>(
    problem: &'p Problem,
    recordings: &[Recording<'_>],
    with: &mut Evaluation<'_>,
) -> Result<Cow<'p, Problem>, IdentifyError> {
    problem.validate(with.dims)?;
    problem.validate_data(with.dims, recordings)?;
    if problem.criterion != Criterion::PredictionError {
        return Ok(Cow::Borrowed(problem));
    }
    let p = problem.start();
    let scale = scale(&guess(problem, recordings[0], &p, with));
    let problem = problem.with_gains(&first_gains(problem, &scale, recordings[0], &p, with));
    problem.validate_data(with.dims, recordings)?;
    Ok(Cow::Owned(problem))
}

/// The K from which a fit starts, `[nx, channels]`: each measurement moves the state by as little as
/// makes the model's quantity half of the way to it, with states in their `scale`.
fn first_gains(
    problem: &Problem,
    scale: &[f64],
    recording: Recording<'_>,
    p: &[f64],
    with: &mut Evaluation<'_>,
) -> Vec<f64> {
    let (Dims { nx, nu, .. }, channels) = (with.dims, problem.channels.len());
    let zeros = |count: usize| vec![0.0; count];
    let mut outputs = OutputLinearizationBuffer::new(with.dims, 1);
    with.model.linearize_output(
        Stages { x: problem.initial_state.values(), u: recording.input_read(0, nu), p },
        outputs.as_mut(),
    );
    let mut gains = zeros(nx * channels);
    for (i, channel) in problem.channels.iter().enumerate() {
        let row: Vec<f64> = match channel.measured {
            Measured::Output(place) => outputs.c[place * nx..(place + 1) * nx].to_vec(),
            Measured::State(place) => (0..nx).map(|at| f64::from(u8::from(at == place))).collect(),
            _ => zeros(nx),
        };
        let size: f64 = row.iter().zip(scale).map(|(c, scale)| (c * scale).powi(2)).sum();
        for (state, (c, scale)) in row.iter().zip(scale).enumerate() {
            let gain = 0.5 * c * scale * scale / size;
            gains[state * channels + i] = if gain.is_finite() { gain } else { 0.0 };
        }
    }
    gains
}

/// A fit by single shooting under way, with the model's trajectories from its start.
pub(crate) struct Begun<'a> {
    pub(crate) fit: Fit<'a>,
    pub(crate) start: Vec<Trajectory>,
    /// Where it began.
    p: Vec<f64>,
    /// Whether the linearization at the start is finite.
    linear: bool,
    /// How much the states depend on the initial one there.
    growth: f64,
}

impl<'a> Begun<'a> {
    /// The fit at its start, with the parameters `p` of the model.
    pub(crate) fn at(
        p: Vec<f64>,
        problem: &Problem,
        recordings: &[Recording<'a>],
        with: &mut Evaluation<'_>,
    ) -> Self {
        let begin = simulated(problem, recordings, &p, with);
        let start: Vec<Trajectory> = begin.iter().map(|of| of.trajectory.clone()).collect();
        let finite = start.iter().all(Trajectory::is_finite);
        let mut fit = Fit::new(problem, p.clone(), begin, with);
        let linear = finite && fit.linearize(problem, with);
        let growth = fit.growth();
        Self { fit, start, p, linear, growth }
    }

    /// Whether single shooting can go on from the start.
    pub(crate) fn is_single(&self, criterion: Criterion) -> bool {
        match criterion {
            Criterion::Simulation => self.linear,
            Criterion::Chosen | Criterion::MultipleShooting | Criterion::PredictionError => {
                self.linear && self.growth <= SENSITIVE
            }
        }
    }

    /// The fit at its end, by single or multiple shooting.
    pub(crate) fn finish(
        self,
        problem: &Problem,
        recordings: &[Recording<'a>],
        with: &mut Evaluation<'_>,
    ) -> Result<(Fit<'a>, Method), IdentifyError> {
        let single = self.is_single(problem.criterion);
        let Self { mut fit, p, linear, growth, start } = self;
        let cut = match problem.criterion {
            Criterion::MultipleShooting => Some(Why::Asked),
            Criterion::Chosen | Criterion::PredictionError if linear => {
                (!single).then_some(Why::Sensitive { growth })
            }
            Criterion::Chosen | Criterion::PredictionError => Some(Why::NotFinite),
            Criterion::Simulation if linear => None,
            Criterion::Simulation => {
                let recording = start.iter().position(|of| !of.is_finite()).unwrap_or(0);
                return Err(IdentifyError::NotFinite { recording });
            }
        };
        if let Some(why) = cut {
            let fit = multiple(problem, recordings, &p, with, growth)?;
            return Ok((fit, Method::MultipleShooting(why)));
        }
        fit.run(problem, with);
        let method = Method::SingleShooting { growth: fit.growth() };
        let asked = problem.criterion == Criterion::Simulation;
        Ok(match doubt(problem, &fit).filter(|_| !asked) {
            None => (fit, method),
            Some(why) => match multiple(problem, recordings, &p, with, growth) {
                Ok(other) if is_better(&other, &fit) => (other, Method::MultipleShooting(why)),
                _ => (fit, method),
            },
        })
    }
}

/// The recordings with the model's trajectories from the start.
fn simulated<'a>(
    problem: &Problem,
    recordings: &[Recording<'a>],
    p: &[f64],
    with: &mut Evaluation<'_>,
) -> Vec<Shooting<'a>> {
    let x = problem.initial_state.values();
    let of = |recording: &Recording<'a>| {
        let scale = scale(&guess(problem, *recording, p, with));
        let mut of = Shooting::new(problem, *recording, Nodes::first(x), scale);
        of.simulate(problem, p, with);
        of
    };
    recordings.iter().map(of).collect()
}

/// The size of each state along all rows.
fn scale(states: &[Vec<f64>]) -> Vec<f64> {
    let size = |i: usize| states.iter().fold(0.0, |most: f64, x| most.max(x[i].abs()));
    let sizes = (0..states[0].len()).map(size);
    sizes.map(|size| if size > 0.0 && size.is_finite() { size } else { 1.0 }).collect()
}

/// A guess of the states at all rows: the model, put right wherever a state is measured.
fn guess(
    problem: &Problem,
    recording: Recording<'_>,
    p: &[f64],
    with: &mut Evaluation<'_>,
) -> Vec<Vec<f64>> {
    let (nx, nu, channels) = (with.dims.nx, with.dims.nu, problem.channels.len());
    let mut all = vec![problem.initial_state.values().to_vec()];
    for k in 1..recording.rows(channels) {
        let before = &all[k - 1];
        let mut next = vec![0.0; nx];
        let (u, p) = (&recording.u[(k - 1) * nu..k * nu], &p[..with.dims.np]);
        with.model.step(before, u, p, &mut next);
        with.work.steps += 1;
        let measured = problem.channels.iter().zip(&recording.y[k * channels..]);
        for (channel, y) in measured {
            match channel.measured {
                Measured::State(place) if !y.is_nan() => next[place] = *y,
                _ => {}
            }
        }
        // A state that the model loses stays where it was.
        for (next, before) in next.iter_mut().zip(before) {
            *next = if next.is_finite() { *next } else { *before };
        }
        all.push(next);
    }
    all
}

/// A fit in segments: at first each by itself, with the parameters in common, which lets states be
/// where the data have them however wrong the parameters still are; with segments that become
/// longer; and then with the gaps between them closed.
fn multiple<'a>(
    problem: &Problem,
    recordings: &[Recording<'a>],
    p: &[f64],
    with: &mut Evaluation<'_>,
    growth: f64,
) -> Result<Fit<'a>, IdentifyError> {
    let (nx, channels) = (with.dims.nx, problem.channels.len());
    let rows = recordings.iter().map(|of| of.rows(channels)).max().unwrap_or(2);
    let mut longest = segments(rows, growth);
    let mut length = longest.min(2 * nx.div_ceil(channels) + 2);
    let mut states: Vec<_> =
        recordings.iter().map(|&recording| guess(problem, recording, p, with)).collect();
    let mut p = p.to_vec();
    loop {
        if with.is_interrupted() {
            return Err(IdentifyError::Interrupted);
        }
        match apart(problem, recordings, (&mut states, &mut p), length, with) {
            Err(error) if length <= 2 => return Err(error),
            Err(_) => (longest, length) = ((length / 2).max(2), 2),
            Ok(()) if length == longest => break,
            Ok(()) => length = longest.min(2 * length),
        }
    }
    let known = problem.initial_state.values();
    let parts = recordings.iter().zip(&mut states).map(|(recording, states)| {
        if !problem.initial_state.is_free() {
            states[0].copy_from_slice(known);
        }
        let nodes = Nodes::every(length, states);
        let mut of = Shooting::new(problem, *recording, nodes, scale(states));
        of.simulate(problem, &p, with);
        of
    });
    let parts: Vec<_> = parts.collect();
    let mut fit = Fit::new(problem, p, parts, with);
    fit.run(problem, with);
    Ok(fit)
}

/// Fits segments of `length` rows as recordings of their own, from given states and parameters,
/// which move to the fit. K, of which short segments say little, stays.
fn apart(
    problem: &Problem,
    recordings: &[Recording<'_>],
    (states, p): (&mut [Vec<Vec<f64>>], &mut Vec<f64>),
    length: usize,
    with: &mut Evaluation<'_>,
) -> Result<(), IdentifyError> {
    let (nx, nu, channels) = (with.dims.nx, with.dims.nu, problem.channels.len());
    let first = problem.initial_state.values().to_vec();
    let (initial_state, unknown) = (InitialState::Free(first), problem.of_the_model().to_vec());
    let free = Problem { initial_state, unknown, ..problem.clone() };
    let mut parts = Vec::new();
    for (number, (recording, states)) in recordings.iter().zip(&*states).enumerate() {
        let scale = scale(states);
        for first in (0..states.len()).step_by(length) {
            let end = states.len().min(first + length);
            let led = Some(recording.input_read(first, nu));
            let cut = Recording {
                before: if first == 0 { recording.before } else { led },
                u: &recording.u[first * nu..end * nu],
                y: &recording.y[first * channels..end * channels],
                ..*recording
            };
            let nodes = Nodes::first(&states[first]);
            let mut part = Shooting::new(&free, cut, nodes, scale.clone());
            part.simulate(&free, p, with);
            if !part.trajectory.is_finite() {
                return Err(IdentifyError::NotFinite { recording: number });
            }
            parts.push(part);
        }
    }
    let mut fit = Fit::new(&free, p.clone(), parts, with);
    fit.run(&free, with);
    let all = fit.recordings.iter().flat_map(|part| part.trajectory.x.chunks_exact(nx));
    for (state, x) in states.iter_mut().flatten().zip(all) {
        state.copy_from_slice(x);
    }
    *p = fit.p;
    Ok(())
}

/// Why a fit by single shooting may be a wrong one.
fn doubt(problem: &Problem, fit: &Fit<'_>) -> Option<Why> {
    if fit.status != FitStatus::Converged {
        return Some(Why::SingleEnded { status: fit.status });
    }
    let correlation = (0..problem.channels.len())
        .map(|channel| neighbours(problem, fit, channel))
        .fold(0.0, f64::max);
    (correlation > CORRELATED).then_some(Why::BetterThanSingle { correlation })
}

/// The correlation of neighbouring residuals of a channel that measures a state.
fn neighbours(problem: &Problem, fit: &Fit<'_>, channel: usize) -> f64 {
    let Measured::State(state) = problem.channels[channel].measured else { return 0.0 };
    let residuals = fit.recordings.iter().map(|of| {
        let (nx, channels) = (of.scale.len(), problem.channels.len());
        let y = of.recording.y.iter().skip(channel).step_by(channels);
        let x = of.trajectory.x.iter().skip(state).step_by(nx);
        x.zip(y).map(|(x, y)| x - y).collect()
    });
    of_neighbours(residuals)
}

fn is_better(other: &Fit<'_>, fit: &Fit<'_>) -> bool {
    other.status == FitStatus::Converged && other.cost() < (1.0 - 1e-6) * fit.cost()
}
