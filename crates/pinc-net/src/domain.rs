//! The box of states, inputs and parameters that a net is trained on.

use crate::NetError;
use crate::error::{check, check_length, check_numbers};
use pinc_ode::{Dims, DynRhs};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::RangeInclusive;

/// A box of initial states, inputs and, for a net of a family of plants, parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Domain {
    /// Lower ends of the states, in the plant's order and units.
    pub state_low: Vec<f64>,
    /// Upper ends of the states, in the plant's order and units.
    pub state_high: Vec<f64>,
    /// Lower ends of the inputs, in the plant's order and units.
    pub input_low: Vec<f64>,
    /// Upper ends of the inputs, in the plant's order and units.
    pub input_high: Vec<f64>,
    /// Parameters that vary, each with its range. In files a table `{ name = [low, high] }`.
    #[serde(default, skip_serializing_if = "Vec::is_empty", with = "as_table")]
    pub parameters: Vec<ParameterRange>,
}

/// The values of a parameter for which a net is trained.
#[derive(Clone, Debug, PartialEq)]
pub struct ParameterRange {
    /// The parameter's name in the plant.
    pub name: String,
    /// The least value.
    pub low: f64,
    /// The largest value.
    pub high: f64,
}

impl ParameterRange {
    /// The parameter `name` in this range.
    #[must_use]
    pub fn new(name: impl Into<String>, range: RangeInclusive<f64>) -> Self {
        let (low, high) = range.into_inner();
        Self { name: name.into(), low, high }
    }
}

/// Ranges in files.
mod as_table {
    use super::{BTreeMap, Deserialize, ParameterRange, Serialize};
    use serde::{Deserializer, Serializer};

    pub(super) fn serialize<S: Serializer>(
        ranges: &[ParameterRange],
        to: S,
    ) -> Result<S::Ok, S::Error> {
        let table = ranges.iter().map(|range| (&range.name, [range.low, range.high]));
        table.collect::<BTreeMap<_, _>>().serialize(to)
    }

    pub(super) fn deserialize<'a, D: Deserializer<'a>>(
        from: D,
    ) -> Result<Vec<ParameterRange>, D::Error> {
        let table = BTreeMap::<String, [f64; 2]>::deserialize(from)?;
        let range = |(name, [low, high]): (String, [f64; 2])| ParameterRange { name, low, high };
        Ok(table.into_iter().map(range).collect())
    }
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
        Self { state_low, state_high, input_low, input_high, parameters: Vec::new() }
    }

    /// The box for plants whose parameters lie in these ranges.
    ///
    /// ```
    /// use pinc_net::{Domain, ParameterRange};
    /// let family = Domain::new([-3.0..=3.0, -4.0..=4.0], [-1.0..=1.0])
    ///     .with_parameters([ParameterRange::new("mu", 0.5..=1.5)]);
    /// assert_eq!(family.ends().last(), Some((0.5, 1.5)));
    /// ```
    #[must_use]
    pub fn with_parameters(self, ranges: impl IntoIterator<Item = ParameterRange>) -> Self {
        Self { parameters: ranges.into_iter().collect(), ..self }
    }

    /// The box with its parameters in the order of the plant.
    ///
    /// # Errors
    ///
    /// [`NetError::Parameter`] if the plant's varying parameters are not the box's.
    pub fn in_order_of(&self, plant: &dyn DynRhs) -> Result<Self, NetError> {
        let of = |name: &str| self.parameters.iter().find(|range| range.name == name);
        let mut ordered = Vec::with_capacity(self.parameters.len());
        for parameter in plant.parameters() {
            let name = parameter.name.to_string();
            let problem = "varies in the plant, and has no range in the domain";
            let range = of(&name).ok_or(NetError::Parameter { name, problem })?;
            ordered.push(range.clone());
        }
        let unknown = self.parameters.iter().find(|range| !ordered.contains(range));
        if let Some(ParameterRange { name, .. }) = unknown {
            let problem = "has a range in the domain, and does not vary in the plant";
            return Err(NetError::Parameter { name: name.clone(), problem });
        }
        Ok(Self { parameters: ordered, ..self.clone() })
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
            check_numbers(key, values, expected, per)?;
        }
        for (key, low, high) in [
            ("state_low", &self.state_low, &self.state_high),
            ("input_low", &self.input_low, &self.input_high),
        ] {
            for (low, high) in low.iter().zip(high) {
                let found = format!("{low} (upper end {high})");
                check(low < high, key, found, "less than the upper end")?;
            }
        }
        check_length("parameters", self.parameters.len(), dims.np, "parameter that varies")?;
        for ParameterRange { name, low, high } in &self.parameters {
            let is_good = low < high && low.is_finite() && high.is_finite();
            let found = format!("{name} = [{low}, {high}]");
            check(is_good, "parameters", found, "a lower end, and a larger upper end")?;
        }
        Ok(())
    }

    /// The numbers of states, inputs and parameters.
    #[must_use]
    pub fn dims(&self) -> Dims {
        let parameters = self.parameters.len();
        Dims::new(self.state_low.len(), self.input_low.len()).with_parameters(parameters)
    }

    /// How far each variable of the state `x`, the input `u` and the parameters `p` lies outside
    /// the box, states first; 0 for those inside.
    pub fn excess<'a>(
        &'a self,
        x: &'a [f64],
        u: &'a [f64],
        p: &'a [f64],
    ) -> impl Iterator<Item = f64> + 'a {
        let values = x.iter().chain(u).chain(p).zip(self.ends());
        values.map(|(value, (low, high))| (low - value).max(value - high).max(0.0))
    }

    /// Lower and upper ends, states first, then inputs, then parameters.
    pub fn ends(&self) -> impl Iterator<Item = (f64, f64)> {
        let states = self.state_low.iter().zip(&self.state_high);
        let inputs = self.input_low.iter().zip(&self.input_high);
        let parameters = self.parameters.iter().map(|range| (range.low, range.high));
        states.chain(inputs).map(|(&low, &high)| (low, high)).chain(parameters)
    }
}
