//! The sources of uncertainty.

use crate::TubeError;
use pinc_ode::{Dims, Model};
use std::fmt::Debug;

/// What makes a plant leave its controller's plan. Each source is a list with one number per state,
/// in its unit, or empty.
#[derive(Debug, Default)]
pub struct Sources {
    /// The probability with which each bound is to hold at each predicted state: what standard
    /// deviations and covariances need.
    pub probability: Option<f64>,
    /// Standard deviation of the model's error in each step, independent of all others.
    pub process_sd: Vec<f64>,
    /// The largest error of the model in each step.
    pub boxes: Vec<f64>,
    /// Parameters that are somewhere in an interval, and stay there over the horizon.
    pub parameters: Vec<Interval>,
    /// Whether the covariance counts of the state that a plan begins at, and of the parameters of the
    /// controller's model, which stay as they are over the horizon.
    pub estimate: bool,
    /// The error of the model at each stage, bounded by its estimate.
    pub error: Option<Box<dyn StageError>>,
}

/// A parameter in an interval.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Its place among the parameters of the [`TubeModel`].
    pub place: usize,
    /// Its least value.
    pub low: f64,
    /// Its largest value.
    pub high: f64,
}

/// Says how large the error of a model's step is.
pub trait StageError: Debug + Send {
    /// Writes the error after a step from `x` (`nx`) under `u` (`nu`) with the controller's
    /// parameters `p` (`np`), of either sign, into `error` (`nx`). It allocates nothing.
    fn write(&mut self, x: &[f64], u: &[f64], p: &[f64], error: &mut [f64]);
}

/// The model that evaluates intervals and outputs. Its parameters are the controller's, followed by
/// `more`.
#[derive(Debug)]
pub struct TubeModel {
    /// The model.
    pub model: Box<dyn Model>,
    /// The values of the parameters that the controller does not have.
    pub more: Vec<f64>,
}

/// The feedback that is taken to act on deviations from the plan, from the second input on.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Feedback {
    /// The gains of the linear-quadratic regulator along the plan, whose weights are 1 for all states
    /// and inputs.
    #[default]
    Riccati,
    /// None: deviations grow as the model lets them.
    None,
    /// K, `[m, n]`, with u = plan + K (x - plan).
    Given(Vec<f64>),
}

impl Sources {
    /// Checks them for a model of dimensions `dims`.
    pub(crate) fn validate(&self, dims: Dims, model: Option<&TubeModel>) -> Result<(), TubeError> {
        for (field, list) in [("process_sd", &self.process_sd), ("boxes", &self.boxes)] {
            if !list.is_empty() {
                length(field, list.len(), dims.nx)?;
            }
            let wrong = list.iter().find(|value| !(value.is_finite() && **value >= 0.0));
            if let Some(&value) = wrong {
                return Err(TubeError::Number { field, value, expected: "0 or more" });
            }
        }
        match self.probability {
            None if !self.process_sd.is_empty() || self.estimate => {
                return Err(TubeError::NoProbability);
            }
            Some(value) if !(0.5..1.0).contains(&value) => {
                let expected = "from 0.5 to less than 1";
                return Err(TubeError::Number { field: "probability", value, expected });
            }
            _ => {}
        }
        let Some(TubeModel { model, more }) = model else {
            let is_needed = !self.parameters.is_empty() || self.estimate && dims.np > 0;
            return if is_needed { Err(TubeError::NoModel) } else { Ok(()) };
        };
        length("the parameters of the tube's model", model.dims().np, dims.np + more.len())?;
        for &Interval { place, low, high } in &self.parameters {
            if place >= model.dims().np
                || low.partial_cmp(&high).is_none_or(std::cmp::Ordering::is_gt)
            {
                let expected = "a low end below a high one, of a parameter of the model";
                return Err(TubeError::Number { field: "an interval", value: low, expected });
            }
        }
        Ok(())
    }
}

pub(crate) fn length(field: &'static str, found: usize, expected: usize) -> Result<(), TubeError> {
    if found == expected { Ok(()) } else { Err(TubeError::Length { field, expected, found }) }
}
