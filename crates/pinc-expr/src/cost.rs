//! A cost beside the equations of a plant: integrated along them, and at an end.

use crate::error::{ExpressionError, ExpressionProblem};
use crate::graph::Value;
use crate::plant_graph::PlantGraph;
use crate::{TimeUnit, parser, variable};
use std::collections::{BTreeMap, BTreeSet};

/// A cost as text, of states, inputs, outputs, parameters and intermediates of a plant, and the
/// time `t`.
///
/// [`PlantEquations::compile_with_cost`](crate::PlantEquations::compile_with_cost) puts it beside
/// the equations of a plant.
#[derive(Clone, Copy, Debug)]
pub struct CostExpressions<'a> {
    /// The rate of the cost, in its unit per second, or per `time_unit` of the equations.
    pub stage: &'a str,
    /// The cost of an end.
    pub terminal: &'a str,
    /// Named numbers of the two.
    pub parameters: &'a BTreeMap<String, f64>,
}

impl<'a> CostExpressions<'a> {
    /// The keys of the expressions in errors, with their texts.
    pub(crate) fn texts(self) -> [(&'static str, &'a str); 2] {
        [("stage", self.stage), ("terminal", self.terminal)]
    }
}

/// The states that a cost adds, which follow the plant's own.
pub(crate) const ADDED: [&str; 2] = ["t", "cost"];

impl PlantGraph {
    /// Adds the states `t` and `cost`, whose derivatives are 1 and the rate of the cost, and two
    /// outputs: that rate and the cost of an end. The graph's variables already have places for the
    /// states.
    pub(crate) fn add_cost(
        &mut self,
        cost: CostExpressions<'_>,
        texts: [&str; 2],
        scope: BTreeMap<&str, Value>,
        unit: TimeUnit,
    ) -> Result<(), ExpressionError> {
        let own: Vec<Value> = (0..self.states.len()).map(|i| self.graph.variable(i)).collect();
        if self.outputs.is_empty() {
            self.output_variables.clone_from(&self.states);
            self.outputs.clone_from(&own);
        }
        let (named, mut scope) = (self.output_variables.clone(), scope);
        for (output, value) in named.iter().zip(&self.outputs) {
            scope.entry(output.name.as_ref()).or_insert(*value);
        }
        for (name, &value) in cost.parameters {
            if let Some(meaning) = parser::reserved(name) {
                let problem = ExpressionProblem::Reserved { name: name.clone(), meaning };
                return Err(problem.at(format!("parameters.{name}")));
            }
            scope.insert(name, self.graph.constant(value));
        }
        scope.insert(ADDED[0], self.graph.variable(own.len()));
        let mut values = Vec::new();
        for ((key, _), text) in cost.texts().into_iter().zip(texts) {
            values.push(parser::parse(key, text, &scope, &mut self.graph)?);
            self.keys.push((self.graph.nodes.len(), key.to_owned()));
        }
        let used: BTreeSet<_> = texts.into_iter().flat_map(parser::names).collect();
        if let Some(name) = cost.parameters.keys().find(|name| !used.contains(name.as_str())) {
            return Err(ExpressionProblem::UnusedParameter.at(format!("parameters.{name}")));
        }
        if unit != TimeUnit::S {
            let per_second = self.graph.constant(1.0 / unit.seconds());
            values[0] = self.graph.mul(values[0], per_second);
        }
        self.derivatives.push(self.graph.constant(1.0));
        self.derivatives.push(values[0]);
        self.states.extend(ADDED.map(|name| variable(name, "")));
        self.outputs.extend(values);
        self.output_variables
            .extend(["stage cost", "terminal cost"].map(|name| variable(name, "")));
        Ok(())
    }
}
