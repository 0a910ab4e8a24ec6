//! A plant's equations as a graph, however they were written.

use crate::algebraic::Algebraic;
use crate::cost::{ADDED, CostExpressions};
use crate::critical::CriticalTerms;
use crate::error::{ExpressionError, ExpressionProblem};
use crate::graph::{Graph, Value};
use crate::grouped::GroupedFunction;
use crate::implicit::AlgebraicSystem;
use crate::listing::Listing;
use crate::program::Program;
use crate::traced::{Traced, Tracer};
use crate::{ExpressionPlant, Outputs, Rates, SparseEquations, TimeUnit, variable};
use pinc_ode::{Dims, Plant, SparsePlant, Variable};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Derivatives and outputs as values of a graph, whose variables are states, inputs, parameters
/// that vary and algebraic variables, in this order.
pub(crate) struct PlantGraph {
    pub(crate) graph: Graph,
    pub(crate) states: Vec<Variable>,
    pub(crate) inputs: Vec<Variable>,
    pub(crate) parameters: Vec<Variable>,
    /// The measured outputs; none if they are the states.
    pub(crate) output_variables: Vec<Variable>,
    /// The derivative of each state.
    pub(crate) derivatives: Vec<Value>,
    /// The value of each output.
    pub(crate) outputs: Vec<Value>,
    pub(crate) algebraic: Algebraic,
    /// The intermediate expressions' names.
    pub(crate) names: BTreeMap<Value, String>,
    /// The key of each equation, with the number of nodes after it.
    pub(crate) keys: Vec<(usize, String)>,
}

impl PlantGraph {
    /// The graph of a plant in Rust, in which the constants named in `varying` are parameters behind its
    /// own and the others have the values of `constants`. Equations that it solves inside become
    /// algebraic variables, or, `unrolled`, the steps of their solution. A `cost` is beside them.
    pub(crate) fn traced<P: Plant>(
        plant: &P,
        constants: &BTreeMap<String, f64>,
        varying: &[&str],
        unrolled: bool,
        cost: Option<CostExpressions<'_>>,
    ) -> Result<Self, ExpressionError> {
        let (states, inputs) = (plant.states().to_vec(), plant.inputs().to_vec());
        let mut parameters = plant.parameters().to_vec();
        let own = parameters.len();
        parameters.extend(varying.iter().map(|&name| variable(name, "")));
        let added = if cost.is_some() { ADDED.len() } else { 0 };
        let count = states.len() + added + inputs.len() + parameters.len();
        let tracer = Tracer::new(count, unrolled);
        let variables: Vec<Traced<'_>> = (0..count).map(|i| tracer.variable(i)).collect();
        let (x, rest) = variables.split_at(states.len());
        let (u, p) = rest[added..].split_at(inputs.len());
        let (p, varied) = p.split_at(own);
        let constant = |(name, value): (String, f64)| match varying.iter().position(|v| *v == name)
        {
            Some(place) => varied[place],
            None => tracer.constant(constants.get(&name).copied().unwrap_or(value)),
        };
        let own_constants = plant.constants();
        let numbers: Vec<_> = own_constants.iter().cloned().map(constant).collect();
        let zero = tracer.constant(0.0);
        let values = |traced: Vec<Traced<'_>>| -> Vec<Value> {
            traced.into_iter().map(|traced| traced.value).collect()
        };
        let mut dx = vec![zero; states.len()];
        plant.rhs_with(&numbers, x, u, p, &mut dx);
        let derivatives = values(dx);
        let mut y = vec![zero; plant.outputs().len()];
        plant.output(x, u, p, &mut y);
        let outputs = values(y);
        let are_states = outputs == values(x.to_vec());
        let named =
            states.iter().zip(x).chain(inputs.iter().zip(u)).chain(parameters.iter().zip(p));
        let named: Vec<_> = named.map(|(of, traced)| (of.name.to_string(), traced.value)).collect();
        let constants = own_constants.into_iter().zip(&numbers);
        let named = constants.map(|((name, _), traced)| (name, traced.value)).chain(named);
        let named: Vec<(String, Value)> = named.collect();
        let recording = tracer.finish().map_err(|problem| problem.at(RIGHT_HAND_SIDE))?;
        let nodes = recording.graph.nodes.len();
        let mut traced = Self {
            graph: recording.graph,
            algebraic: recording.algebraic,
            output_variables: if are_states { Vec::new() } else { plant.outputs().to_vec() },
            outputs: if are_states { Vec::new() } else { outputs },
            keys: vec![(nodes, RIGHT_HAND_SIDE.to_owned())],
            names: BTreeMap::new(),
            states,
            inputs,
            parameters,
            derivatives,
        };
        if let Some(cost) = cost {
            let scope = named.iter().map(|(name, value)| (name.as_str(), *value)).collect();
            let texts = cost.texts().map(|(_, text)| text);
            traced.add_cost(cost, texts, scope, TimeUnit::S)?;
        }
        Ok(traced)
    }

    /// Multiplies all derivatives by an input.
    ///
    /// # Panics
    ///
    /// If there is no such input.
    pub(crate) fn stretch_time(&mut self, input: usize) {
        assert!(input < self.inputs.len(), "one of the inputs");
        let factor = self.graph.variable(self.states.len() + input);
        let Self { graph, derivatives, .. } = self;
        derivatives.iter_mut().for_each(|value| *value = graph.mul(*value, factor));
    }

    /// States, inputs and parameters.
    fn variables(&self) -> usize {
        self.states.len() + self.inputs.len() + self.parameters.len()
    }

    /// The equations with their Jacobians.
    pub(crate) fn into_sparse(self) -> Result<SparseEquations, ExpressionError> {
        let variables = self.variables();
        let Self { graph, states, inputs, parameters, derivatives, outputs, algebraic, .. } = self;
        let grouped = |values: &[Value], key: &str| {
            let function = GroupedFunction::new(&graph, variables, &algebraic, values);
            function.map_err(|problem| problem.at(key))
        };
        let ny = if outputs.is_empty() { states.len() } else { outputs.len() };
        let dims = Dims::new(states.len(), inputs.len())
            .with_parameters(parameters.len())
            .with_outputs(ny);
        let plant = SparsePlant {
            dims,
            rhs: grouped(&derivatives, "derivatives")?,
            outputs: match &outputs[..] {
                [] => None,
                values => Some(grouped(values, "outputs")?),
            },
        };
        Ok(SparseEquations {
            plant,
            rates: Arc::new(Rates { graph, algebraic, values: derivatives }),
        })
    }

    pub(crate) fn compile(self) -> Result<ExpressionPlant, ExpressionError> {
        let all = self.variables() + self.algebraic.names.len();
        let program = |values: &[Value], key: &str| {
            Program::new(&self.graph, all, values).map_err(|problem| problem.at(key))
        };
        let rhs = program(&self.derivatives, "derivatives")?;
        let outputs = match &self.outputs[..] {
            [] => None,
            values => {
                let variables = self.output_variables.clone();
                Some(Outputs { variables, program: program(values, "outputs")? })
            }
        };
        let system = AlgebraicSystem::new(&self.graph, self.variables(), &self.algebraic);
        let system = system.map_err(|problem| problem.at("algebraic"))?;
        Ok(ExpressionPlant {
            states: self.states.clone(),
            inputs: self.inputs.clone(),
            parameters: self.parameters.clone(),
            rhs,
            outputs,
            algebraic: (!system.blocks.is_empty()).then_some(system),
            sparse: self.into_sparse()?,
        })
    }

    pub(crate) fn critical_terms(self) -> Result<CriticalTerms, ExpressionError> {
        let system = AlgebraicSystem::new(&self.graph, self.variables(), &self.algebraic);
        let system = system.map_err(|problem| problem.at("algebraic"))?;
        let sizes = [self.states.len(), self.inputs.len()];
        let listed = self.states.iter().chain(&self.inputs).chain(&self.parameters);
        let printed: Vec<&str> = listed
            .map(|variable| &*variable.name)
            .chain(self.algebraic.names.iter().map(String::as_str))
            .collect();
        let terms = CriticalTerms::new(self.graph, &printed, &self.names, &self.keys);
        Ok(terms.with_algebraic(sizes, system))
    }

    /// The derivatives as a list of instructions.
    pub(crate) fn listing(&self) -> Result<Listing, ExpressionError> {
        self.list(&self.derivatives)
    }

    /// The outputs as a list of instructions.
    pub(crate) fn output_listing(&self) -> Result<Listing, ExpressionError> {
        self.list(&self.outputs)
    }

    fn list(&self, values: &[Value]) -> Result<Listing, ExpressionError> {
        if !self.algebraic.names.is_empty() {
            return Err(ExpressionProblem::NotListed.at("algebraic"));
        }
        Ok(Listing::new(&self.graph, values))
    }
}

/// Where errors of a traced equation are.
const RIGHT_HAND_SIDE: &str = "rhs";
