//! The Kalman filter.

use crate::kalman::{Kalman, subtract};
use crate::{Correction, EstimateError, Estimator, EstimatorStatus, Tuning};
use pinc_mpc::Memory;
use pinc_ode::{Dims, Linearization, LinearizationBuffer, Model, OutputLinearization, Stages};
use pinc_qp::all_finite;

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
    model: Box<dyn Model>,
    tuning: Tuning,
    kalman: Kalman,
    z: Vec<f64>,
    /// The input of the last prediction, for outputs that depend on it.
    u: Vec<f64>,
    change: Vec<f64>,
    innovation: Vec<f64>,
    expected: Vec<f64>,
    h: Vec<f64>,
    by_u: Vec<f64>,
    at: LinearizationBuffer,
}

impl Ekf {
    /// A filter with the outputs of `model` as what is measured. Until the first prediction the
    /// input is taken to be 0, or the one given to [`Estimator::reset_input`].
    ///
    /// # Errors
    ///
    /// [`EstimateError`] if the tuning does not suit the model.
    pub fn new(model: Box<dyn Model>, tuning: Tuning) -> Result<Self, EstimateError> {
        let dims = model.dims();
        tuning.validate(dims)?;
        Ok(Self {
            kalman: Kalman::new(&tuning),
            z: tuning.initial_estimate.clone(),
            tuning,
            u: vec![0.0; dims.nu],
            change: vec![0.0; dims.nx],
            innovation: vec![f64::NAN; dims.ny],
            expected: vec![0.0; dims.ny],
            h: vec![0.0; dims.ny * dims.nx],
            by_u: vec![0.0; dims.ny * dims.nu],
            at: LinearizationBuffer::new(dims, 1),
            model,
        })
    }

    /// Corrects without regard to bounds.
    fn correct_freely(&mut self, y: &[f64]) -> Correction {
        assert_eq!(y.len(), self.expected.len(), "length of y");
        self.model.linearize_output(
            Stages { x: &self.z, u: &self.u, p: &[] },
            OutputLinearization {
                y: &mut self.expected,
                c: &mut self.h,
                d: &mut self.by_u,
                e: &mut [],
            },
        );
        subtract(y, &self.expected, &mut self.innovation);
        if !all_finite(&self.expected) || !all_finite(&self.h) {
            let measured = y.iter().filter(|y| y.is_finite()).count();
            return Correction::unused(EstimatorStatus::NotFinite, measured);
        }
        let correction = self.kalman.correct(&self.h, &mut self.innovation, &mut self.change);
        if correction.status.is_corrected() {
            self.z.iter_mut().zip(&self.change).for_each(|(z, change)| *z += change);
        }
        correction
    }
}

impl Estimator for Ekf {
    fn dims(&self) -> Dims {
        self.model.dims()
    }

    fn reset(&mut self) {
        self.kalman.reset(&self.tuning);
        self.z.copy_from_slice(&self.tuning.initial_estimate);
        self.u.fill(0.0);
        self.innovation.fill(f64::NAN);
    }

    fn reset_input(&mut self, u: &[f64]) {
        self.reset();
        self.u.copy_from_slice(u);
    }

    fn correct_within(&mut self, y: &[f64], _expired: &mut dyn FnMut() -> bool) -> Correction {
        let correction = self.correct_freely(y);
        self.tuning.clip(&mut self.z);
        correction
    }

    fn predict(&mut self, u: &[f64]) -> EstimatorStatus {
        self.u.copy_from_slice(u);
        let LinearizationBuffer { next, a, b, .. } = &mut self.at;
        let out = Linearization { next, a, b, e: &mut [] };
        self.model.linearize(Stages { x: &self.z, u, p: &[] }, out);
        if !all_finite(&self.at.next) {
            return EstimatorStatus::NotFinite;
        }
        let status = self.kalman.predict(&self.at.a);
        self.z.copy_from_slice(&self.at.next);
        status
    }

    fn estimate(&self) -> &[f64] {
        &self.z
    }

    fn covariance(&self) -> &[f64] {
        self.kalman.covariance()
    }

    fn innovation(&self) -> &[f64] {
        &self.innovation
    }

    fn remember(&mut self, memory: &mut Memory<'_>) {
        memory.numbers(&mut self.z);
        memory.numbers(&mut self.u);
        self.kalman.remember(memory);
    }
}
