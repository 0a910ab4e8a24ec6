//! The Kalman filter.

use crate::extended::Extended;
use crate::{Correction, EstimateError, Estimator, EstimatorStatus, Tuning};
use pinc_ode::{Dims, Memory, Model};

/// The extended Kalman filter, which linearizes the model at the estimate: with a linear model, the
/// Kalman filter.
///
/// ```text
/// correct   S = H P H' + R,  K = P H' S^-1,  z += K (y - h(z)),
///           P = (I - K H) P (I - K H)' + K R K'
/// predict   A = dF/dz(z, u),  P = A P A' + Q,  z = F(z, u)
/// ```
///
/// Reference: Simon, *Optimal State Estimation*, section 13.2.
///
/// ```
/// use pinc_estimate::{Augmentation, Augmented, Ekf, Estimator, Measured, Tuning};
/// use pinc_ode::Rk4;
/// use pinc_plants::VanDerPol;
///
/// // The position is measured, the velocity is not.
/// let oscillator = Rk4::new(VanDerPol::default(), 0.5, 4);
/// let position = Augmentation::measured(Measured::states([0]));
/// let model = Augmented::new(Box::new(oscillator), position)?;
/// let tuning = Tuning {
///     initial_estimate: vec![0.0; 2],
///     initial_sd: vec![1.0; 2],
///     process_sd: vec![0.02; 2],
///     measurement_sd: vec![0.1],
///     ..Tuning::default()
/// };
/// let mut filter = Ekf::new(Box::new(model), tuning)?;
/// filter.correct(&[0.93]);
/// filter.predict(&[-0.25]);
/// assert!(filter.estimate()[1] < 0.0);
/// # Ok::<(), pinc_estimate::EstimateError>(())
/// ```
#[derive(Debug)]
pub struct Ekf {
    filter: Extended,
    tuning: Tuning,
    z: Vec<f64>,
}

impl Ekf {
    /// A filter with the outputs of `model` as what is measured. Until the first prediction the
    /// input is taken to be 0, or the one given to [`Estimator::reset_input`].
    ///
    /// # Errors
    ///
    /// [`EstimateError`] if the tuning does not suit the model.
    pub fn new(model: Box<dyn Model>, tuning: Tuning) -> Result<Self, EstimateError> {
        let filter = Extended::new(model, &tuning)?;
        Ok(Self { filter, z: tuning.initial_estimate.clone(), tuning })
    }
}

impl Estimator for Ekf {
    fn dims(&self) -> Dims {
        self.filter.model.dims()
    }

    fn reset(&mut self) {
        self.filter.reset(&self.tuning);
        self.z.copy_from_slice(&self.tuning.initial_estimate);
    }

    fn reset_input(&mut self, u: &[f64]) {
        self.reset();
        self.filter.u.copy_from_slice(u);
    }

    fn set_parameters(&mut self, p: &[f64]) {
        self.filter.p.copy_from_slice(p);
    }

    fn correct_within(&mut self, y: &[f64], _expired: &mut dyn FnMut() -> bool) -> Correction {
        let correction = self.filter.correct(&self.z, y);
        if correction.status.is_corrected() {
            self.z.iter_mut().zip(&self.filter.change).for_each(|(z, change)| *z += change);
        }
        self.tuning.clip(&mut self.z);
        correction
    }

    fn predict(&mut self, u: &[f64]) -> EstimatorStatus {
        let Some(status) = self.filter.predict(&self.z, u) else {
            return EstimatorStatus::NotFinite;
        };
        self.z.copy_from_slice(self.filter.next());
        status
    }

    fn estimate(&self) -> &[f64] {
        &self.z
    }

    fn covariance(&self) -> &[f64] {
        self.filter.kalman.covariance()
    }

    fn innovation(&self) -> &[f64] {
        &self.filter.innovation
    }

    fn remember(&mut self, memory: &mut Memory<'_>) {
        memory.numbers(&mut self.z);
        memory.numbers(&mut self.filter.u);
        memory.numbers(&mut self.filter.p);
        self.filter.kalman.remember(memory);
    }
}
