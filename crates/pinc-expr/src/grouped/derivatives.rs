//! The Jacobian of a graph's values, by forward differentiation: of each value the derivatives that
//! are not zero everywhere, and their derivatives in turn. They follow the rules and conventions of
//! [`pinc_ad::Dual`].

use super::dag::{Dag, DagNode, Id, Op};
use super::linear::Linear;
use crate::graph::{Function, Graph, Number, Operation, Value};
use std::collections::HashMap;
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
    /// For each value, the variables on which it depends, with the derivatives by them.
    pub(super) rows: Vec<Vec<(usize, Id)>>,
    /// What is known of the nodes from which the derivatives were made.
    known: Vec<Derivative>,
}

/// The values of `results` with their derivatives; `seeds` has the derivatives of each variable, in
/// ascending order.
pub(super) fn differentiate(
    graph: &Graph,
    results: &[Value],
    seeds: &dyn Fn(usize) -> Vec<(usize, Seed)>,
) -> Linearized {
    let (mut dag, ids) = Dag::of(graph);
    // A comparison may stand for the larger of two values. Of two equal ones the second counts.
    let mut extremes: HashMap<Id, (Operation, [Id; 2])> = HashMap::new();
    for (node, &id) in graph.nodes.iter().zip(&ids) {
        if let (Operation::Min | Operation::Max, [Some(a), Some(b), _]) =
            (node.operation, node.operands)
        {
            extremes.insert(id, (node.operation, [ids[a.0], ids[b.0]]));
        }
    }
    let mut known: Vec<Derivative> = Vec::with_capacity(dag.nodes.len());
    for id in 0..dag.nodes.len() {
        let derivative = match extremes.get(&id) {
            Some((operation, [a, b])) => {
                let test = match operation {
                    Operation::Min => dag.sub(*b, *a),
                    _ => dag.sub(*a, *b),
                };
                let (da, db) = (known[*a].clone(), &known[*b]);
                db.choose(test, &da, &mut dag)
            }
            None => derivative(id, &known, seeds, &mut dag),
        };
        known.push(derivative);
    }
    let values: Vec<Id> = results.iter().map(|result| ids[result.0]).collect();
    let rows = values.iter().map(|&id| to_values(&known[id], &mut dag)).collect();
    Linearized { dag, values, rows, known }
}

/// The derivatives of the derivatives in `rows`: of each of these, in the order of the rows, the
/// variables on which it depends with its derivatives by them. `seeds` as in [`differentiate`].
pub(super) fn differentiate_again(
    linearized: &mut Linearized,
    seeds: &dyn Fn(usize) -> Vec<(usize, Seed)>,
) -> Vec<Vec<(usize, Id)>> {
    let Linearized { dag, rows, known, .. } = linearized;
    let entries: Vec<Id> = rows.iter().flatten().map(|(_, id)| *id).collect();
    let mut needed = vec![false; dag.nodes.len()];
    entries.iter().for_each(|&id| needed[id] = true);
    for id in (0..needed.len()).rev() {
        if needed[id] {
            dag.nodes[id].operands().iter().for_each(|&operand| needed[operand] = true);
        }
    }
    for (id, needed) in needed.into_iter().enumerate().skip(known.len()) {
        let derivative =
            if needed { derivative(id, known, seeds, dag) } else { Derivative::default() };
        known.push(derivative);
    }
    entries.into_iter().map(|id| to_values(&known[id], dag)).collect()
}

/// The variables with the derivatives by them as values.
fn to_values(derivative: &Derivative, dag: &mut Dag) -> Vec<(usize, Id)> {
    let entries = derivative.expanded(dag);
    entries.into_iter().map(|(v, entry)| (v, entry.to_value(dag))).collect()
}

/// The derivatives of a node, of whose operands they are `known`.
fn derivative(
    id: Id,
    known: &[Derivative],
    seeds: &dyn Fn(usize) -> Vec<(usize, Seed)>,
    dag: &mut Dag,
) -> Derivative {
    let DagNode { op, operands: [a, b, c] } = dag.nodes[id];
    match op {
        Op::Variable(index) => Derivative::of_variable(seeds(index), dag),
        Op::Constant(_) => Derivative::default(),
        Op::Add => known[a].plus(&known[b], dag),
        Op::Sub => known[a].plus(&negative(&known[b], dag), dag),
        Op::Mul => product(known, [a, b], dag),
        Op::MulAdd => product(known, [a, b], dag).plus(&known[c], dag),
        Op::MulSub => product(known, [a, b], dag).plus(&negative(&known[c], dag), dag),
        Op::NegMulAdd => negative(&product(known, [a, b], dag), dag).plus(&known[c], dag),
        Op::Div if known[a].is_zero() => {
            let quotient = dag.div(id, b);
            let slope = Linear::value(dag, quotient).scale(-1.0);
            known[b].times(&slope, dag)
        }
        Op::Div => {
            let one = dag.constant(1.0);
            let inverse = dag.div(one, b);
            let inverse = Linear::value(dag, inverse);
            let quotient = Linear::value(dag, id).times(&inverse, dag).scale(-1.0);
            let (da, db) = (known[a].times(&inverse, dag), known[b].times(&quotient, dag));
            da.plus(&db, dag)
        }
        // If both arguments are equal, the second counts.
        Op::Min => {
            let test = dag.sub(b, a);
            known[b].choose(test, &known[a], dag)
        }
        Op::Max => {
            let test = dag.sub(a, b);
            known[b].choose(test, &known[a], dag)
        }
        Op::Where => known[b].choose(a, &known[c], dag),
        Op::Neg => negative(&known[a], dag),
        // -1/(2 a^2), and 0 where that is infinite.
        Op::RootSlope => {
            let square = dag.mul(id, id);
            let slope = Linear::value(dag, square).scale(-2.0);
            known[a].times(&slope, dag)
        }
        Op::Power(number) => {
            let slope = dag.power_slope(a, number);
            let slope = Linear::value(dag, slope);
            known[a].times(&slope, dag)
        }
        Op::PowerSlope(number) => {
            let slope = dag.power_slope(a, Number::new(number.value() - 1.0));
            let slope = Linear::value(dag, slope).scale(number.value());
            known[a].times(&slope, dag)
        }
        Op::Function(function) => {
            let slope = slope(function, a, id, dag);
            known[a].times(&slope, dag)
        }
        // They are made of functions later.
        Op::SineCosine => Derivative::default(),
    }
}

fn negative(derivative: &Derivative, dag: &mut Dag) -> Derivative {
    derivative.times(&Linear::constant(-1.0), dag)
}

/// The derivatives of a b.
fn product(known: &[Derivative], [a, b]: [Id; 2], dag: &mut Dag) -> Derivative {
    let (by_a, by_b) = (Linear::value(dag, b), Linear::value(dag, a));
    let (da, db) = (known[a].times(&by_a, dag), known[b].times(&by_b, dag));
    da.plus(&db, dag)
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
