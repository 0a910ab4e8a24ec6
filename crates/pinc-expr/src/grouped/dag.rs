//! Values with up to three operands, each once, from which functions and their Jacobians are
//! computed.

use crate::graph::{Function, Graph, Number, Operation};
use std::collections::HashMap;

/// How a value comes from up to three others, a, b and c.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Op {
    /// State, input or parameter, counted together in this order.
    Variable(usize),
    Constant(Number),
    Add,
    Sub,
    Mul,
    Div,
    /// a b + c
    MulAdd,
    /// a b - c
    MulSub,
    /// c - a b
    NegMulAdd,
    Neg,
    Min,
    Max,
    /// b where a <= 0, else c
    Where,
    Function(Function),
    /// The sine, and beside it the cosine: see [`super::schedule`].
    SineCosine,
    /// The derivative of the root, by the root: 1/(2 a), and 0 where that is infinite.
    RootSlope,
    /// a^number
    Power(Number),
    /// The derivative of that.
    PowerSlope(Number),
}

impl Op {
    pub(super) fn arity(self) -> usize {
        match self {
            Self::Variable(_) | Self::Constant(_) => 0,
            Self::Neg
            | Self::Function(_)
            | Self::SineCosine
            | Self::RootSlope
            | Self::Power(_)
            | Self::PowerSlope(_) => 1,
            Self::Add | Self::Sub | Self::Mul | Self::Div | Self::Min | Self::Max => 2,
            Self::MulAdd | Self::MulSub | Self::NegMulAdd | Self::Where => 3,
        }
    }
}

/// The place of a node.
pub(super) type Id = usize;

/// A value's operation and operands, of which the first [`Op::arity`] count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) struct DagNode {
    pub(super) op: Op,
    pub(super) operands: [Id; 3],
}

impl DagNode {
    pub(super) fn operands(&self) -> &[Id] {
        &self.operands[..self.op.arity()]
    }
}

/// All values; operands come before what is made of them.
#[derive(Debug, Default)]
pub(super) struct Dag {
    pub(super) nodes: Vec<DagNode>,
    known: HashMap<DagNode, Id>,
}

impl Dag {
    fn node<const N: usize>(&mut self, op: Op, operands: [Id; N]) -> Id {
        let mut all = [0; 3];
        all[..N].copy_from_slice(&operands);
        let node = DagNode { op, operands: all };
        *self.known.entry(node).or_insert_with(|| {
            self.nodes.push(node);
            self.nodes.len() - 1
        })
    }

    pub(super) fn variable(&mut self, index: usize) -> Id {
        self.node(Op::Variable(index), [])
    }

    pub(super) fn constant(&mut self, value: f64) -> Id {
        self.node(Op::Constant(Number::new(value)), [])
    }

    /// The number that a node stands for, if it does.
    pub(super) fn number(&self, a: Id) -> Option<f64> {
        match self.nodes[a].op {
            Op::Constant(number) => Some(number.value()),
            _ => None,
        }
    }

    pub(super) fn add(&mut self, a: Id, b: Id) -> Id {
        match (self.number(a), self.number(b)) {
            (Some(a), Some(b)) => self.constant(a + b),
            (Some(0.0), None) => b,
            (None, Some(0.0)) => a,
            _ => self.node(Op::Add, [a.min(b), a.max(b)]),
        }
    }

    pub(super) fn sub(&mut self, a: Id, b: Id) -> Id {
        match (self.number(a), self.number(b)) {
            (Some(a), Some(b)) => self.constant(a - b),
            (Some(0.0), None) => self.neg(b),
            (None, Some(0.0)) => a,
            _ => self.node(Op::Sub, [a, b]),
        }
    }

    pub(super) fn mul(&mut self, a: Id, b: Id) -> Id {
        match (self.number(a), self.number(b)) {
            (Some(a), Some(b)) => self.constant(a * b),
            (Some(1.0), None) => b,
            (None, Some(1.0)) => a,
            _ => self.node(Op::Mul, [a.min(b), a.max(b)]),
        }
    }

    /// a b + c
    pub(super) fn mul_add(&mut self, a: Id, b: Id, c: Id) -> Id {
        self.node(Op::MulAdd, [a.min(b), a.max(b), c])
    }

    pub(super) fn div(&mut self, a: Id, b: Id) -> Id {
        match (self.number(a), self.number(b)) {
            (Some(a), Some(b)) => self.constant(a / b),
            // A division takes as long as ten multiplications. The quotient differs by rounding.
            (None, Some(number)) if (1.0 / number).is_normal() => {
                let inverse = self.constant(1.0 / number);
                self.mul(a, inverse)
            }
            _ => self.node(Op::Div, [a, b]),
        }
    }

    pub(super) fn neg(&mut self, a: Id) -> Id {
        match self.number(a) {
            Some(a) => self.constant(-a),
            None => self.node(Op::Neg, [a]),
        }
    }

    pub(super) fn function(&mut self, function: Function, a: Id) -> Id {
        match self.number(a) {
            Some(a) => self.constant(function.of(a)),
            None => self.node(Op::Function(function), [a]),
        }
    }

    pub(super) fn root_slope(&mut self, root: Id) -> Id {
        self.node(Op::RootSlope, [root])
    }

    pub(super) fn power_slope(&mut self, a: Id, p: Number) -> Id {
        self.node(Op::PowerSlope(p), [a])
    }

    /// `yes` where `test <= 0`, else `no`.
    pub(super) fn choose(&mut self, test: Id, yes: Id, no: Id) -> Id {
        if yes == no { yes } else { self.node(Op::Where, [test, yes, no]) }
    }

    /// The larger of two values, as [`pinc_ad::Scalar::max`]. Beside a number that is not infinite
    /// a comparison suffices: where it does not hold the other value is taken, NaN too. Where both are
    /// equal the derivative is that of the second, so a number in front makes another node.
    fn maximum(&mut self, a: Id, b: Id) -> Id {
        match self.beside_a_number(a, b) {
            Some([value, number]) => {
                let one = self.constant(1.0);
                let test = match number == b {
                    true => self.sub(value, number),
                    false => self.node(Op::MulSub, [one, value, number]),
                };
                self.choose(test, number, value)
            }
            None => self.node(Op::Max, [a, b]),
        }
    }

    /// The smaller of two values, as [`pinc_ad::Scalar::min`].
    fn minimum(&mut self, a: Id, b: Id) -> Id {
        match self.beside_a_number(a, b) {
            Some([value, number]) => {
                let one = self.constant(1.0);
                let test = match number == b {
                    true => self.sub(number, value),
                    false => self.node(Op::NegMulAdd, [one, value, number]),
                };
                self.choose(test, number, value)
            }
            None => self.node(Op::Min, [a, b]),
        }
    }

    /// The two with the number last, if one is a number that is not infinite.
    fn beside_a_number(&self, a: Id, b: Id) -> Option<[Id; 2]> {
        let is_number = |id: Id| self.number(id).is_some_and(f64::is_finite);
        match (is_number(a), is_number(b)) {
            (false, true) => Some([a, b]),
            (true, false) => Some([b, a]),
            _ => None,
        }
    }

    /// The values of a graph, one for each of its nodes: the same operations in the same order.
    pub(super) fn of(graph: &Graph) -> (Self, Vec<Id>) {
        let mut dag = Self::default();
        let mut ids: Vec<Id> = Vec::with_capacity(graph.nodes.len());
        for node in &graph.nodes {
            let operands = node.operands.map(|operand| operand.map_or(0, |value| ids[value.0]));
            ids.push(dag.same(node.operation, operands));
        }
        (dag, ids)
    }

    fn same(&mut self, operation: Operation, [a, b, c]: [Id; 3]) -> Id {
        match operation {
            Operation::Variable(index) => self.variable(index),
            Operation::Constant(number) => self.constant(number.value()),
            Operation::Add => self.add(a, b),
            Operation::Sub => self.sub(a, b),
            Operation::Mul => self.mul(a, b),
            Operation::Div => self.div(a, b),
            Operation::Min => self.minimum(a, b),
            Operation::Max => self.maximum(a, b),
            Operation::Where => self.choose(a, b, c),
            Operation::Neg => self.neg(a),
            Operation::AddNumber(number) => {
                let number = self.constant(number.value());
                self.add(a, number)
            }
            Operation::SubFrom(number) => {
                let number = self.constant(number.value());
                self.sub(number, a)
            }
            Operation::MulNumber(number) => {
                let number = self.constant(number.value());
                self.mul(a, number)
            }
            Operation::DivInto(number) => {
                let number = self.constant(number.value());
                self.div(number, a)
            }
            Operation::Power(number) => self.node(Op::Power(number), [a]),
            Operation::Function(function) => self.function(function, a),
        }
    }
}
