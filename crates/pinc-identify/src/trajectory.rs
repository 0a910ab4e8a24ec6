//! The model along a recording, from one or several states on.

use crate::problem::{Problem, Recording};
use pinc_estimate::Measured;
use pinc_ode::{Dims, Model};
use std::sync::atomic::{AtomicBool, Ordering};

/// How often the model was evaluated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Work {
    /// Steps of the model.
    pub steps: usize,
    /// Points at which it was linearized.
    pub linearized: usize,
    /// Iterations, each with one linearization of the whole of the data.
    pub iterations: usize,
}

impl Work {
    pub(crate) fn plus(self, other: Self) -> Self {
        Self {
            steps: self.steps + other.steps,
            linearized: self.linearized + other.linearized,
            iterations: self.iterations + other.iterations,
        }
    }
}

/// Whether a fit has been asked to stop.
pub(crate) fn is_set(interrupt: Option<&AtomicBool>) -> bool {
    interrupt.is_some_and(|interrupt| interrupt.load(Ordering::Relaxed))
}

/// A model with the memory for one evaluation, and the count of these.
#[derive(Debug)]
pub(crate) struct Evaluation<'m> {
    pub(crate) model: &'m mut dyn Model,
    pub(crate) dims: Dims,
    pub(crate) work: Work,
    /// What ends the fit once it is set.
    interrupt: Option<&'m AtomicBool>,
    /// The outputs at one point.
    y: Vec<f64>,
    next: Vec<f64>,
    /// The measured quantities at one point.
    channels: Vec<f64>,
}

/// The states of the model along one recording.
#[derive(Clone, Debug)]
pub(crate) struct Trajectory {
    /// `[rows, nx]`
    pub(crate) x: Vec<f64>,
    /// The states from which the model goes on, corrected by the measurements of their rows,
    /// `[rows, nx]`.
    pub(crate) corrected: Vec<f64>,
    /// For each segment but the last, its end minus the beginning of the next:
    /// `[segments - 1, nx]`.
    pub(crate) defects: Vec<f64>,
    /// Half the sum of squares of the residuals.
    pub(crate) cost: f64,
}

impl<'m> Evaluation<'m> {
    pub(crate) fn new(model: &'m mut dyn Model) -> Self {
        let dims = model.dims();
        let (y, next) = (vec![0.0; dims.ny], vec![0.0; dims.nx]);
        Self { model, dims, work: Work::default(), interrupt: None, y, next, channels: Vec::new() }
    }

    /// The same, to be interrupted.
    pub(crate) fn until(self, interrupt: Option<&'m AtomicBool>) -> Self {
        Self { interrupt, ..self }
    }

    pub(crate) fn is_interrupted(&self) -> bool {
        is_set(self.interrupt)
    }

    /// The measured quantities at one point, in the order of the channels.
    pub(crate) fn measured(
        &mut self,
        problem: &Problem,
        (x, u, p): (&[f64], &[f64], &[f64]),
        measured: &mut [f64],
    ) {
        if problem.has_outputs() {
            self.model.output(x, u, &p[..self.dims.np], &mut self.y);
        }
        for (to, channel) in measured.iter_mut().zip(&problem.channels) {
            *to = channel.measured.read(x, &self.y);
        }
    }

    /// Writes the trajectory whose segments begin at the rows `starts` in the states `nodes`.
    pub(crate) fn simulate(
        &mut self,
        problem: &Problem,
        recording: Recording<'_>,
        (starts, nodes, p): (&[usize], &[f64], &[f64]),
        to: &mut Trajectory,
    ) {
        let Dims { nx, nu, np, .. } = self.dims;
        let (channels, rows) = (problem.channels.len(), to.x.len() / nx);
        let (of_the_model, gains) = p.split_at(np);
        let mut measured = std::mem::take(&mut self.channels);
        measured.resize(channels, 0.0);
        let mut segment = 0;
        to.cost = 0.0;
        for k in 0..rows {
            if starts.get(segment) == Some(&k) {
                to.x[k * nx..(k + 1) * nx].copy_from_slice(&nodes[segment * nx..][..nx]);
                segment += 1;
            }
            let (x, u) = (&to.x[k * nx..(k + 1) * nx], &recording.u[k * nu..(k + 1) * nu]);
            self.measured(problem, (x, recording.input_read(k, nu), p), &mut measured);
            let y = &recording.y[k * channels..(k + 1) * channels];
            let corrected = &mut to.corrected[k * nx..(k + 1) * nx];
            corrected.copy_from_slice(x);
            for (i, (y, measured)) in y.iter().zip(&measured).enumerate() {
                if !y.is_nan() {
                    to.cost += 0.5 * ((measured - y) / problem.sd(i)).powi(2);
                    let gains = gains.iter().skip(i).step_by(channels);
                    corrected
                        .iter_mut()
                        .zip(gains)
                        .for_each(|(x, gain)| *x += gain * (y - measured));
                }
            }
            if k + 1 == rows {
                break;
            }
            self.model.step(corrected, u, of_the_model, &mut self.next);
            self.work.steps += 1;
            if starts.get(segment) == Some(&(k + 1)) {
                let defect = &mut to.defects[(segment - 1) * nx..segment * nx];
                for (i, defect) in defect.iter_mut().enumerate() {
                    *defect = self.next[i] - nodes[segment * nx + i];
                }
            } else {
                to.x[(k + 1) * nx..(k + 2) * nx].copy_from_slice(&self.next);
            }
        }
        self.channels = measured;
    }
}

impl Trajectory {
    pub(crate) fn new(nx: usize, rows: usize, segments: usize) -> Self {
        let zeros = |points: usize| vec![0.0; points * nx];
        Self { x: zeros(rows), corrected: zeros(rows), defects: zeros(segments - 1), cost: 0.0 }
    }

    pub(crate) fn is_finite(&self) -> bool {
        let finite = |values: &[f64]| values.iter().all(|v| v.is_finite());
        self.cost.is_finite() && finite(&self.x) && finite(&self.defects)
    }
}

impl Problem {
    /// Whether a channel measures something else than a state.
    pub(crate) fn has_outputs(&self) -> bool {
        self.channels.iter().any(|c| matches!(c.measured, Measured::Output(_)))
    }
}
