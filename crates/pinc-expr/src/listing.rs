//! Equations as a list of instructions, for programs that write code from them.

use crate::Equations;
use crate::error::ExpressionError;
use crate::graph::{Function, Graph, Node, Operation, Value};

/// One value of a [`Listing`], made of values before it, which are named by their places.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Instruction {
    /// A state, an input or a varying parameter, counted together in this order.
    Variable(usize),
    /// A number.
    Constant(f64),
    /// a + b
    Add(usize, usize),
    /// a - b
    Sub(usize, usize),
    /// a b
    Mul(usize, usize),
    /// a / b
    Div(usize, usize),
    /// The smaller of a and b; of two equal ones, b.
    Min(usize, usize),
    /// The larger of a and b; of two equal ones, b.
    Max(usize, usize),
    /// b where a <= 0, else c.
    Where(usize, usize, usize),
    /// -a
    Neg(usize),
    /// a to the power of a number.
    Power(usize, f64),
    /// A function of a.
    Function(Function, usize),
}

impl Instruction {
    /// The places of the values that this one is made of.
    pub fn operands(self) -> impl Iterator<Item = usize> {
        let [a, b, c] = match self {
            Self::Variable(_) | Self::Constant(_) => [None; 3],
            Self::Neg(a) | Self::Power(a, _) | Self::Function(_, a) => [Some(a), None, None],
            Self::Add(a, b)
            | Self::Sub(a, b)
            | Self::Mul(a, b)
            | Self::Div(a, b)
            | Self::Min(a, b)
            | Self::Max(a, b) => [Some(a), Some(b), None],
            Self::Where(a, b, c) => [Some(a), Some(b), Some(c)],
        };
        [a, b, c].into_iter().flatten()
    }
}

/// The time derivatives of the states, or the outputs, as a list of instructions: constants are
/// folded, no value is computed twice, and none is computed that is not needed.
#[derive(Clone, Debug, PartialEq)]
pub struct Listing {
    /// The values.
    pub instructions: Vec<Instruction>,
    /// The place of each result.
    pub results: Vec<usize>,
}

impl Equations {
    /// The right-hand side as a list of instructions, all parameters fixed but those named in
    /// `varying`, which are variables after states and inputs.
    ///
    /// # Errors
    ///
    /// The first thing that is wrong with the equations, or that some are algebraic.
    pub fn listing(&self, varying: &[&str]) -> Result<Listing, ExpressionError> {
        self.unrolled(|plain| plain.graph(varying)?.listing())
    }

    /// The outputs as instructions, in the order of their names.
    ///
    /// # Errors
    ///
    /// As [`Equations::listing`].
    pub fn output_listing(&self, varying: &[&str]) -> Result<Listing, ExpressionError> {
        self.unrolled(|plain| plain.graph(varying)?.output_listing())
    }
}

impl Listing {
    pub(crate) fn new(graph: &Graph, results: &[Value]) -> Self {
        let needed = graph.needed(results);
        let mut listing = Self { instructions: Vec::new(), results: Vec::new() };
        let mut places = vec![0; graph.nodes.len()];
        for (i, node) in graph.nodes.iter().enumerate().filter(|(i, _)| needed[*i]) {
            places[i] = listing.push(node, &places);
        }
        listing.results = results.iter().map(|result| places[result.0]).collect();
        listing
    }

    /// Appends a node, and the number in it if there is one; gives its place.
    fn push(&mut self, node: &Node, places: &[usize]) -> usize {
        let [a, b, c] = node.operands.map(|operand| operand.map_or(0, |value| places[value.0]));
        let mut constant = |value: f64| {
            self.instructions.push(Instruction::Constant(value));
            self.instructions.len() - 1
        };
        let instruction = match node.operation {
            Operation::Variable(index) => Instruction::Variable(index),
            Operation::Constant(number) => Instruction::Constant(number.value()),
            Operation::Add => Instruction::Add(a, b),
            Operation::Sub => Instruction::Sub(a, b),
            Operation::Mul => Instruction::Mul(a, b),
            Operation::Div => Instruction::Div(a, b),
            Operation::Min => Instruction::Min(a, b),
            Operation::Max => Instruction::Max(a, b),
            Operation::Where => Instruction::Where(a, b, c),
            Operation::Neg => Instruction::Neg(a),
            Operation::AddNumber(number) => Instruction::Add(a, constant(number.value())),
            Operation::SubFrom(number) => Instruction::Sub(constant(number.value()), a),
            Operation::MulNumber(number) => Instruction::Mul(a, constant(number.value())),
            Operation::DivInto(number) => Instruction::Div(constant(number.value()), a),
            Operation::Power(number) => Instruction::Power(a, number.value()),
            Operation::Function(function) => Instruction::Function(function, a),
        };
        self.instructions.push(instruction);
        self.instructions.len() - 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_needed_is_listed_and_numbers_have_places() {
        let equations: Equations = serde_json::from_str(
            r#"{"states": [{"name": "x"}], "inputs": [{"name": "u"}],
                "let": {"unused": "sin(x)", "a": "3 - x"},
                "derivatives": {"x": "a*a + exp(u)"}}"#,
        )
        .unwrap();
        let listing = equations.listing(&[]).unwrap();
        let expected = [
            Instruction::Variable(0),
            Instruction::Variable(1),
            Instruction::Constant(3.0),
            Instruction::Sub(2, 0),
            Instruction::Mul(3, 3),
            Instruction::Function(Function::Exp, 1),
            Instruction::Add(4, 5),
        ];
        assert_eq!(listing.instructions, expected);
        assert_eq!(listing.results, [6]);
        let mut equations = equations;
        equations.parameters.insert("k".to_owned(), 2.0);
        equations.derivatives.insert("x".to_owned(), "k*x".to_owned());
        let of = |listing: Listing| listing.instructions;
        let two = [Instruction::Variable(0), Instruction::Constant(2.0), Instruction::Mul(0, 1)];
        assert_eq!(of(equations.listing(&[]).unwrap()), two);
        let free = [Instruction::Variable(0), Instruction::Variable(2), Instruction::Mul(0, 1)];
        assert_eq!(of(equations.listing(&["k"]).unwrap()), free);
    }
}
