//! Plants whose equations are text.

mod error;
mod graph;
mod lexer;
mod parser;
mod program;

pub use error::{Excerpt, ExpressionError, ExpressionProblem};

use graph::{Graph, Value};
use pinc_ad::Scalar;
use pinc_ode::{Plant, Variable};
use program::Program;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

/// The equations of a plant as text, as they stand in a config file.
///
/// An expression has numbers (`1.5e-3`), names, `+ - * / ^`, parentheses, the number `pi` and the functions
/// `sqrt exp log sin cos tan tanh atan abs sign` of one and `min max` of two arguments. `^` binds
/// strongest and to the right; `log` is the natural logarithm; angles are in radians. What functions
/// do where they or their derivatives jump is said at [`Scalar`].
///
/// ```
/// use pinc_expr::Equations;
/// use pinc_ode::{Plant, Variable};
///
/// let equations = Equations {
///     states: vec![Variable::new("x1", "m"), Variable::new("x2", "m/s")],
///     inputs: vec![Variable::new("u", "N")],
///     parameters: [("mu".to_owned(), 1.0)].into(),
///     intermediates: [("damping".to_owned(), "mu*(1 - x1^2)".to_owned())].into(),
///     derivatives: [
///         ("x1".to_owned(), "x2".to_owned()),
///         ("x2".to_owned(), "damping*x2 - x1 + u".to_owned()),
///     ]
///     .into(),
/// };
/// let plant = equations.compile()?;
/// let mut dx = [0.0; 2];
/// plant.rhs(&[2.0, 1.0], &[0.5], &[], &mut dx);
/// assert_eq!(dx, [1.0, -4.5]);
/// # Ok::<(), pinc_expr::ExpressionError>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Equations {
    /// The states, in order.
    pub states: Vec<Variable>,
    /// The inputs, in order.
    pub inputs: Vec<Variable>,
    /// Named numbers.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub parameters: BTreeMap<String, f64>,
    /// Named expressions, for use in others; their order does not matter.
    #[serde(default, rename = "let", skip_serializing_if = "BTreeMap::is_empty")]
    pub intermediates: BTreeMap<String, String>,
    /// The time derivative of each state, in its unit per second.
    pub derivatives: BTreeMap<String, String>,
}

/// A plant compiled from [`Equations`].
///
/// Its right-hand side is a list of steps, each a `match` and an operation on whole vectors, in which
/// constants are folded and nothing is computed twice.
#[derive(Clone, Debug)]
pub struct ExpressionPlant {
    states: Vec<Variable>,
    inputs: Vec<Variable>,
    program: Program,
}

impl Plant for ExpressionPlant {
    fn states(&self) -> &[Variable] {
        &self.states
    }

    fn inputs(&self) -> &[Variable] {
        &self.inputs
    }

    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        self.program.run(x, u, dx);
    }
}

impl Equations {
    /// The plant with these equations.
    ///
    /// # Errors
    ///
    /// The first thing that is wrong with them.
    pub fn compile(&self) -> Result<ExpressionPlant, ExpressionError> {
        self.check_names()?;
        self.check_states_have_derivatives()?;
        let order = self.order()?;

        let mut graph = Graph::default();
        let mut scope: BTreeMap<&str, Value> = BTreeMap::new();
        for (i, variable) in self.states.iter().chain(&self.inputs).enumerate() {
            scope.insert(&variable.name, graph.variable(i));
        }
        for (name, &value) in &self.parameters {
            scope.insert(name, graph.constant(value));
        }
        for name in order {
            let text = &self.intermediates[name];
            let value = parser::parse(&format!("let.{name}"), text, &scope, &mut graph)?;
            scope.insert(name, value);
        }
        let derivative = |state: &Variable| {
            let name = state.name.as_ref();
            let key = format!("derivatives.{name}");
            parser::parse(&key, &self.derivatives[name], &scope, &mut graph)
        };
        let outputs = self.states.iter().map(derivative).collect::<Result<Vec<_>, _>>()?;
        self.check_parameters_are_used()?;

        let variables = self.states.len() + self.inputs.len();
        let program = Program::new(&graph, variables, &outputs)
            .map_err(|problem| problem.at("derivatives"))?;
        Ok(ExpressionPlant { states: self.states.clone(), inputs: self.inputs.clone(), program })
    }

    fn check_names(&self) -> Result<(), ExpressionError> {
        let mut taken: BTreeMap<&str, String> = BTreeMap::new();
        let listed = |field: &'static str, variables: &[Variable]| {
            let keys = variables.iter().enumerate();
            keys.map(|(i, v)| (v.name.to_string(), format!("{field}[{i}]"))).collect::<Vec<_>>()
        };
        let (states, inputs) = (listed("states", &self.states), listed("inputs", &self.inputs));
        let parameters = self.parameters.keys().map(|n| (n.clone(), format!("parameters.{n}")));
        let intermediates = self.intermediates.keys().map(|n| (n.clone(), format!("let.{n}")));
        let all: Vec<_> =
            states.into_iter().chain(inputs).chain(parameters).chain(intermediates).collect();
        for (name, key) in &all {
            if !lexer::is_valid_name(name) {
                return Err(ExpressionProblem::Name(name.clone()).at(key));
            }
            if let Some(meaning) = parser::reserved(name) {
                return Err(ExpressionProblem::Reserved { name: name.clone(), meaning }.at(key));
            }
            if let Some(first) = taken.insert(name, key.clone()) {
                return Err(ExpressionProblem::Duplicate { name: name.clone(), first }.at(key));
            }
        }
        for (name, &value) in &self.parameters {
            if !value.is_finite() {
                return Err(ExpressionProblem::NotFinite(value).at(format!("parameters.{name}")));
            }
        }
        Ok(())
    }

    fn check_states_have_derivatives(&self) -> Result<(), ExpressionError> {
        for (field, variables) in [("states", &self.states), ("inputs", &self.inputs)] {
            if variables.is_empty() {
                return Err(ExpressionProblem::Empty.at(field));
            }
        }
        let known: Vec<_> = self.states.iter().map(|state| state.name.to_string()).collect();
        if let Some(name) = self.derivatives.keys().find(|name| !known.contains(name)) {
            let problem = ExpressionProblem::UnknownState { found: name.clone(), known };
            return Err(problem.at(format!("derivatives.{name}")));
        }
        match known.into_iter().find(|name| !self.derivatives.contains_key(name)) {
            Some(name) => {
                let key = format!("derivatives.{name}");
                Err(ExpressionProblem::MissingDerivative(name).at(key))
            }
            None => Ok(()),
        }
    }

    fn check_parameters_are_used(&self) -> Result<(), ExpressionError> {
        let texts = self.derivatives.values().chain(self.intermediates.values());
        let used: BTreeSet<_> = texts.flat_map(|text| parser::names(text)).collect();
        match self.parameters.keys().find(|name| !used.contains(name.as_str())) {
            Some(name) => Err(ExpressionProblem::UnusedParameter.at(format!("parameters.{name}"))),
            None => Ok(()),
        }
    }

    /// The intermediate expressions in an order in which each comes after those that it needs: a
    /// depth-first search, on a list and not by recursion, so that none is too long.
    fn order(&self) -> Result<Vec<&str>, ExpressionError> {
        let needs = |name: &str| {
            let names = parser::names(&self.intermediates[name]);
            names.filter_map(|name| self.intermediates.get_key_value(name))
        };
        let mut order = Vec::new();
        let mut done = BTreeSet::new();
        for start in self.intermediates.keys() {
            if done.contains(start) {
                continue;
            }
            let mut path = vec![(start, needs(start))];
            while let Some((name, needed)) = path.last_mut() {
                match needed.find(|(next, _)| !done.contains(next)) {
                    Some((next, _)) => {
                        if let Some(first) = path.iter().position(|(name, _)| *name == next) {
                            let mut cycle: Vec<_> =
                                path[first..].iter().map(|(name, _)| (*name).clone()).collect();
                            cycle.push(next.clone());
                            return Err(ExpressionProblem::Cycle(cycle).at(format!("let.{next}")));
                        }
                        path.push((next, needs(next)));
                    }
                    None => {
                        order.push(name.as_str());
                        done.insert(*name);
                        path.pop();
                    }
                }
            }
        }
        Ok(order)
    }
}
