//! Weights of channels whose noise nobody knows.

use crate::problem::{InitialState, Problem, Recording};
use crate::result::Identified;

/// A channel whose residuals are this part of its spread has no noise.
const NO_NOISE: f64 = 1e-6;
/// Weights that change by less than this part are settled.
const SETTLED: f64 = 0.01;
/// How many times weights are found anew at most.
const ROUNDS: usize = 20;

/// Fits a problem whose channels of unknown noise are weighed by their residuals: `fit` gets the
/// problem with weights and the number of starts, `starts` of them in the first and the last fit.
/// Returns the problem with its last weights, and its fit.
///
/// # Errors
///
/// Those of `fit`.
pub fn weighed_by_residuals<E>(
    problem: Problem,
    recordings: &[Recording<'_>],
    starts: usize,
    mut fit: impl FnMut(&Problem, usize) -> Result<Identified, E>,
) -> Result<(Problem, Identified), E> {
    let initial = problem.unknown.clone();
    let mut problem = problem.with_first_weights(recordings);
    let mut found = fit(&problem, starts)?;
    let mut rounds = 0;
    while let Some(next) = problem.reweighed(&found, recordings).filter(|_| rounds < ROUNDS) {
        problem = next;
        found = fit(&problem, 1)?;
        rounds += 1;
    }
    if rounds > 0 && starts > 1 {
        found = fit(&problem, starts)?;
    }
    problem.unknown = initial;
    Ok((problem, found))
}

impl Problem {
    /// The problem with a first weight for each channel of unknown noise: the spread of its
    /// measurements counts as 1. Only a single channel that counts beside no prior needs no weight.
    fn with_first_weights(mut self, recordings: &[Recording<'_>]) -> Self {
        if self.channels.len() > 1 || self.priors() > 0 {
            for i in 0..self.channels.len() {
                let spread = self.spread(i, recordings);
                let channel = &mut self.channels[i];
                if channel.sd.is_none() && spread > 0.0 {
                    (channel.sd, channel.is_estimated) = (Some(spread), true);
                }
            }
        }
        self
    }

    /// The problem with weights by the residuals of `found`, from where that ended; `None` if they
    /// are what they were. Repeated, this is the fit of maximum likelihood under unknown noise.
    fn reweighed(&self, found: &Identified, recordings: &[Recording<'_>]) -> Option<Self> {
        let mut next = self.clone();
        let mut settled = true;
        for (i, of) in found.channels.iter().enumerate() {
            let channel = &mut next.channels[i];
            if let (true, Some(sd)) = (channel.is_estimated, channel.sd) {
                let rms = of.rms.max(NO_NOISE * self.spread(i, recordings));
                settled &= (rms / sd - 1.0).abs() < SETTLED;
                channel.sd = Some(rms);
            }
        }
        for unknown in &mut next.unknown {
            unknown.initial = found.p[unknown.place];
        }
        if let (InitialState::Free(state), Some(found)) =
            (&mut next.initial_state, found.initial_states.first())
        {
            *state = found.iter().map(|of| of.value).collect();
        }
        (!settled).then_some(next)
    }

    /// The standard deviation of what a channel measured.
    fn spread(&self, i: usize, recordings: &[Recording<'_>]) -> f64 {
        let all = || {
            let of =
                recordings.iter().flat_map(|of| of.y.iter().skip(i).step_by(self.channels.len()));
            of.filter(|y| !y.is_nan())
        };
        let count = all().count() as f64;
        let mean = all().sum::<f64>() / count;
        (all().map(|y| (y - mean).powi(2)).sum::<f64>() / count).sqrt()
    }
}
