//! The section `[control.cost]`: a cost as text.

use crate::PlantSpec;
use pinc_expr::{CostExpressions, Equations, ExpressionError, PlantEquations};
use pinc_ode::DynPlant;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// A cost beside the quadratic one of `q` and `r`, or in its place: what a plan costs, less what it earns.
///
/// Its expressions have the states, inputs, outputs, parameters and intermediate expressions of the
/// plant, the numbers of `parameters`, and `t`, the time in s since the loop began.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CostSpec {
    /// Cost per second, or per `time_unit` of the plant's equations, which is integrated over each stage of
    /// the horizon: by the integrator that is the model, or along a net by Gauss-Legendre quadrature
    /// with three points.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stage: Option<String>,
    /// Cost of the last predicted state, with the last input.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub terminal: Option<String>,
    /// Numbers by name, prices for instance.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub parameters: BTreeMap<String, f64>,
}

impl CostSpec {
    /// The plant extended by the time and the cost (see
    /// [`PlantEquations::compile_with_cost`]), with the parameters `varying`. Of a plant without
    /// equations only the cost is known: its states stay where they are.
    ///
    /// # Errors
    ///
    /// What is wrong with an expression, at the key `stage` or `terminal`.
    pub fn beside(
        &self,
        plant: &PlantSpec,
        varying: &[&str],
    ) -> Result<Box<dyn DynPlant>, ExpressionError> {
        let equations = plant.equations().unwrap_or_else(|| at_rest(plant));
        Ok(equations.compile_with_cost(varying, self.expressions())?.into_dyn())
    }

    /// The expressions that are given.
    pub(crate) fn texts(&self) -> impl Iterator<Item = &str> {
        [&self.stage, &self.terminal].into_iter().flatten().map(String::as_str)
    }

    /// Whether the time stands in it.
    #[must_use]
    pub fn has_time(&self) -> bool {
        self.texts().any(|s| s.split(|c: char| c != '_' && !c.is_alphanumeric()).any(|w| w == "t"))
    }

    /// The expressions, 0 for one that is left out.
    pub(crate) fn expressions(&self) -> CostExpressions<'_> {
        CostExpressions {
            stage: self.stage.as_deref().unwrap_or("0"),
            terminal: self.terminal.as_deref().unwrap_or("0"),
            parameters: &self.parameters,
        }
    }
}

/// The states and inputs of a plant that another program simulates, without its equations.
fn at_rest(plant: &PlantSpec) -> PlantEquations {
    let variables = plant.variables();
    let rate = |name: String| (name, "0".to_owned());
    Equations {
        derivatives: variables.state_names().into_iter().map(rate).collect(),
        states: variables.states,
        inputs: variables.inputs,
        ..Equations::default()
    }
    .into()
}
