//! The error of a model over one step.

use crate::{OperatingPoint, Region};
use pinc_ode::{DynRhs, Model, Simulator};

/// Local error tolerance of the truth.
const TOLERANCE: f64 = 1e-12;

/// Random points of a region and the true state a step later.
///
/// ```
/// use pinc_analysis::{OneStepSamples, Region};
/// use pinc_ode::{Dims, Rk4};
/// use pinc_plants::VanDerPol;
///
/// let plant = VanDerPol::default();
/// let region = Region::new(Dims::new(2, 1), vec![-2.0, -2.0, -1.0], vec![2.0, 2.0, 1.0]);
/// let samples = OneStepSamples::draw(&plant, &region, 1, 100, 0.5);
/// let error = |n| samples.rms_error(&mut Rk4::new(plant, 0.5, n), &[1.0, 1.0]);
/// assert!(error(8) < 0.1 * error(4));
/// ```
#[derive(Clone, Debug)]
pub struct OneStepSamples {
    samples: Vec<(OperatingPoint, Vec<f64>)>,
    missing: usize,
}

impl OneStepSamples {
    /// `count` points, and the states after `step_s` seconds under a constant input.
    #[must_use]
    pub fn draw(plant: &dyn DynRhs, region: &Region, seed: u64, count: usize, step_s: f64) -> Self {
        let mut truth = Simulator::new(plant, TOLERANCE);
        let samples: Vec<_> = region
            .points(seed)
            .take(count)
            .filter_map(|point| {
                let mut end = point.x.clone();
                truth.integrate(&mut end, &point.u, step_s).ok()?;
                Some((point, end))
            })
            .collect();
        let missing = count - samples.len();
        Self { samples, missing }
    }

    /// How many points have no solution over the whole step.
    #[must_use]
    pub fn missing(&self) -> usize {
        self.missing
    }

    /// How many points have one.
    #[must_use]
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// Whether no point has one.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// The root of the mean squared error of a step of `model`, in units of `scale`, shape `nx`.
    pub fn rms_error(&self, model: &mut dyn Model, scale: &[f64]) -> f64 {
        let mut next = vec![0.0; scale.len()];
        let (mut predicted, mut truth) = (Vec::new(), Vec::new());
        for (point, end) in &self.samples {
            model.step(&point.x, &point.u, &[], &mut next);
            predicted.extend_from_slice(&next);
            truth.extend_from_slice(end);
        }
        pinc_ode::metrics::mean_squared_error(&predicted, &truth, scale).sqrt()
    }
}
