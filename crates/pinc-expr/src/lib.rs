#![doc = include_str!("../README.md")]
//! # Tour
//!
//! - [`Equations`]: a plant as text; [`Equations::compile`] makes a [`pinc_ode::Plant`] of it.
//! - [`PlantEquations`]: equations from text or from a plant in Rust, as a graph of values in which
//!   each value is computed once.
//! - [`TimeFunction`]: a function of the time as text.
//! - [`Listing`]: the right-hand side as instructions, for generated code.
//! - [`AlgebraicEquations`]: algebraic variables, solved by Newton's method in a box.
//! - [`CriticalTerms`]: the divisors and arguments that decide where an equation is smooth.
//! - [`ExpressionError`]: a mistake in an equation, with the piece of text.

#![forbid(unsafe_code)]

mod algebraic;
mod arrays;
mod checks;
mod cost;
mod critical;
mod error;
mod graph;
mod grouped;
mod implicit;
mod lexer;
mod listing;
mod nets;
mod parameters;
mod parser;
mod plant_graph;
mod program;
mod roots;
mod rust_plant;
mod source;
mod structure;
mod text_plant;
mod time_function;
mod time_unit;
mod traced;

pub use algebraic::{AlgebraicVariable, Start};
pub use cost::CostExpressions;
pub use critical::{CriticalTerm, CriticalTerms, LoneTerm, TermRole};
pub use error::{Deficiency, Excerpt, ExpressionError, ExpressionProblem};
pub use graph::Function;
pub use listing::{Instruction, Listing};
pub use nets::NetExpression;
pub use roots::{AlgebraicEquations, AlgebraicRoot, Unsolved, UnsolvedReason};
pub use rust_plant::into_dyn;
pub use source::PlantEquations;
pub use time_function::TimeFunction;
pub use time_unit::TimeUnit;

use algebraic::Algebraic;
use graph::{Graph, Value};
use grouped::GroupedFunction;
use implicit::AlgebraicSystem;
use pinc_ad::Scalar;
use pinc_ode::{Plant, SparsePlant, Variable};
use plant_graph::PlantGraph;
use program::Program;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The equations of a plant as text, as they stand in a config file.
///
/// An expression has numbers (`1.5e-3`), names, `+ - * / ^`, parentheses, the number `pi` and the
/// functions `sqrt exp log sin cos tan tanh atan abs sign` of one and `min max` of two arguments.
/// `^` binds strongest and to the right; `log` is the natural logarithm; angles are in radians.
/// What functions do where they or their derivatives jump is said at [`Scalar`].
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
///     ..Equations::default()
/// };
/// let plant = equations.compile()?;
/// let mut dx = [0.0; 2];
/// plant.rhs(&[2.0, 1.0], &[0.5], &[], &mut dx);
/// assert_eq!(dx, [1.0, -4.5]);
/// # Ok::<(), pinc_expr::ExpressionError>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Equations {
    /// Named whole numbers: sizes of arrays and ends of ranges.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub sizes: BTreeMap<String, usize>,
    /// States, in order; `T[n]` is an array of n states.
    pub states: Vec<Variable>,
    /// Inputs, in order.
    pub inputs: Vec<Variable>,
    /// Named numbers. In files, a list is an array with the elements `w[1]`, `w[2]` and so on.
    #[serde(
        default,
        skip_serializing_if = "BTreeMap::is_empty",
        deserialize_with = "parameters::deserialize"
    )]
    pub parameters: BTreeMap<String, f64>,
    /// Named expressions, for use in others; their order does not matter.
    #[serde(default, rename = "let", skip_serializing_if = "BTreeMap::is_empty")]
    pub intermediates: BTreeMap<String, String>,
    /// The unit of time of the equations: derivatives are per hour where it is `"h"`; if absent, per
    /// second. Reports then show times in it, unless the config says otherwise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_unit: Option<TimeUnit>,
    /// The time derivative of each state, in its unit per second, or per `time_unit`.
    pub derivatives: BTreeMap<String, String>,
    /// The algebraic variables, each with an equation: a differential-algebraic system of index 1.
    /// They are outputs too.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub algebraic: BTreeMap<String, AlgebraicVariable>,
    /// The outputs, with the algebraic variables in the alphabetical order of their names; the
    /// states where there are none.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub outputs: BTreeMap<String, OutputExpression>,
    /// Small nets, by name, for parts of which no equation is known.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub nets: BTreeMap<String, NetExpression>,
}

/// An output as text.
///
/// In files it is a table `{ expression = "pA + pB", unit = "kPa" }`, or the expression alone where
/// there is no unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(from = "OutputText", into = "OutputText")]
pub struct OutputExpression {
    /// The expression, of states, inputs, parameters and intermediates.
    pub expression: String,
    /// The unit; empty for a number without dimension.
    pub unit: String,
}

/// The forms of an output in files.
#[derive(Serialize, Deserialize)]
#[serde(untagged, expecting = "expected an expression, or a table { expression, unit }")]
enum OutputText {
    Expression(String),
    Table(OutputTable),
}

/// The long form in files.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct OutputTable {
    expression: String,
    #[serde(default)]
    unit: String,
}

impl From<OutputText> for OutputExpression {
    fn from(text: OutputText) -> Self {
        match text {
            OutputText::Expression(expression) => Self { expression, unit: String::new() },
            OutputText::Table(OutputTable { expression, unit }) => Self { expression, unit },
        }
    }
}

impl From<OutputExpression> for OutputText {
    fn from(OutputExpression { expression, unit }: OutputExpression) -> Self {
        if unit.is_empty() {
            Self::Expression(expression)
        } else {
            Self::Table(OutputTable { expression, unit })
        }
    }
}

/// A plant compiled from [`Equations`].
///
/// Its right-hand side is a list of steps, each a `match` and an operation on whole vectors, in
/// which constants are folded and nothing is computed twice; its outputs are another.
#[derive(Clone, Debug)]
pub struct ExpressionPlant {
    states: Vec<Variable>,
    inputs: Vec<Variable>,
    parameters: Vec<Variable>,
    rhs: Program,
    outputs: Option<Outputs>,
    algebraic: Option<AlgebraicSystem>,
    sparse: SparseEquations,
}

/// The equations with their Jacobians, of which integrators are made.
#[derive(Clone, Debug)]
struct SparseEquations {
    plant: SparsePlant<GroupedFunction>,
    rates: Arc<Rates>,
}

/// The derivatives of the states as values, of which second derivatives are made where a method
/// needs them.
#[derive(Debug)]
struct Rates {
    graph: Graph,
    algebraic: Algebraic,
    values: Vec<Value>,
}

/// Outputs that are not just the states.
#[derive(Clone, Debug)]
struct Outputs {
    variables: Vec<Variable>,
    program: Program,
}

impl Plant for ExpressionPlant {
    fn states(&self) -> &[Variable] {
        &self.states
    }

    fn inputs(&self) -> &[Variable] {
        &self.inputs
    }

    fn parameters(&self) -> &[Variable] {
        &self.parameters
    }

    fn outputs(&self) -> &[Variable] {
        self.outputs.as_ref().map_or(&self.states, |outputs| &outputs.variables)
    }

    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], dx: &mut [S]) {
        match &self.algebraic {
            None => self.rhs.run(x, u, p, dx),
            Some(system) => system.run(&self.rhs, [x, u, p], dx),
        }
    }

    fn output<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], y: &mut [S]) {
        match (&self.outputs, &self.algebraic) {
            (Some(outputs), Some(system)) => system.run(&outputs.program, [x, u, p], y),
            (Some(outputs), None) => outputs.program.run(x, u, p, y),
            (None, _) => y.copy_from_slice(x),
        }
    }

    fn explain(&self, x: &[f64], u: &[f64], p: &[f64]) -> Option<String> {
        let unsolved = self.algebraic.as_ref()?.examine([x, u, p]).err()?;
        Some(unsolved.to_string())
    }
}

impl Equations {
    /// The plant with these equations, all parameters fixed.
    ///
    /// # Errors
    ///
    /// The first thing that is wrong with them; a parameter that nothing uses.
    pub fn compile(&self) -> Result<ExpressionPlant, ExpressionError> {
        self.compile_beside(&[])
    }

    /// [`Equations::compile`] where `others`, expressions of a cost for instance, may use parameters too.
    ///
    /// # Errors
    ///
    /// As there.
    pub fn compile_beside(&self, others: &[&str]) -> Result<ExpressionPlant, ExpressionError> {
        self.unrolled(|plain| {
            let graph = plain.graph(&[])?;
            plain.check_parameters_are_used(others)?;
            graph.compile()
        })
    }

    /// The plant with these equations, in which the parameters named in `varying` are the `p` of
    /// f(x, u, p), in this order. The others are constants. [`Equations::parameters`] has the
    /// nominal values.
    ///
    /// # Errors
    ///
    /// The first thing that is wrong with the equations, or a name that is not a parameter's or
    /// given twice.
    pub fn compile_with(&self, varying: &[&str]) -> Result<ExpressionPlant, ExpressionError> {
        self.unrolled(|plain| plain.graph(varying)?.compile())
    }

    /// The values that derivatives and outputs are computed from, with a cost beside them if there
    /// is one.
    pub(crate) fn graph_with_cost(
        &self,
        varying: &[&str],
        cost: Option<CostExpressions<'_>>,
    ) -> Result<PlantGraph, ExpressionError> {
        match cost {
            None => self.unrolled(|plain| plain.graph(varying)),
            Some(cost) => self.unrolled_with(cost.texts(), |plain, texts| {
                plain.graph_beside(varying, Some((cost, texts)))
            }),
        }
    }

    /// The terms on which it depends where these equations are defined and smooth.
    ///
    /// # Errors
    ///
    /// The first thing that is wrong with the equations.
    pub fn critical_terms(&self) -> Result<CriticalTerms, ExpressionError> {
        self.unrolled(|plain| plain.graph(&[])?.critical_terms())
    }

    /// The values that derivatives and outputs are computed from.
    fn graph(&self, varying: &[&str]) -> Result<PlantGraph, ExpressionError> {
        self.graph_beside(varying, None)
    }

    /// The same with a cost, whose plain texts are given, beside them.
    fn graph_beside(
        &self,
        varying: &[&str],
        cost: Option<(CostExpressions<'_>, [&str; 2])>,
    ) -> Result<PlantGraph, ExpressionError> {
        self.check_names()?;
        self.check_states_have_derivatives()?;
        self.check_algebraic()?;
        self.check_varying(varying)?;
        let order = self.order()?;

        let mut graph = Graph::default();
        let mut scope: BTreeMap<&str, Value> = BTreeMap::new();
        let (mut names, mut keys) = (BTreeMap::new(), Vec::new());
        for (name, &value) in &self.parameters {
            scope.insert(name, graph.constant(value));
        }
        let mut variables: Vec<Option<&str>> = Vec::new();
        variables.extend(self.states.iter().map(|variable| Some(&*variable.name)));
        // No equation of the plant knows what a cost adds.
        variables.extend(cost.iter().flat_map(|_| cost::ADDED.map(|_| None)));
        variables.extend(self.inputs.iter().map(|variable| Some(&*variable.name)));
        variables.extend(varying.iter().map(|name| Some(*name)));
        for (i, name) in variables.iter().enumerate() {
            let value = graph.variable(i);
            if let Some(name) = name {
                scope.insert(name, value);
            }
        }
        for (i, name) in self.algebraic.keys().enumerate() {
            scope.insert(name, graph.variable(variables.len() + i));
        }
        for name in order {
            let key = format!("let.{name}");
            let value = parser::parse(&key, &self.intermediates[name], &scope, &mut graph)?;
            scope.insert(name, value);
            names.entry(value).or_insert_with(|| name.to_owned());
            keys.push((graph.nodes.len(), key));
        }
        let first = variables.len();
        let algebraic = self.parse_algebraic(first, &scope, &mut graph, &mut keys)?;
        let mut parse = |key: String, text: &str| {
            let value = parser::parse(&key, text, &scope, &mut graph)?;
            keys.push((graph.nodes.len(), key));
            Ok(value)
        };
        let mut derivatives = Vec::new();
        for state in &self.states {
            let name = state.name.as_ref();
            derivatives.push(parse(format!("derivatives.{name}"), &self.derivatives[name])?);
        }
        let mut outputs = Vec::new();
        let output_variables = self.output_variables();
        for Variable { name, .. } in &output_variables {
            let output = self.outputs.get(name.as_ref());
            let text = output.map_or(name.as_ref(), |output| &output.expression);
            outputs.push(parse(format!("outputs.{name}"), text)?);
        }
        if let Some(unit) = self.time_unit.filter(|unit| *unit != TimeUnit::S) {
            let per_second = graph.constant(1.0 / unit.seconds());
            derivatives.iter_mut().for_each(|value| *value = graph.mul(*value, per_second));
        }
        let mut all = PlantGraph {
            graph,
            states: self.states.clone(),
            inputs: self.inputs.clone(),
            parameters: varying.iter().map(|&name| variable(name, "")).collect(),
            output_variables,
            derivatives,
            outputs,
            algebraic,
            names,
            keys,
        };
        if let Some((cost, texts)) = cost {
            all.add_cost(cost, texts, scope, self.time_unit.unwrap_or(TimeUnit::S))?;
        }
        Ok(all)
    }
}

fn variable(name: &str, unit: &str) -> Variable {
    Variable { name: name.to_owned().into(), unit: unit.to_owned().into() }
}
