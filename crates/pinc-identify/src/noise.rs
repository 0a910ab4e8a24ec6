//! Weights of channels whose noise nobody knows.

use crate::problem::{InitialState, Problem, Recording};
use crate::result::Identified;

/// A channel whose residuals are this part of its spread has no noise.
const NO_NOISE: f64 = 1e-6;
/// Weights that change by less than this part are settled.
const SETTLED: f64 = 0.01;

impl Problem {
    /// The problem with a first weight for each channel of unknown noise: the spread of its
    /// measurements counts as 1. Only a single channel that counts beside no prior needs no weight.
    #[must_use]
    pub fn with_first_weights(mut self, recordings: &[Recording<'_>]) -> Self {
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
    #[must_use]
    pub fn reweighed(&self, found: &Identified, recordings: &[Recording<'_>]) -> Option<Self> {
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
