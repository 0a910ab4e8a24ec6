//! The box of states and inputs that a net is trained on.

use crate::NetError;
use pinc_ode::Dims;
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// A box of initial states and inputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Domain {
    /// Lower ends of the states, in the plant's order and units.
    pub state_low: Vec<f64>,
    /// Upper ends of the states.
    pub state_high: Vec<f64>,
    /// Lower ends of the inputs.
    pub input_low: Vec<f64>,
    /// Upper ends of the inputs.
    pub input_high: Vec<f64>,
}

impl Domain {
    /// The box of these ranges, in the plant's order and units.
    ///
    /// ```
    /// let domain = pinc_net::Domain::new([-3.0..=3.0, -4.0..=4.0], [-1.0..=1.0]);
    /// assert_eq!(domain.state_high, [3.0, 4.0]);
    /// ```
    #[must_use]
    pub fn new(
        states: impl IntoIterator<Item = RangeInclusive<f64>>,
        inputs: impl IntoIterator<Item = RangeInclusive<f64>>,
    ) -> Self {
        let (state_low, state_high) = states.into_iter().map(RangeInclusive::into_inner).unzip();
        let (input_low, input_high) = inputs.into_iter().map(RangeInclusive::into_inner).unzip();
        Self { state_low, state_high, input_low, input_high }
    }

    /// Checks the lengths against the plant's, and that every lower end is below its upper end.
    ///
    /// # Errors
    ///
    /// [`NetError::Dimension`] or [`NetError::Setting`].
    pub fn validate(&self, dims: Dims) -> Result<(), NetError> {
        let ends = [
            ("state_low", &self.state_low, dims.nx, "state"),
            ("state_high", &self.state_high, dims.nx, "state"),
            ("input_low", &self.input_low, dims.nu, "input"),
            ("input_high", &self.input_high, dims.nu, "input"),
        ];
        for (key, values, expected, per) in ends {
            if values.len() != expected {
                return Err(NetError::Dimension { key, found: values.len(), expected, per });
            }
            if let Some(bad) = values.iter().find(|v| !v.is_finite()) {
                let expected = "finite numbers";
                return Err(NetError::Setting { key, found: bad.to_string(), expected });
            }
        }
        for (key, low, high) in [
            ("state_low", &self.state_low, &self.state_high),
            ("input_low", &self.input_low, &self.input_high),
        ] {
            if let Some((low, high)) = low.iter().zip(high).find(|(low, high)| low >= high) {
                let found = format!("{low} (upper end {high})");
                return Err(NetError::Setting { key, found, expected: "less than the upper end" });
            }
        }
        Ok(())
    }

    /// How far each variable of the state `x` and the input `u` lies outside the box, states first;
    /// 0 for those inside.
    pub fn excess<'a>(&'a self, x: &'a [f64], u: &'a [f64]) -> impl Iterator<Item = f64> + 'a {
        let values = x.iter().chain(u).zip(self.ends());
        values.map(|(value, (low, high))| (low - value).max(value - high).max(0.0))
    }

    /// Lower and upper ends, states first, then inputs.
    pub fn ends(&self) -> impl Iterator<Item = (f64, f64)> {
        let states = self.state_low.iter().zip(&self.state_high);
        let inputs = self.input_low.iter().zip(&self.input_high);
        states.chain(inputs).map(|(&low, &high)| (low, high))
    }
}
