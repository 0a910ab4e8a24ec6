//! The values that equations are computed from, each once: constants are folded, and what is
//! computed twice is one value.

use pinc_ad::Scalar;
use std::collections::HashMap;

/// A number that can be compared and hashed: by its bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Number(u64);

impl Number {
    pub(crate) fn new(value: f64) -> Self {
        Self(value.to_bits())
    }

    #[inline(always)]
    pub(crate) fn value(self) -> f64 {
        f64::from_bits(self.0)
    }
}

/// How a value comes from up to three others, a, b and c.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Operation {
    /// State, input or varying parameter, counted together in this order.
    Variable(usize),
    Constant(Number),
    Add,
    Sub,
    Mul,
    Div,
    Min,
    Max,
    /// b where a <= 0, else c
    Where,
    Neg,
    /// a + number
    AddNumber(Number),
    /// number - a
    SubFrom(Number),
    /// a number
    MulNumber(Number),
    /// number / a
    DivInto(Number),
    /// a^number
    Power(Number),
    Function(Function),
}

impl Operation {
    /// The place of a variable among all.
    pub(crate) fn variable(self) -> Option<usize> {
        if let Self::Variable(place) = self { Some(place) } else { None }
    }
}

/// The functions of one argument that equations may use, as
/// [`Scalar`] defines them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Function {
    /// The square root.
    Sqrt,
    /// e to the power of the argument.
    Exp,
    /// The natural logarithm.
    Log,
    /// The sine.
    Sin,
    /// The cosine.
    Cos,
    /// The tangent.
    Tan,
    /// The hyperbolic tangent.
    Tanh,
    /// The inverse of the tangent.
    Atan,
    /// The absolute value.
    Abs,
    /// The sign: -1, 0 or 1.
    Sign,
}

impl Function {
    pub(crate) const ALL: [(&'static str, Self); 10] = [
        ("sqrt", Self::Sqrt),
        ("exp", Self::Exp),
        ("log", Self::Log),
        ("sin", Self::Sin),
        ("cos", Self::Cos),
        ("tan", Self::Tan),
        ("tanh", Self::Tanh),
        ("atan", Self::Atan),
        ("abs", Self::Abs),
        ("sign", Self::Sign),
    ];

    /// Its value at `a`.
    #[inline(always)]
    pub fn of<S: Scalar>(self, a: S) -> S {
        match self {
            Self::Sqrt => a.sqrt(),
            Self::Exp => a.exp(),
            Self::Log => a.ln(),
            Self::Sin => a.sin(),
            Self::Cos => a.cos(),
            Self::Tan => a.tan(),
            Self::Tanh => a.tanh(),
            Self::Atan => a.atan(),
            Self::Abs => a.abs(),
            Self::Sign => a.sign(),
        }
    }
}

/// A value of the graph: the place of its node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) struct Value(pub(crate) usize);

/// A value's operation and operands; of those that the operation does not have, a value before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Node {
    pub(crate) operation: Operation,
    pub(crate) operands: [Option<Value>; 3],
}

/// The largest whole exponent that is written as multiplications.
const LARGEST_WHOLE_POWER: f64 = 32.0;

/// All values; operands come before what is made of them.
#[derive(Debug, Default)]
pub(crate) struct Graph {
    pub(crate) nodes: Vec<Node>,
    known: HashMap<Node, Value>,
}

impl Graph {
    pub(crate) fn variable(&mut self, index: usize) -> Value {
        self.node(Operation::Variable(index), [None; 3])
    }

    pub(crate) fn constant(&mut self, value: f64) -> Value {
        self.node(Operation::Constant(Number::new(value)), [None; 3])
    }

    fn node(&mut self, operation: Operation, operands: [Option<Value>; 3]) -> Value {
        let node = Node { operation, operands };
        *self.known.entry(node).or_insert_with(|| {
            self.nodes.push(node);
            Value(self.nodes.len() - 1)
        })
    }

    /// Copies `values` of the graph `from`; `unknowns` stand for its variables from `first` on.
    pub(crate) fn copy(
        &mut self,
        from: &Self,
        values: &[Value],
        first: usize,
        unknowns: &[Value],
    ) -> Vec<Value> {
        let needed = from.needed(values);
        let mut places = vec![None; from.nodes.len()];
        for (i, node) in from.nodes.iter().enumerate().filter(|(i, _)| needed[*i]) {
            let operands = node.operands.map(|operand| operand.and_then(|v| places[v.0]));
            places[i] = Some(match node.operation {
                Operation::Variable(index) if index >= first => unknowns[index - first],
                operation => self.node(operation, operands),
            });
        }
        values.iter().filter_map(|value| places[value.0]).collect()
    }

    /// Which nodes some values are made of, they included.
    pub(crate) fn needed(&self, values: &[Value]) -> Vec<bool> {
        let mut needed = vec![false; self.nodes.len()];
        values.iter().for_each(|value| needed[value.0] = true);
        for (i, node) in self.nodes.iter().enumerate().rev() {
            if needed[i] {
                node.operands.iter().flatten().for_each(|operand| needed[operand.0] = true);
            }
        }
        needed
    }

    fn unary(&mut self, operation: Operation, a: Value) -> Value {
        self.node(operation, [Some(a), None, None])
    }

    fn binary(&mut self, operation: Operation, a: Value, b: Value) -> Value {
        self.node(operation, [Some(a), Some(b), None])
    }

    fn number(&self, value: Value) -> Option<f64> {
        match self.nodes[value.0].operation {
            Operation::Constant(number) => Some(number.value()),
            _ => None,
        }
    }

    pub(crate) fn add(&mut self, a: Value, b: Value) -> Value {
        match (self.number(a), self.number(b)) {
            (Some(a), Some(b)) => self.constant(a + b),
            (Some(number), None) => self.add_number(b, number),
            (None, Some(number)) => self.add_number(a, number),
            (None, None) => self.binary(Operation::Add, a.min(b), a.max(b)),
        }
    }

    fn add_number(&mut self, a: Value, number: f64) -> Value {
        if number == 0.0 { a } else { self.unary(Operation::AddNumber(Number::new(number)), a) }
    }

    pub(crate) fn sub(&mut self, a: Value, b: Value) -> Value {
        match (self.number(a), self.number(b)) {
            (Some(a), Some(b)) => self.constant(a - b),
            (Some(number), None) => self.unary(Operation::SubFrom(Number::new(number)), b),
            (None, Some(number)) => self.add_number(a, -number),
            (None, None) => self.binary(Operation::Sub, a, b),
        }
    }

    pub(crate) fn mul(&mut self, a: Value, b: Value) -> Value {
        match (self.number(a), self.number(b)) {
            (Some(a), Some(b)) => self.constant(a * b),
            (Some(number), None) => self.mul_number(b, number),
            (None, Some(number)) => self.mul_number(a, number),
            (None, None) => self.binary(Operation::Mul, a.min(b), a.max(b)),
        }
    }

    fn mul_number(&mut self, a: Value, number: f64) -> Value {
        if number.to_bits() == 1.0_f64.to_bits() {
            a
        } else {
            self.unary(Operation::MulNumber(Number::new(number)), a)
        }
    }

    pub(crate) fn div(&mut self, a: Value, b: Value) -> Value {
        match (self.number(a), self.number(b)) {
            (Some(a), Some(b)) => self.constant(a / b),
            (Some(number), None) => self.unary(Operation::DivInto(Number::new(number)), b),
            // A division takes as long as ten multiplications. The quotient differs by rounding.
            (None, Some(number)) if (1.0 / number).is_normal() => self.mul_number(a, 1.0 / number),
            _ => self.binary(Operation::Div, a, b),
        }
    }

    /// a / b, where b stays a divisor if it is a number: rounded as the division is.
    pub(crate) fn quotient(&mut self, a: Value, b: Value) -> Value {
        match (self.number(a), self.number(b)) {
            (None, Some(_)) => self.binary(Operation::Div, a, b),
            _ => self.div(a, b),
        }
    }

    pub(crate) fn neg(&mut self, a: Value) -> Value {
        match self.number(a) {
            Some(a) => self.constant(-a),
            None => self.unary(Operation::Neg, a),
        }
    }

    pub(crate) fn function(&mut self, function: Function, a: Value) -> Value {
        match self.number(a) {
            Some(a) => self.constant(function.of(a)),
            None => self.unary(Operation::Function(function), a),
        }
    }

    pub(crate) fn minimum(&mut self, a: Value, b: Value) -> Value {
        match (self.number(a), self.number(b)) {
            (Some(a), Some(b)) => self.constant(Scalar::min(a, b)),
            _ => self.binary(Operation::Min, a, b),
        }
    }

    pub(crate) fn maximum(&mut self, a: Value, b: Value) -> Value {
        match (self.number(a), self.number(b)) {
            (Some(a), Some(b)) => self.constant(Scalar::max(a, b)),
            _ => self.binary(Operation::Max, a, b),
        }
    }

    /// `yes` where `test <= 0`, else `no`.
    pub(crate) fn choose(&mut self, test: Value, yes: Value, no: Value) -> Value {
        match self.number(test) {
            Some(test) if test <= 0.0 => yes,
            Some(_) => no,
            None if yes == no => yes,
            None => self.node(Operation::Where, [Some(test), Some(yes), Some(no)]),
        }
    }

    /// `a^p`, as [`Scalar::powf`] computes it.
    pub(crate) fn powf(&mut self, a: Value, p: f64) -> Value {
        match self.number(a) {
            Some(a) => self.constant(Scalar::powf(a, p)),
            None => self.unary(Operation::Power(Number::new(p)), a),
        }
    }

    /// `a^b`: by multiplications where b is whole, else for a of 0 or more, where b varies as
    /// e^(b log a).
    pub(crate) fn power(&mut self, a: Value, b: Value) -> Value {
        match (self.number(a), self.number(b)) {
            (Some(a), Some(b)) => self.constant(a.powf(b)),
            (None, Some(p)) if p.fract() == 0.0 && p.abs() <= LARGEST_WHOLE_POWER => {
                self.whole_power(a, p)
            }
            (None, Some(0.5)) => self.function(Function::Sqrt, a),
            (None, Some(p)) => self.unary(Operation::Power(Number::new(p)), a),
            (_, None) => self.varying_power(a, b),
        }
    }

    /// e^(b log a) for positive a. At 0, where log has no slope, it is 0 with the slope 0 for positive b
    /// and infinite for others, as the square root and 1 divided by it; below 0 no number, as these.
    fn varying_power(&mut self, a: Value, b: Value) -> Value {
        let one = self.constant(1.0);
        let positive = self.choose(a, one, a);
        let logarithm = self.function(Function::Log, positive);
        let exponent = self.mul(b, logarithm);
        let power = self.function(Function::Exp, exponent);
        let root = self.function(Function::Sqrt, a);
        let inverse = self.div(one, root);
        let at_zero = self.choose(b, inverse, root);
        self.choose(a, at_zero, power)
    }

    fn whole_power(&mut self, a: Value, p: f64) -> Value {
        let mut rest = p.abs();
        let mut square = a;
        let mut power = None;
        while rest > 0.0 {
            if rest % 2.0 > 0.5 {
                power = Some(power.map_or(square, |power| self.mul(power, square)));
            }
            rest = (rest / 2.0).floor();
            if rest > 0.0 {
                square = self.mul(square, square);
            }
        }
        let one = self.constant(1.0);
        match power {
            None => one,
            Some(power) if p < 0.0 => self.div(one, power),
            Some(power) => power,
        }
    }
}
