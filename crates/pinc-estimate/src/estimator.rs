//! The interface of all estimators.

use crate::error::check;
use crate::{EstimateError, Gate};
use pinc_ode::{ArgumentError, Dims, Memory};
use std::fmt::{self, Debug};

/// An estimator in filter form: at each step [`Estimator::correct`] with what is measured, use the
/// [`Estimator::estimate`], then [`Estimator::predict`] with the input that is applied.
///
/// The estimated state z is the state of the estimator's model, whose outputs are the measured
/// quantities ([`Augmented`](crate::Augmented)).
///
/// An estimator owns its memory: no method allocates. After a step that could not be taken the
/// estimate and its covariance are those from before, and the status says so.
pub trait Estimator: Debug + Send {
    /// The sizes: `nx` is the length of z, `ny` the number of measured quantities.
    fn dims(&self) -> Dims;

    /// Forgets everything: the estimate is again the initial one, and the input before the first
    /// measurement is taken for 0.
    fn reset(&mut self);

    /// [`Estimator::reset`] at a plant that has been given the input `u` so far: with it outputs
    /// that depend on the input are expected until the first prediction.
    ///
    /// # Shapes
    ///
    /// `u`: `nu`.
    fn reset_input(&mut self, u: &[f64]);

    /// Says what the known parameters of the model are from now on; until then they are those of
    /// [`Tuning::parameters`].
    ///
    /// # Shapes
    ///
    /// `p`: `np`.
    fn set_parameters(&mut self, p: &[f64]);

    /// Corrects the estimate with what is measured now.
    ///
    /// # Shapes
    ///
    /// `y`: `ny`. A measurement that is NaN or infinite is missing and skipped.
    fn correct(&mut self, y: &[f64]) -> Correction {
        self.correct_within(y, &mut || false)
    }

    /// [`Estimator::correct`] within a time budget: `expired` says whether the time is up. Only
    /// estimators that iterate ask.
    fn correct_within(&mut self, y: &[f64], expired: &mut dyn FnMut() -> bool) -> Correction;

    /// Moves the estimate on by a step under the input `u`, `nu`.
    fn predict(&mut self, u: &[f64]) -> EstimatorStatus;

    /// The estimate of z, `nx`.
    fn estimate(&self) -> &[f64];

    /// Its covariance, `[nx, nx]`, row by row.
    fn covariance(&self) -> &[f64];

    /// The innovation of the last correction, measured minus expected, `ny`; NaN where the
    /// measurement was missing or rejected.
    fn innovation(&self) -> &[f64];

    /// Saves what the estimator knows from its past, or restores it into one with the same model and
    /// tuning. After a restoration for which [`Memory::is_complete`] does not hold,
    /// [`Estimator::reset`] it.
    fn remember(&mut self, memory: &mut Memory<'_>);
}

/// The result of a correction.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Correction {
    /// How it ended.
    pub status: EstimatorStatus,
    /// The normalized innovation squared, v' S^-1 v. Of a consistent estimator it has the
    /// chi-squared distribution with `measured` degrees of freedom. NaN if there was nothing to use,
    /// or S is singular.
    pub nis: f64,
    /// How many measurements were there to use, without those that were rejected.
    pub measured: usize,
    /// How many measurements the [`Gate`] rejected.
    pub rejected: usize,
    /// The number of quadratic programs solved, by estimators that optimize.
    pub iterations: usize,
    /// The largest residual of the optimality conditions at the estimate, of estimators that
    /// optimize; 0 of others.
    pub kkt: f64,
}

impl Correction {
    /// One that did not use the measurements.
    pub(crate) fn unused(status: EstimatorStatus, measured: usize) -> Self {
        Self { status, nis: f64::NAN, measured, rejected: 0, iterations: 0, kkt: 0.0 }
    }
}

/// How a correction or prediction ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum EstimatorStatus {
    /// As it should.
    Updated,
    /// Nothing was measured: there was nothing to correct with.
    NothingMeasured,
    /// The [`Gate`] rejected measurements; those that it did not reject were used.
    Rejected,
    /// After too many rejections in a row the covariance was widened, and the measurement used.
    Reacquired,
    /// The covariance would have lost its definiteness: the last one was kept.
    IndefiniteCovariance,
    /// The model has no value at the estimate, or the new estimate would not have been finite: the
    /// last one was kept.
    NotFinite,
    /// The iterations were used up before the optimality conditions were met; the estimate is the
    /// best one found.
    IterationLimit,
    /// The time was up before the optimality conditions were met; the estimate is the best one
    /// found.
    Deadline,
    /// A quadratic program has no solution within the bounds, or none was found; the estimate is
    /// the last one that was.
    QpFailed,
}

impl EstimatorStatus {
    /// Whether the step was taken as it should, with what was measured and not rejected.
    #[must_use]
    pub fn has_succeeded(self) -> bool {
        self.is_corrected() || self == Self::NothingMeasured
    }

    /// Whether a correction with this status used all measurements that were not rejected.
    pub(crate) fn is_corrected(self) -> bool {
        match self {
            Self::Updated | Self::Rejected | Self::Reacquired => true,
            Self::NothingMeasured
            | Self::IndefiniteCovariance
            | Self::NotFinite
            | Self::IterationLimit
            | Self::Deadline
            | Self::QpFailed => false,
        }
    }
}

impl fmt::Display for EstimatorStatus {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Updated => "updated",
            Self::NothingMeasured => "nothing-measured",
            Self::Rejected => "rejected",
            Self::Reacquired => "reacquired",
            Self::IndefiniteCovariance => "indefinite-covariance",
            Self::NotFinite => "not-finite",
            Self::IterationLimit => "iteration-limit",
            Self::Deadline => "deadline",
            Self::QpFailed => "qp-failed",
        })
    }
}

/// The initial belief of an estimator and its trust in model and measurements, as standard
/// deviations. Errors of different quantities are independent.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tuning {
    /// The estimate of z before the first measurement, `nx`.
    pub initial_estimate: Vec<f64>,
    /// Its standard deviations, 0 or more.
    pub initial_sd: Vec<f64>,
    /// The standard deviation of the model's error in each step, `nx`, 0 or more.
    pub process_sd: Vec<f64>,
    /// The noise of each measured quantity, `ny`, positive.
    pub measurement_sd: Vec<f64>,
    /// The parameters of the model before [`Estimator::set_parameters`], `np`.
    pub parameters: Vec<f64>,
    /// The least that each entry of z can be, `nx`, or empty: no bounds. Kalman filters clip their
    /// estimates.
    pub low: Vec<f64>,
    /// The most that each entry of z can be, `nx`, or empty: no bounds.
    pub high: Vec<f64>,
    /// Which measurements are rejected.
    pub gate: Gate,
    /// The width of the range in which each entry of z moves, 0 or more (0 if it is not known), for
    /// the first entries or for none: how far off a lost estimate may be. The gate passes a reading
    /// so far off after [`Gate::PATIENCE`] rejections, and no prediction leaves a standard deviation
    /// beyond it ([`Tuning::most_variance`]).
    pub range: Vec<f64>,
    /// How far the sigma points of [`Ukf`](crate::Ukf) are from the estimate, alpha in (0, 1] of the scaled
    /// points; [`Tuning::ALPHA`] if absent.
    pub alpha: Option<f64>,
}

impl Tuning {
    /// Alpha of sigma points in which the model is nearly linear.
    pub const ALPHA: f64 = 1e-3;

    /// Whether there are bounds.
    #[must_use]
    pub fn is_bounded(&self) -> bool {
        !(self.low.is_empty() && self.high.is_empty())
    }

    /// Checks it for a model of dimensions `dims`.
    pub(crate) fn validate(&self, dims: Dims) -> Result<(), EstimateError> {
        self.gate.validate()?;
        check("parameters", &self.parameters, dims.np, "finite", f64::is_finite)?;
        let alpha = self.alpha.as_slice();
        check("alpha", alpha, alpha.len(), "more than 0, and 1 or less", |a| a > 0.0 && a <= 1.0)?;
        let nx = dims.nx;
        let sd = |value: f64| value.is_finite() && value >= 0.0;
        let positive = |value: f64| value.is_finite() && value > 0.0;
        check("initial_estimate", &self.initial_estimate, nx, "finite", f64::is_finite)?;
        check("initial_sd", &self.initial_sd, nx, "0 or more, and finite", sd)?;
        check("process_sd", &self.process_sd, nx, "0 or more, and finite", sd)?;
        let range = self.range.len().min(nx);
        check(
            "range",
            &self.range,
            range,
            "0 or more, and finite, one per entry of z at most",
            sd,
        )?;
        let sd = &self.measurement_sd;
        check("measurement_sd", sd, dims.ny, "positive and finite", positive)?;
        if !self.low.is_empty() {
            check("low", &self.low, nx, "finite or -inf", |v| v < f64::INFINITY)?;
        }
        if !self.high.is_empty() {
            check("high", &self.high, nx, "finite or inf", |v| v > f64::NEG_INFINITY)?;
        }
        for (index, (low, &high)) in self.low.iter().zip(&self.high).enumerate() {
            if *low > high {
                let (field, expected) = ("high", "at least the lower bound");
                return Err(ArgumentError::Number { field, index, expected, value: high }.into());
            }
        }
        Ok(())
    }

    /// The most that a prediction may leave of each entry's variance, `nx`: the square of
    /// [`Tuning::range`], or the variance at the beginning or of a step if it is larger; infinite
    /// where no range is known.
    #[must_use]
    pub fn most_variance(&self) -> Vec<f64> {
        let own = self.initial_sd.iter().zip(&self.process_sd).enumerate();
        let most = |(k, (initial, in_a_step)): (usize, (&f64, &f64))| match self.range.get(k) {
            Some(&range) if range > 0.0 => range.max(*initial).max(*in_a_step).powi(2),
            Some(_) | None => f64::INFINITY,
        };
        own.map(most).collect()
    }

    /// Moves an estimate into the bounds.
    pub(crate) fn clip(&self, z: &mut [f64]) {
        z.iter_mut().zip(&self.low).for_each(|(z, low)| *z = z.max(*low));
        z.iter_mut().zip(&self.high).for_each(|(z, high)| *z = z.min(*high));
    }
}

/// The squares of standard deviations.
pub(crate) fn variances(sd: &[f64]) -> Vec<f64> {
    sd.iter().map(|sd| sd * sd).collect()
}

/// Scales the covariance `p`, `[n, n]`, so that no variance exceeds `most`, `n`. Correlations stay.
pub(crate) fn limit(most: &[f64], p: &mut [f64]) {
    let n = most.len();
    for (k, most) in most.iter().enumerate() {
        let variance = p[k * n + k];
        if variance > *most {
            let factor = (most / variance).sqrt();
            p[k * n..(k + 1) * n].iter_mut().for_each(|entry| *entry *= factor);
            p.iter_mut().skip(k).step_by(n).for_each(|entry| *entry *= factor);
        }
    }
}

/// Writes the covariance of independent quantities, `[n, n]`.
pub(crate) fn write_diagonal(sd: &[f64], p: &mut [f64]) {
    p.fill(0.0);
    for (entry, sd) in p.iter_mut().step_by(sd.len() + 1).zip(sd) {
        *entry = sd * sd;
    }
}
