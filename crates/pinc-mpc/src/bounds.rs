//! Bounds, and how hard they are.

use crate::MpcError;
use crate::error::{check_length, check_numbers};
use serde::{Deserialize, Serialize};

/// How far beyond its bounds an applied input may be, relative to 1 + |bound|: what is left of it on
/// its way through other number formats.
const ROUNDED_INPUT: f64 = 1e-6;

/// Lower and upper bounds, one of each per variable, or one of each per stage and variable. A bound
/// that is infinite is none.
///
/// # Shapes
///
/// Both lists: `[variables]`, the same at all stages; or `[stages, variables]`, row by row.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bounds {
    /// Lower bounds, finite or minus infinity.
    pub low: Vec<f64>,
    /// Upper bounds, finite or infinity.
    pub high: Vec<f64>,
}

impl Bounds {
    /// No bounds on `variables` variables.
    #[must_use]
    pub fn none(variables: usize) -> Self {
        Self { low: vec![f64::NEG_INFINITY; variables], high: vec![f64::INFINITY; variables] }
    }

    /// These bounds on each variable.
    #[must_use]
    pub fn new(low: Vec<f64>, high: Vec<f64>) -> Self {
        Self { low, high }
    }

    /// Moves `values` into their bounds at the first stage.
    pub(crate) fn clamp(&self, values: &mut [f64]) {
        for (v, (low, high)) in values.iter_mut().zip(self.low.iter().zip(&self.high)) {
            *v = v.clamp(*low, *high);
        }
    }

    /// Checks an applied input: finite, and within the bounds of the first stage up to rounding.
    pub(crate) fn check_applied(&self, u: &[f64]) -> Result<(), MpcError> {
        check_numbers("u_applied", u, "finite", f64::is_finite)?;
        let outside = |&(i, value): &(usize, &f64)| !self.admits(i, *value);
        let Some((index, &value)) = u.iter().enumerate().find(outside) else { return Ok(()) };
        Err(MpcError::Applied { index, value, low: self.low[index], high: self.high[index] })
    }

    /// Whether `value` is within the bounds of variable `i` at the first stage, up to rounding.
    #[must_use]
    pub fn admits(&self, i: usize, value: f64) -> bool {
        let room = |bound: f64| ROUNDED_INPUT * (1.0 + bound.abs());
        (self.low[i] - room(self.low[i])..=self.high[i] + room(self.high[i])).contains(&value)
    }

    /// From where a move within `moves`, of as many variables, leads into these bounds at the first
    /// stage: low - most <= u <= high - least.
    #[must_use]
    pub fn before(&self, moves: &Self) -> Self {
        let less = |(bound, by): (&f64, &f64)| bound - by;
        let low = self.low.iter().zip(&moves.high).map(less).collect();
        let high = self.high.iter().zip(&moves.low).map(less).collect();
        Self { low, high }
    }

    /// The bounds on `variables` variables at each of these stages, one after the other.
    pub(crate) fn expand(&self, variables: usize, stages: impl Iterator<Item = usize>) -> Self {
        let differ = self.low.len() > variables;
        let mut all = Self { low: Vec::new(), high: Vec::new() };
        for stage in stages {
            let first = if differ { stage * variables } else { 0 };
            all.low.extend(&self.low[first..first + variables]);
            all.high.extend(&self.high[first..first + variables]);
        }
        all
    }

    /// Returns the largest finite bound of each variable, over all stages; 0 where there is none.
    #[must_use]
    pub fn sizes(&self, variables: usize) -> Vec<f64> {
        let mut sizes = vec![0.0_f64; variables];
        for (i, bound) in self.low.iter().enumerate().chain(self.high.iter().enumerate()) {
            if bound.is_finite() {
                sizes[i % variables] = sizes[i % variables].max(bound.abs());
            }
        }
        sizes
    }

    /// The point of the first stage that is this `part` of the way from one bound to the other; -1
    /// and 1 take the place of bounds that are not finite.
    pub(crate) fn between(&self, part: f64, variables: usize) -> Vec<f64> {
        let finite = |bound: f64, other: f64| if bound.is_finite() { bound } else { other };
        let sides = self.low.iter().zip(&self.high).take(variables);
        sides
            .map(|(&low, &high)| (1.0 - part) * finite(low, -1.0) + part * finite(high, 1.0))
            .collect()
    }

    /// These bounds, followed by the bounds of `other`.
    pub(crate) fn chain(self, other: Self) -> Self {
        Self { low: [self.low, other.low].concat(), high: [self.high, other.high].concat() }
    }

    /// Whether 0 is within all of them.
    pub(crate) fn admit_zero(&self, field: &'static str) -> Result<(), MpcError> {
        check_numbers(field, &self.low, "0 or less", |v| v <= 0.0)?;
        check_numbers(field, &self.high, "0 or more", |v| v >= 0.0)
    }

    /// Checks bounds on `variables` variables, for one stage or for as many as `stages`.
    pub(crate) fn validate(
        &self,
        field: &'static str,
        stages: usize,
        variables: usize,
    ) -> Result<(), MpcError> {
        let whole = stages * variables;
        let expected = if self.low.len() == whole { whole } else { variables };
        for side in [&self.low, &self.high] {
            check_length(field, side, expected)?;
        }
        check_numbers(field, &self.low, "finite or -inf", |v| v < f64::INFINITY)?;
        check_numbers(field, &self.high, "finite or inf", |v| v > f64::NEG_INFINITY)?;
        for (index, (&low, &high)) in self.low.iter().zip(&self.high).enumerate() {
            if low > high {
                return Err(MpcError::CrossedBounds { field, index, low, high });
            }
        }
        Ok(())
    }
}

/// How a constraint is relaxed that cannot be met, or only at a high cost.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Softness {
    /// It must be met. Where that is impossible, the step's status says so and names a constraint
    /// that is in the way; the plan is then as with `exact`.
    #[default]
    Hard,
    /// It is met wherever the (linearized) problem has a solution, and violated as little as possible
    /// elsewhere: by an L1 penalty that comes into play only where it must, with a weight of 1000 times the
    /// cost's largest slope at the first guess, above the multipliers of ordinary problems.
    Exact,
    /// It may be violated, at a cost of so much per unit of violation, one weight per constraint: an exact
    /// penalty. Violations vanish where the problem has a solution with multipliers below the weights.
    Penalty(Vec<f64>),
}

impl Softness {
    pub(crate) fn validate(&self, field: &'static str, expected: usize) -> Result<(), MpcError> {
        let Self::Penalty(weights) = self else { return Ok(()) };
        check_length(field, weights, expected)?;
        check_numbers(field, weights, "positive and finite", |w| w > 0.0 && w.is_finite())
    }

    /// The most that a multiplier of constraint `i` may be.
    #[must_use]
    pub fn penalty(&self, i: usize) -> f64 {
        match self {
            Self::Penalty(weights) => weights[i],
            Self::Hard | Self::Exact => f64::INFINITY,
        }
    }
}
