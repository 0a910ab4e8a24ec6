//! Which readings an estimator takes, and which it refuses.

use crate::estimator::variances;
use crate::{EstimateError, EstimatorStatus, Tuning};
use pinc_ode::Memory;

/// The innovation gate: how far a reading may be from what is expected of it.
///
/// A reading `y_i` is rejected if its normalized innovation squared, `v_i^2 / S_ii`, exceeds a bound
/// n^2. Of a consistent estimator it has the chi-squared distribution with one degree of freedom, so
/// that n counts standard deviations of the innovation. Each reading is judged by itself, from the
/// estimate before any of them is used: a stuck sensor does not take the others with it, as it
/// would with the joint `v' S^-1 v`. A rejected reading counts as missing.
///
/// After [`Gate::PATIENCE`] more rejections than passes of one quantity the estimate is doubted
/// instead of the sensor: the reading is judged by a covariance that is widened to
/// [`Gate::widened`] (without correlations, and nowhere narrower than it is), and used with that
/// covariance if it passes. It is judged so again after as many more rejections, with twice the
/// standard deviations each time, up to 2^[`Gate::DOUBLINGS`] times, and at once if the next reading
/// is rejected too: what is not measured is farther off than the covariance says. A lasting offset
/// and a jump of the plant get through in this way; a sensor stuck beyond this range is never
/// believed. One reading that passes takes back one rejection only, since a lost estimate meets the
/// plant by chance now and then.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Gate {
    /// All readings are used.
    Off,
    /// Readings are rejected that are more than so many standard deviations of the innovation from
    /// what is expected.
    Sd(f64),
}

impl Default for Gate {
    fn default() -> Self {
        Self::Sd(Self::DEFAULT_SD)
    }
}

impl Gate {
    /// The width of the gate unless another is chosen. It is wide, for a plant that differs from
    /// its model moves innovations by many standard deviations, which an estimator of disturbances
    /// needs; broken sensors are off by hundreds.
    pub const DEFAULT_SD: f64 = 30.0;
    /// How many more rejections than passes there are before a reading is judged by a wider
    /// covariance.
    pub const PATIENCE: usize = 5;
    /// How often the standard deviations of the widened covariance are doubled.
    pub const DOUBLINGS: usize = 5;

    /// The bound on the normalized innovation squared of one reading; infinite if there is none.
    #[must_use]
    pub fn bound(self) -> f64 {
        match self {
            Self::Off => f64::INFINITY,
            Self::Sd(sd) => sd * sd,
        }
    }

    /// The variances of each entry of z that a covariance is widened to at first, `nx`: the largest
    /// of the variance at the beginning, the variance of a step, and the one with which the gate passes
    /// an error as large as [`Tuning::range`].
    #[must_use]
    pub fn widened(tuning: &Tuning) -> Vec<f64> {
        let range = |k: usize| tuning.range.get(k).map_or(0.0, |range| range * range);
        let both = variances(&tuning.initial_sd).into_iter().zip(variances(&tuning.process_sd));
        let all = both.enumerate().map(|(k, (initial, in_a_step))| {
            initial.max(in_a_step).max(range(k) / tuning.gate.bound())
        });
        all.collect()
    }

    pub(crate) fn validate(self) -> Result<(), EstimateError> {
        match self {
            Self::Sd(found) if !(found.is_finite() && found > 0.0) => {
                Err(EstimateError::Gate { found })
            }
            Self::Sd(_) | Self::Off => Ok(()),
        }
    }
}

/// The most rejections that are counted, after which the widest covariance has been due.
const MOST_DOUBT: usize = Gate::PATIENCE * (Gate::DOUBLINGS + 2);

/// The gate at work: what was rejected so far.
#[derive(Clone, Debug)]
pub(crate) struct Gatekeeper {
    bound: f64,
    widened: Vec<f64>,
    /// Whether the last reading of each measured quantity was rejected.
    rejected: Vec<bool>,
    /// How many more rejections than passes each has had.
    doubt: Vec<usize>,
    /// Whether the last reading of each passed with a widened covariance only.
    reacquired: Vec<bool>,
}

/// How the readings of a step were judged.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Judgement {
    /// How many were rejected.
    pub(crate) rejected: usize,
    /// Whether the covariance was widened for one.
    pub(crate) widened: bool,
}

impl Judgement {
    /// How a correction ends that would have ended with `status` without the gate.
    pub(crate) fn status(self, status: EstimatorStatus) -> EstimatorStatus {
        match self {
            Self { widened: true, .. } => EstimatorStatus::Reacquired,
            Self { rejected: 0, .. } => status,
            Self { .. } => EstimatorStatus::Rejected,
        }
    }
}

impl Gatekeeper {
    pub(crate) fn new(tuning: &Tuning) -> Self {
        Self {
            bound: tuning.gate.bound(),
            widened: Gate::widened(tuning),
            rejected: vec![false; tuning.measurement_sd.len()],
            doubt: vec![0; tuning.measurement_sd.len()],
            reacquired: vec![false; tuning.measurement_sd.len()],
        }
    }

    pub(crate) fn reset(&mut self) {
        self.rejected.fill(false);
        self.doubt.fill(0);
        self.reacquired.fill(false);
    }

    /// Saves or restores what was rejected.
    pub(crate) fn remember(&mut self, memory: &mut Memory<'_>) {
        self.rejected.iter_mut().for_each(|rejected| memory.flag(rejected));
        self.doubt.iter_mut().for_each(|doubt| memory.count(doubt, MOST_DOUBT));
        self.reacquired.iter_mut().for_each(|reacquired| memory.flag(reacquired));
    }

    /// Whether an innovation of this variance passes.
    pub(crate) fn passes(&self, innovation: f64, variance: f64) -> bool {
        // An infinite square is beyond any bound, and a variance that is NaN says nothing.
        let is_wild = innovation * innovation > self.bound * variance;
        !is_wild
    }

    /// Takes note of whether the reading of quantity `i` passed.
    pub(crate) fn note(&mut self, i: usize, passed: bool) {
        let in_vain = std::mem::take(&mut self.reacquired[i]);
        self.rejected[i] = !passed;
        self.doubt[i] = match self.doubt[i] {
            doubt if passed => doubt.saturating_sub(1),
            // The widest covariance stays due as often as the others.
            MOST_DOUBT => MOST_DOUBT - Gate::PATIENCE + 1,
            doubt if in_vain => (doubt + 1 + Gate::PATIENCE).min(MOST_DOUBT),
            doubt => doubt + 1,
        };
    }

    /// Takes note that the rejected reading of quantity `i` passed with a widened covariance.
    pub(crate) fn note_reacquired(&mut self, i: usize) {
        self.note(i, true);
        self.reacquired[i] = true;
    }

    /// Whether the last reading of quantity `i` was rejected.
    pub(crate) fn is_rejected(&self, i: usize) -> bool {
        self.rejected[i]
    }

    /// How often the standard deviations are doubled to judge quantity `i` again, whose last reading
    /// was rejected; `None` if that is not due.
    pub(crate) fn widening(&self, i: usize) -> Option<usize> {
        let (times, rest) = (self.doubt[i] / Gate::PATIENCE, self.doubt[i] % Gate::PATIENCE);
        let doublings = times.checked_sub(1)?.min(Gate::DOUBLINGS);
        (self.rejected[i] && rest == 0).then_some(doublings)
    }

    /// The variance of entry `k` of z, of which the covariance says `variance`, widened.
    pub(crate) fn wide(&self, k: usize, doublings: usize, variance: f64) -> f64 {
        variance.max(f64::from(1_u32 << (2 * doublings)) * self.widened[k])
    }

    /// Widens the covariance `p`, `[nx, nx]`.
    pub(crate) fn widen(&self, doublings: usize, p: &mut [f64]) {
        let n = self.widened.len();
        for (k, row) in p.chunks_exact_mut(n).enumerate() {
            let variance = self.wide(k, doublings, row[k]);
            row.fill(0.0);
            row[k] = variance;
        }
    }
}
