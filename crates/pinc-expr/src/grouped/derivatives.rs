//! The Jacobian of a graph's values, by forward differentiation of the graph: of each value the
//! derivatives that are not zero everywhere. They follow the rules and conventions of
//! [`pinc_ad::Dual`].

use super::dag::{Dag, Id};
use super::linear::Linear;
use crate::graph::{Function, Graph, Operation, Value};
use std::rc::Rc;

/// The derivative of a variable of the graph by one of the variables that derivatives are taken by.
#[derive(Clone, Copy, Debug)]
pub(super) enum Seed {
    /// It is this variable.
    One,
    /// It depends on it, and the derivative is in this register.
    Register(usize),
}

/// Derivatives by variables, in ascending order of these.
type Entries = Vec<(usize, Linear)>;

/// The derivatives of a value: `factor` times `entries`, or these alone. A chain of functions of
/// one argument then takes one product a link, however many variables there are.
#[derive(Clone, Debug, Default)]
struct Derivative {
    factor: Option<Linear>,
    entries: Rc<Entries>,
}

impl Derivative {
    fn of_variable(seeds: Vec<(usize, Seed)>, dag: &mut Dag) -> Self {
        let entry = |(variable, seed)| {
            let entry = match seed {
                Seed::One => Linear::constant(1.0),
                Seed::Register(register) => {
                    let value = dag.variable(register);
                    Linear::value(dag, value)
                }
            };
            (variable, entry)
        };
        Self::new(seeds.into_iter().map(entry).collect())
    }

    fn new(entries: Entries) -> Self {
        Self { factor: None, entries: Rc::new(entries) }
    }

    fn is_zero(&self) -> bool {
        self.entries.is_empty()
    }

    fn times(&self, slope: &Linear, dag: &mut Dag) -> Self {
        if self.is_zero() || slope.is_zero() {
            return Self::default();
        }
        if let [(variable, entry)] = &self.entries[..] {
            let entry = match &self.factor {
                Some(factor) => factor.times(entry, dag),
                None => entry.clone(),
            };
            let product = slope.times(&entry, dag).shortened(dag);
            return Self::new(vec![(*variable, product)]);
        }
        let factor = match &self.factor {
            Some(factor) => slope.times(factor, dag).shortened(dag),
            None => slope.clone(),
        };
        Self { factor: Some(factor), entries: Rc::clone(&self.entries) }
    }

    /// Each derivative by itself.
    fn expanded(&self, dag: &mut Dag) -> Entries {
        let Some(factor) = &self.factor else { return (*self.entries).clone() };
        self.entries.iter().map(|(v, entry)| (*v, factor.times(entry, dag))).collect()
    }

    fn plus(&self, other: &Self, dag: &mut Dag) -> Self {
        if self.is_zero() {
            return other.clone();
        }
        if other.is_zero() {
            return self.clone();
        }
        if Rc::ptr_eq(&self.entries, &other.entries) {
            let one = Linear::constant(1.0);
            let [a, b] = [self, other].map(|d| d.factor.as_ref().unwrap_or(&one));
            let factor = a.add(b).shortened(dag);
            if factor.is_zero() {
                return Self::default();
            }
            return Self { factor: Some(factor), entries: Rc::clone(&self.entries) };
        }
        let (a, b) = (self.expanded(dag), other.expanded(dag));
        Self::merge(&a, &b, dag, |a, b, dag| a.add(b).shortened(dag))
    }

    /// `self` where `test <= 0`, else `other`.
    fn choose(&self, test: Id, other: &Self, dag: &mut Dag) -> Self {
        let (a, b) = (self.expanded(dag), other.expanded(dag));
        Self::merge(&a, &b, dag, |a, b, dag| a.choose(test, b, dag))
    }

    fn merge(
        a: &Entries,
        b: &Entries,
        dag: &mut Dag,
        by: impl Fn(&Linear, &Linear, &mut Dag) -> Linear,
    ) -> Self {
        let zero = Linear::default();
        let mut variables: Vec<_> = a.iter().chain(b).map(|(variable, _)| *variable).collect();
        variables.sort_unstable();
        variables.dedup();
        let mut entries = Vec::with_capacity(variables.len());
        for variable in variables {
            let [a, b] = [a, b].map(|side| {
                let place = side.binary_search_by_key(&variable, |(v, _)| *v);
                place.map_or(&zero, |place| &side[place].1)
            });
            let entry = by(a, b, dag);
            if !entry.is_zero() {
                entries.push((variable, entry));
            }
        }
        Self::new(entries)
    }
}

/// Values with their derivatives.
#[derive(Debug)]
pub(super) struct Linearized {
    pub(super) dag: Dag,
    /// The values.
    pub(super) values: Vec<Id>,
    /// Of each value, the variables on which it depends with the derivatives by them.
    pub(super) rows: Vec<Vec<(usize, Id)>>,
}

/// The values of `results` with their derivatives; `seeds` has those of each variable, in
/// ascending order.
pub(super) fn differentiate(
    graph: &Graph,
    results: &[Value],
    seeds: &dyn Fn(usize) -> Vec<(usize, Seed)>,
) -> Linearized {
    let (mut dag, ids) = Dag::of(graph);
    let mut derivatives: Vec<Derivative> = Vec::with_capacity(graph.nodes.len());
    for (node, &id) in graph.nodes.iter().zip(&ids) {
        let [a, b] = node.operands.map(|operand| {
            operand.map_or((0, Derivative::default()), |value| {
                (ids[value.0], derivatives[value.0].clone())
            })
        });
        derivatives.push(match node.operation {
            Operation::Variable(index) => Derivative::of_variable(seeds(index), &mut dag),
            operation => derivative(operation, id, a, b, &mut dag),
        });
    }
    let rows = results
        .iter()
        .map(|result| {
            let entries = derivatives[result.0].expanded(&mut dag);
            entries.into_iter().map(|(v, entry)| (v, entry.to_value(&mut dag))).collect()
        })
        .collect();
    Linearized { dag, values: results.iter().map(|result| ids[result.0]).collect(), rows }
}

/// The derivatives of a value `id` that is made of the values a and b with theirs.
fn derivative(
    operation: Operation,
    id: Id,
    (a, da): (Id, Derivative),
    (b, db): (Id, Derivative),
    dag: &mut Dag,
) -> Derivative {
    match operation {
        // Those of variables are given.
        Operation::Variable(_) | Operation::Constant(_) => Derivative::default(),
        Operation::Add => da.plus(&db, dag),
        Operation::Sub => {
            let minus = db.times(&Linear::constant(-1.0), dag);
            da.plus(&minus, dag)
        }
        Operation::Mul => {
            let (by_a, by_b) = (Linear::value(dag, b), Linear::value(dag, a));
            let (da, db) = (da.times(&by_a, dag), db.times(&by_b, dag));
            da.plus(&db, dag)
        }
        Operation::Div => {
            let one = dag.constant(1.0);
            let inverse = dag.div(one, b);
            let inverse = Linear::value(dag, inverse);
            let quotient = Linear::value(dag, id).times(&inverse, dag).scale(-1.0);
            let (da, db) = (da.times(&inverse, dag), db.times(&quotient, dag));
            da.plus(&db, dag)
        }
        // Of two equal arguments the second counts.
        Operation::Min => {
            let test = dag.sub(b, a);
            db.choose(test, &da, dag)
        }
        Operation::Max => {
            let test = dag.sub(a, b);
            db.choose(test, &da, dag)
        }
        Operation::AddNumber(_) => da,
        Operation::Neg | Operation::SubFrom(_) => da.times(&Linear::constant(-1.0), dag),
        Operation::MulNumber(number) => da.times(&Linear::constant(number.value()), dag),
        Operation::DivInto(_) => {
            let quotient = dag.div(id, a);
            let slope = Linear::value(dag, quotient).scale(-1.0);
            da.times(&slope, dag)
        }
        Operation::Power(number) => {
            let slope = dag.power_slope(a, number);
            let slope = Linear::value(dag, slope);
            da.times(&slope, dag)
        }
        Operation::Function(function) => {
            let slope = slope(function, a, id, dag);
            da.times(&slope, dag)
        }
    }
}

/// The derivative of `y = function(a)` by a.
fn slope(function: Function, a: Id, y: Id, dag: &mut Dag) -> Linear {
    let one = dag.constant(1.0);
    let slope = match function {
        Function::Sqrt => dag.root_slope(y),
        Function::Exp => y,
        Function::Log => dag.div(one, a),
        Function::Sin => dag.function(Function::Cos, a),
        Function::Cos => {
            let sine = dag.function(Function::Sin, a);
            return Linear::value(dag, sine).scale(-1.0);
        }
        Function::Tan => dag.mul_add(y, y, one),
        Function::Tanh => {
            let square = dag.mul(y, y);
            dag.sub(one, square)
        }
        Function::Atan => {
            let square = dag.mul_add(a, a, one);
            dag.div(one, square)
        }
        Function::Abs => dag.function(Function::Sign, a),
        Function::Sign => dag.constant(0.0),
    };
    Linear::value(dag, slope)
}
