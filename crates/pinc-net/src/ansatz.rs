//! The ansatz: from the output of the perceptron to the state.

use pinc_ad::Scalar;
use serde::{Deserialize, Serialize};

/// From the denormalized output d = `output_mean` + `output_std` z of the perceptron to the state
/// y(t).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Ansatz {
    /// y = d: the paper's net, which has to learn y(0) = y0 from the loss.
    Direct,
    /// y = y0 + (t/T) d: the initial condition holds by construction, `MSE_y` vanishes, and so does
    /// its weight against `MSE_F`. d is the mean velocity over \[0, t\], times T.
    HardLinear,
}

impl Ansatz {
    /// y(t) from d, for one state.
    #[inline(always)]
    pub(crate) fn state<S: Scalar>(self, t: S, sample_time_s: f64, y0: S, d: S) -> S {
        match self {
            Self::Direct => d,
            Self::HardLinear => (t / sample_time_s).mul_add(d, y0),
        }
    }

    /// The factor p(t) of d in y(t), and its time derivative.
    #[inline(always)]
    pub(crate) fn factor<S: Scalar>(self, t: S, sample_time_s: f64) -> (S, S) {
        match self {
            Self::Direct => (t.constant(1.0), t.constant(0.0)),
            Self::HardLinear => (t * (1.0 / sample_time_s), t.constant(1.0 / sample_time_s)),
        }
    }
}
