//! The estimated error of a net that runs freely.

use crate::{ErrorEstimate, VerifyError};
use pinc_net::{PincModel, PincNet, TrainingTarget};
use pinc_ode::{DynPlant, Linearization, Model, Stages};

/// Carries the estimated error of a net along its chain: after a step from an error E it is A E + e,
/// with A the net's Jacobian by the state and e the estimated error of the step.
#[derive(Debug)]
pub struct ChainedError {
    plant: Box<dyn DynPlant>,
    /// For steps of the length that was asked for last.
    step: Step,
}

#[derive(Debug)]
struct Step {
    t: f64,
    model: PincModel,
    estimate: ErrorEstimate,
}

impl Step {
    /// None for a length that the net does not know.
    fn at(net: &PincNet, plant: &dyn DynPlant, t: f64) -> Option<Self> {
        let model = PincModel::at(net, t).ok()?;
        Some(Self { t, model, estimate: ErrorEstimate::at(net, plant, t).ok()? })
    }
}

impl ChainedError {
    /// Of a net that stands for `plant`.
    ///
    /// # Errors
    ///
    /// As [`ErrorEstimate::new`].
    pub fn new(net: &PincNet, plant: Box<dyn DynPlant>) -> Result<Self, VerifyError> {
        let (t, estimate) = (net.sample_time_s(), ErrorEstimate::new(net, &*plant)?);
        let step = Step { t, model: PincModel::new(net).map_err(VerifyError::Net)?, estimate };
        Ok(Self { plant, step })
    }

    /// The error after `t` seconds from the state `x` with the error `error`; NaN for a time that a
    /// distilled net does not know.
    ///
    /// # Shapes
    ///
    /// `x`, `error`: `nx`; `u`: `nu`; `p`: `np`.
    #[must_use]
    pub fn step(
        &mut self,
        net: &PincNet,
        t: f64,
        [x, u, p]: [&[f64]; 3],
        error: &[f64],
    ) -> Vec<f64> {
        let is_known = t.total_cmp(&self.step.t).is_eq();
        if !is_known && net.source() == TrainingTarget::Integrator {
            return vec![f64::NAN; x.len()];
        }
        if !is_known && let Some(step) = Step::at(net, &*self.plant, t) {
            self.step = step;
        }
        let Step { model, estimate, .. } = &mut self.step;
        let (n, m) = (x.len(), u.len());
        let (mut next, mut a, mut b) = (vec![0.0; n], vec![0.0; n * n], vec![0.0; n * m]);
        let out = Linearization { next: &mut next, a: &mut a, b: &mut b, e: &mut [] };
        model.linearize(Stages { x, u, p }, out);
        let mut own = vec![0.0; n];
        estimate.write(x, u, p, &mut own);
        let carried = a.chunks_exact(n).map(|row| row.iter().zip(error).map(|(a, e)| a * e).sum());
        carried.zip(own).map(|(carried, own): (f64, f64)| carried + own).collect()
    }
}
