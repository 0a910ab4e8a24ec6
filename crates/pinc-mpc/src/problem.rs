//! The control problem: horizons, weights and bounds.

use crate::MpcError;
use crate::error::{check_length, check_numbers, check_range};
use pinc_ode::Dims;
use serde::{Deserialize, Serialize};

/// The longest horizon, far beyond any use: memory is allocated for it.
const LONGEST: usize = 10_000;

/// The optimisation problem of the paper, Eqs. (`MS:cost`) to (`MS:ineq_const`), over the predicted
/// states x\[k+1\]..x\[k+N2\] and the inputs u\[k\]..u\[k+Nu-1\]:
///
/// ```text
/// min  sum_{j=N1..N2} w_j |y[k+j] - yref[k+j]|_Q^2  +  sum_{i=0..Nu-1} v_i |du[k+i]|_R^2
/// s.t. x[k+j+1] = f(x[k+j], u[k+j])                    j = 0..N2-1
///      u[k+j]   = u[k-1] + du[k] + .. + du[k+j]        j = 0..Nu-1
///      u[k+j]   = u[k+Nu-1]                            j = Nu..N2-1
///      x[k+1]..x[k+N2] and u[k]..u[k+Nu-1] within their bounds
/// ```
///
/// y are the controlled states; w and v come from the [`Profile`] of the weights. The
/// measured state x\[k\] is a fact and not bounded: it can sit a little outside.
#[derive(Clone, Debug, PartialEq)]
pub struct NmpcProblem {
    /// N1, the first predicted state that is tracked: from 1 to `last`.
    pub first: usize,
    /// N2, the last one: the prediction horizon, at most 10 000.
    pub last: usize,
    /// Nu, the number of free inputs: from 1 to `last`.
    pub control: usize,
    /// Which states are controlled, in the order of `weights.q` and of the references.
    pub controlled: Vec<usize>,
    /// Q, R and their profile.
    pub weights: Weights,
    /// Bounds on each predicted state.
    pub state_bounds: Bounds,
    /// Bounds on each input.
    pub input_bounds: Bounds,
}

impl NmpcProblem {
    /// Checks the problem against a model of dimensions `dims`.
    ///
    /// # Errors
    ///
    /// [`MpcError`], naming the field and what was expected of it.
    pub fn validate(&self, dims: Dims) -> Result<(), MpcError> {
        check_range("the model's states", dims.states, 1, usize::MAX)?;
        check_range("the model's inputs", dims.inputs, 1, usize::MAX)?;
        check_range("last (N2)", self.last, 1, LONGEST)?;
        check_range("first (N1)", self.first, 1, self.last)?;
        check_range("control (Nu)", self.control, 1, self.last)?;
        check_range("controlled", self.controlled.len(), 1, dims.states)?;
        for (i, &state) in self.controlled.iter().enumerate() {
            check_range("controlled", state, 0, dims.states - 1)?;
            if self.controlled[..i].contains(&state) {
                return Err(MpcError::ControlledTwice { state });
            }
        }
        let Weights { q, r, .. } = &self.weights;
        check_weights("weights.q", q, self.controlled.len())?;
        check_weights("weights.r", r, dims.inputs)?;
        self.state_bounds.validate("state_bounds", dims.states)?;
        self.input_bounds.validate("input_bounds", dims.inputs)
    }
}

/// The weights of the cost.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Weights {
    /// The diagonal of Q, one per controlled state; not negative.
    pub q: Vec<f64>,
    /// The diagonal of R, one per input; not negative.
    pub r: Vec<f64>,
    /// How the weights go along the horizon.
    #[serde(default)]
    pub profile: Profile,
}

/// How the weights go along the horizon.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Profile {
    /// The cost as printed: all `w_j = v_i = 1`.
    #[default]
    Uniform,
    /// The cost behind the paper's Table 1. Its authors' program adds up the stage costs
    ///
    /// ```text
    /// l_i = |y[k+i+1] - yref[k+i+1]|_Q^2 + |du[k+i]|_R^2        i = 0..N2-1
    /// ```
    ///
    /// in a variable that is never set back to 0 within the horizon, and adds that variable times T
    /// to the cost at every stage. Stage i is thus counted in its own stage and in every later one,
    /// its tracking part and its du part alike: `w_{i+1} = v_i = (N2 - i) T`. (The four tanks tell the
    /// readings apart: dense IAE 544.41, but 530.9 if only the tracking part were counted so and du
    /// once, 532.2 if it were counted once times T.)
    Cumulative,
}

impl Profile {
    /// The weight of stage `i` of `stages` stages of `horizon_s` seconds.
    pub(crate) fn weight(self, i: usize, stages: usize, horizon_s: f64) -> f64 {
        match self {
            Self::Uniform => 1.0,
            #[expect(clippy::cast_precision_loss, reason = "no horizon has 2^53 stages")]
            Self::Cumulative => (stages - i) as f64 * horizon_s,
        }
    }
}

/// Lower and upper bounds, one of each per variable. A bound that is infinite is none.
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

    /// By how much the worst of `values` is outside its bounds; 0 if none is.
    pub(crate) fn violation(&self, values: &[f64]) -> f64 {
        let bounds = self.low.iter().zip(&self.high);
        let outside = values.iter().zip(bounds).map(|(v, (low, high))| (low - v).max(v - high));
        outside.fold(0.0, f64::max)
    }

    /// Moves each of `values` to the nearest within its bounds.
    pub(crate) fn clamp(&self, values: &mut [f64]) {
        let bounds = self.low.iter().zip(&self.high);
        for (value, (&low, &high)) in values.iter_mut().zip(bounds) {
            *value = value.clamp(low, high);
        }
    }

    fn validate(&self, field: &'static str, variables: usize) -> Result<(), MpcError> {
        for side in [&self.low, &self.high] {
            check_length(field, side, variables)?;
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

fn check_weights(field: &'static str, weights: &[f64], expected: usize) -> Result<(), MpcError> {
    check_length(field, weights, expected)?;
    check_numbers(field, weights, "finite and not negative", |w| w >= 0.0 && w.is_finite())
}
