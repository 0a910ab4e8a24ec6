//! What the extended Kalman filter and moving horizon estimation share.

use crate::kalman::{Kalman, subtract};
use crate::{Correction, EstimateError, EstimatorStatus, Tuning};
use pinc_ode::{LinearizationBuffer, Model, OutputLinearizationBuffer, Stages};
use pinc_qp::all_finite;

/// A model and the covariance of an estimate of its state, by the model linearized at the estimate,
/// which the owner keeps.
#[derive(Debug)]
pub(crate) struct Extended {
    pub(crate) model: Box<dyn Model>,
    pub(crate) kalman: Kalman,
    /// The input of the last prediction, for outputs that depend on it.
    pub(crate) u: Vec<f64>,
    /// The known parameters now.
    pub(crate) p: Vec<f64>,
    pub(crate) innovation: Vec<f64>,
    /// What the last correction adds to the estimate.
    pub(crate) change: Vec<f64>,
    outputs: OutputLinearizationBuffer,
    step: LinearizationBuffer,
}

impl Extended {
    pub(crate) fn new(model: Box<dyn Model>, tuning: &Tuning) -> Result<Self, EstimateError> {
        let dims = model.dims();
        tuning.validate(dims)?;
        // Nobody asks for Jacobians by what is known.
        let dims = dims.with_parameters(0);
        Ok(Self {
            kalman: Kalman::new(tuning),
            u: vec![0.0; dims.nu],
            p: tuning.parameters.clone(),
            innovation: vec![f64::NAN; dims.ny],
            change: vec![0.0; dims.nx],
            outputs: OutputLinearizationBuffer::new(dims, 1),
            step: LinearizationBuffer::new(dims, 1),
            model,
        })
    }

    pub(crate) fn reset(&mut self, tuning: &Tuning) {
        self.kalman.reset(tuning);
        self.u.fill(0.0);
        self.p.copy_from_slice(&tuning.parameters);
        self.innovation.fill(f64::NAN);
    }

    /// Corrects the covariance of the estimate `z` by the measurements `y`, and writes `innovation`
    /// and `change`.
    pub(crate) fn correct(&mut self, z: &[f64], y: &[f64]) -> Correction {
        assert_eq!(y.len(), self.innovation.len(), "length of y");
        let at = Stages { x: z, u: &self.u, p: &self.p };
        self.model.linearize_output(at, self.outputs.as_mut());
        let OutputLinearizationBuffer { y: expected, c: h, .. } = &self.outputs;
        subtract(y, expected, &mut self.innovation);
        if !all_finite(expected) || !all_finite(h) {
            let measured = y.iter().filter(|y| y.is_finite()).count();
            return Correction::unused(EstimatorStatus::NotFinite, measured);
        }
        self.kalman.correct(h, &mut self.innovation, &mut self.change)
    }

    /// Predicts the covariance one step ahead of the estimate `z`, under `u`; `None` if the model
    /// has no finite value there.
    pub(crate) fn predict(&mut self, z: &[f64], u: &[f64]) -> Option<EstimatorStatus> {
        self.u.copy_from_slice(u);
        self.model.linearize(Stages { x: z, u, p: &self.p }, self.step.as_mut());
        all_finite(&self.step.next).then(|| self.kalman.predict(&self.step.a))
    }

    /// Where the last prediction takes the estimate.
    pub(crate) fn next(&self) -> &[f64] {
        &self.step.next
    }
}
