//! Sensors and an estimator in a closed loop.

use crate::matrix::{dot, factor, solve_lower};
use crate::{Augmentation, Correction, Estimator, EstimatorStatus};
use pinc_loop::{Observer, PlantNow};

/// Output feedback: the plant of a closed loop is measured, with noise, and an estimator makes of
/// it what the controller is told. The controller's model is to be
/// [`Compensated`](crate::Compensated) with the same augmentation.
///
/// All steps are remembered.
#[derive(Debug)]
pub struct OutputFeedback {
    estimator: Box<dyn Estimator>,
    augmentation: Augmentation,
    /// The noise of all steps, `[steps, ny]`.
    noise: Vec<f64>,
    measured: Vec<f64>,
    root: Vec<f64>,
    error: Vec<f64>,
    of_state: Vec<f64>,
    covariance: Vec<f64>,
    history: History,
}

/// The record of an estimator in a closed loop, step by step.
#[derive(Clone, Debug, Default, PartialEq)]
#[non_exhaustive]
pub struct History {
    /// The measurements, `[steps, ny]`.
    pub measured: Vec<f64>,
    /// The filtered estimates of z, `[steps, nz]`.
    pub estimates: Vec<f64>,
    /// Their standard deviations, `[steps, nz]`.
    pub sd: Vec<f64>,
    /// Measured minus expected, `[steps, ny]`.
    pub innovations: Vec<f64>,
    /// The results of the corrections.
    pub corrections: Vec<Correction>,
    /// How the predictions ended.
    pub predictions: Vec<EstimatorStatus>,
    /// The normalized errors squared, e' P^-1 e, with e the error of the state: of a consistent
    /// estimator they have the chi-squared distribution with `nx` degrees of freedom. NaN where P
    /// is singular.
    pub nees: Vec<f64>,
    /// The sums of the squares of the states' errors, `nx`.
    pub squared_errors: Vec<f64>,
}

impl History {
    /// Takes note of what the estimator knows after a correction by what was measured; its errors are
    /// noted apart.
    pub fn take_note(
        &mut self,
        estimator: &dyn Estimator,
        measured: &[f64],
        correction: Correction,
    ) {
        let variances = estimator.covariance().iter().step_by(estimator.dims().nx + 1);
        self.measured.extend(measured);
        self.estimates.extend(estimator.estimate());
        self.sd.extend(variances.map(|variance| variance.sqrt()));
        self.innovations.extend(estimator.innovation());
        self.corrections.push(correction);
    }
}

impl OutputFeedback {
    /// An `estimator` of the augmented model that reads what is measured, to which `noise` is
    /// added, `[steps, ny]`; steps beyond it have none.
    #[must_use]
    pub fn new(estimator: Box<dyn Estimator>, augmentation: Augmentation, noise: Vec<f64>) -> Self {
        let dims = estimator.dims();
        Self {
            noise,
            measured: vec![0.0; dims.ny],
            root: Vec::new(),
            error: Vec::new(),
            of_state: Vec::new(),
            covariance: Vec::new(),
            history: History::default(),
            augmentation,
            estimator,
        }
    }

    /// Returns the record of the estimator so far.
    #[must_use]
    pub fn history(&self) -> &History {
        &self.history
    }

    fn measure(&mut self, plant: PlantNow<'_>) {
        let quantities = self.augmentation.measured.iter();
        for (i, (y, measured)) in self.measured.iter_mut().zip(quantities).enumerate() {
            let noise = self.noise.get(plant.step * self.augmentation.measured.len() + i);
            *y = measured.read(plant.x, plant.y) + noise.unwrap_or(&0.0);
        }
    }

    /// The normalized error squared at the true state `x`.
    fn nees(&mut self, x: &[f64]) -> f64 {
        let n = x.len();
        let rows = self.estimator.covariance().chunks_exact(self.estimator.dims().nx);
        self.of_state.clear();
        rows.take(n).for_each(|row| self.of_state.extend(&row[..n]));
        self.root.resize(n * n, 0.0);
        self.error.clear();
        self.error.extend(self.estimator.estimate().iter().zip(x).map(|(z, x)| z - x));
        let history = &mut self.history.squared_errors;
        history.resize(n, 0.0);
        history.iter_mut().zip(&self.error).for_each(|(sum, e)| *sum += e * e);
        let singular = !factor(&self.of_state, n, &mut self.root)
            || (0..n).any(|i| self.root[i * (n + 1)] <= 0.0);
        if singular {
            return f64::NAN;
        }
        solve_lower(&self.root, &mut self.error);
        dot(&self.error, &self.error)
    }
}

impl Observer for OutputFeedback {
    fn observe(&mut self, plant: PlantNow<'_>, x: &mut [f64], parameters: &mut [f64]) {
        self.measure(plant);
        let known = parameters.len() - self.augmentation.known.len();
        self.estimator.set_parameters(&parameters[known..]);
        let correction = self.estimator.correct(&self.measured);
        let z = self.estimator.estimate();
        self.augmentation.read(z, x, parameters);
        let nees = self.nees(plant.x);
        self.history.nees.push(nees);
        self.history.take_note(&*self.estimator, &self.measured, correction);
    }

    fn covariance(&mut self) -> Option<&[f64]> {
        let dims = self.estimator.dims();
        let nx = dims.nx - self.augmentation.unknowns(dims);
        let of_estimate = self.estimator.covariance();
        self.augmentation.read_covariance(of_estimate, nx, &mut self.covariance);
        Some(&self.covariance)
    }

    fn advance(&mut self, u: &[f64]) {
        let status = self.estimator.predict(u);
        self.history.predictions.push(status);
    }
}
