//! Algebraic variables: what stands in files, and what must be true of it.

use crate::arrays::place;
use crate::error::{ExpressionError, ExpressionProblem};
use crate::graph::{Graph, Value};
use crate::structure::{Block, blocks, variables_of};
use crate::{Equations, parser, variable};
use pinc_ode::Variable;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The most algebraic variables of a plant.
pub(crate) const MOST_UNKNOWNS: usize = 32;

/// The most of them that depend on one another.
pub(crate) const LARGEST_BLOCK: usize = 8;

/// An algebraic variable z of 0 = g(x, z, u, p), with one of the equations.
///
/// In files it is a table `{ equation = "q^2*r - h", start = "sqrt(h)", low = 0.0, high = 10.0 }`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AlgebraicVariable {
    /// Expression that is 0, of states, inputs, parameters, intermediates and algebraic variables.
    /// It need not contain this variable if another equation does.
    pub equation: String,
    /// Start of the search for the root: a number, or an expression without algebraic variables;
    /// the middle of the box if absent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub start: Option<Start>,
    /// Lower end of the box in which the root is searched.
    pub low: f64,
    /// Upper end of the box in which the root is searched.
    pub high: f64,
    /// Unit; empty for a number without dimension.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub unit: String,
}

/// Where the search for a root begins.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "a number, or an expression without algebraic variables")]
pub enum Start {
    /// Always at this number.
    Number(f64),
    /// At the value of an expression.
    Expression(String),
}

/// The algebraic equations of a plant as values of its graph. The unknowns are its variables after
/// states, inputs and varying parameters, in the alphabetical order of their names.
#[derive(Clone, Debug, Default)]
pub(crate) struct Algebraic {
    pub(crate) names: Vec<String>,
    /// What is 0.
    pub(crate) residuals: Vec<Value>,
    /// Where the search begins.
    pub(crate) starts: Vec<Value>,
    /// Low and high of each unknown.
    pub(crate) limits: Vec<[f64; 2]>,
    /// The systems to be solved, one after the other.
    pub(crate) blocks: Vec<Block>,
}

impl Equations {
    pub(crate) fn check_algebraic(&self) -> Result<(), ExpressionError> {
        if self.algebraic.len() > MOST_UNKNOWNS {
            let (found, most) = (self.algebraic.len(), MOST_UNKNOWNS);
            return Err(ExpressionProblem::TooManyUnknowns { found, most }.at("algebraic"));
        }
        for (name, unknown) in &self.algebraic {
            let AlgebraicVariable { low, high, .. } = *unknown;
            if !(low < high && (high - low).is_finite()) {
                let problem = ExpressionProblem::Box { low, high };
                return Err(problem.at(format!("algebraic.{name}")));
            }
            if let Some(Start::Number(start)) = unknown.start
                && !(low..=high).contains(&start)
            {
                let problem = ExpressionProblem::Start { start, low, high };
                return Err(problem.at(format!("algebraic.{name}.start")));
            }
        }
        Ok(())
    }

    /// Reads equations and starts, and finds out in which order the equations can be solved.
    /// `scope` has all names; the unknowns are the variables of `graph` from `first` on.
    pub(crate) fn parse_algebraic(
        &self,
        first: usize,
        scope: &BTreeMap<&str, Value>,
        graph: &mut Graph,
        keys: &mut Vec<(usize, String)>,
    ) -> Result<Algebraic, ExpressionError> {
        let mut parsed = Algebraic::default();
        for (name, unknown) in &self.algebraic {
            let key = format!("algebraic.{name}");
            let value = parser::parse(&key, &unknown.equation, scope, graph)?;
            keys.push((graph.nodes.len(), key));
            parsed.residuals.push(value);
            parsed.names.push(name.clone());
            parsed.limits.push([unknown.low, unknown.high]);
        }
        for (name, unknown) in &self.algebraic {
            let key = format!("algebraic.{name}.start");
            let start = match &unknown.start {
                None => graph.constant(0.5 * (unknown.low + unknown.high)),
                Some(Start::Number(value)) => graph.constant(*value),
                Some(Start::Expression(text)) => parser::parse(&key, text, scope, graph)?,
            };
            let needs = variables_of(graph, start).into_iter().find(|variable| *variable >= first);
            if let Some(variable) = needs {
                let needed = parsed.names[variable - first].clone();
                return Err(ExpressionProblem::StartNeedsUnknown(needed).at(key));
            }
            keys.push((graph.nodes.len(), key));
            parsed.starts.push(start);
        }
        parsed.blocks = blocks(graph, first, &parsed.residuals, &parsed.names)?;
        for block in &parsed.blocks {
            if block.unknowns.len() > LARGEST_BLOCK {
                let (found, most) = (block.unknowns.len(), LARGEST_BLOCK);
                let name = &parsed.names[block.unknowns[0]];
                let problem = ExpressionProblem::TooManyUnknowns { found, most };
                return Err(problem.at(format!("algebraic.{name}")));
            }
        }
        Ok(parsed)
    }

    /// The outputs in the table and the algebraic variables, in the alphabetical order of their
    /// names, the elements of an array by their indices.
    pub(crate) fn output_variables(&self) -> Vec<Variable> {
        let own = self.outputs.iter().map(|(name, output)| (name, &output.unit));
        let unknowns = self.algebraic.iter().map(|(name, unknown)| (name, &unknown.unit));
        let all: BTreeMap<_, _> =
            own.chain(unknowns).map(|(name, unit)| (place(name), variable(name, unit))).collect();
        all.into_values().collect()
    }
}
