//! Reverse-mode derivatives: record the operations, then sweep back over them once.

use crate::Scalar;
use std::cell::RefCell;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// Index of a value that no input influences; it is not recorded on the tape.
const CONSTANT: usize = usize::MAX;

/// One recorded operation: up to two operands and the derivative with respect to each.
#[derive(Clone, Copy, Debug)]
struct Node {
    operands: [usize; 2],
    partials: [f64; 2],
}

/// The record of a computation over [`Var`]s.
///
/// Memory grows by one node (32 bytes) an operation. [`Tape::clear`] keeps the memory for reuse.
#[derive(Debug, Default)]
pub struct Tape {
    nodes: RefCell<Vec<Node>>,
}

impl Tape {
    /// An empty tape.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// A new input with this value.
    pub fn variable(&self, value: f64) -> Var<'_> {
        self.record(value, [CONSTANT; 2], [0.0; 2])
    }

    /// Forgets all operations; the borrow checker ensures that no [`Var`] is left.
    pub fn clear(&mut self) {
        self.nodes.get_mut().clear();
    }

    /// The derivatives of `output` with respect to each of `inputs`, in their order: one backward
    /// sweep over the tape, whatever the number of inputs.
    ///
    /// # Panics
    ///
    /// If one of them belongs to another tape.
    #[must_use]
    pub fn gradient(&self, output: Var<'_>, inputs: &[Var<'_>]) -> Vec<f64> {
        inputs.iter().chain([&output]).for_each(|var| var.check_tape(self));
        let nodes = self.nodes.borrow();
        let mut adjoint = vec![0.0; nodes.len()];
        if output.index != CONSTANT {
            adjoint[output.index] = 1.0;
        }
        for (i, node) in nodes.iter().enumerate().rev() {
            // What the output does not depend on must not reach the inputs: the side that
            // `where_nonpositive` did not take may have an infinite partial, and 0 * inf is NaN.
            if adjoint[i] == 0.0 {
                continue;
            }
            for (&operand, &partial) in node.operands.iter().zip(&node.partials) {
                if operand != CONSTANT {
                    adjoint[operand] += adjoint[i] * partial;
                }
            }
        }
        inputs.iter().map(|v| if v.index == CONSTANT { 0.0 } else { adjoint[v.index] }).collect()
    }

    fn record(&self, value: f64, operands: [usize; 2], partials: [f64; 2]) -> Var<'_> {
        let mut nodes = self.nodes.borrow_mut();
        nodes.push(Node { operands, partials });
        Var { tape: self, index: nodes.len() - 1, value }
    }
}

/// A number whose operations are recorded on a [`Tape`].
///
/// Numbers of two tapes do not mix: an operation on both panics.
#[derive(Clone, Copy, Debug)]
pub struct Var<'t> {
    tape: &'t Tape,
    index: usize,
    value: f64,
}

impl Var<'_> {
    /// The value.
    #[must_use]
    pub fn value(self) -> f64 {
        self.value
    }

    /// Indices mean something on their own tape only.
    #[inline]
    fn check_tape(self, tape: &Tape) {
        assert!(std::ptr::eq(self.tape, tape), "a number of another tape");
    }

    fn unary(self, value: f64, partial: f64) -> Self {
        self.record(value, [self.index, CONSTANT], [partial, 0.0])
    }

    fn binary(self, other: Self, value: f64, partials: [f64; 2]) -> Self {
        other.check_tape(self.tape);
        self.record(value, [self.index, other.index], partials)
    }

    fn record(self, value: f64, operands: [usize; 2], partials: [f64; 2]) -> Self {
        if operands == [CONSTANT; 2] {
            return Self { value, ..self };
        }
        self.tape.record(value, operands, partials)
    }
}

impl Add for Var<'_> {
    type Output = Self;
    fn add(self, b: Self) -> Self {
        self.binary(b, self.value + b.value, [1.0, 1.0])
    }
}

impl Sub for Var<'_> {
    type Output = Self;
    fn sub(self, b: Self) -> Self {
        self.binary(b, self.value - b.value, [1.0, -1.0])
    }
}

impl Mul for Var<'_> {
    type Output = Self;
    fn mul(self, b: Self) -> Self {
        self.binary(b, self.value * b.value, [b.value, self.value])
    }
}

impl Div for Var<'_> {
    type Output = Self;
    fn div(self, b: Self) -> Self {
        let quotient = self.value / b.value;
        self.binary(b, quotient, [1.0 / b.value, -quotient / b.value])
    }
}

impl Neg for Var<'_> {
    type Output = Self;
    fn neg(self) -> Self {
        self.unary(-self.value, -1.0)
    }
}

impl Add<f64> for Var<'_> {
    type Output = Self;
    fn add(self, b: f64) -> Self {
        self.unary(self.value + b, 1.0)
    }
}

impl Sub<f64> for Var<'_> {
    type Output = Self;
    fn sub(self, b: f64) -> Self {
        self.unary(self.value - b, 1.0)
    }
}

impl Mul<f64> for Var<'_> {
    type Output = Self;
    fn mul(self, b: f64) -> Self {
        self.unary(self.value * b, b)
    }
}

impl Div<f64> for Var<'_> {
    type Output = Self;
    fn div(self, b: f64) -> Self {
        self.unary(self.value / b, 1.0 / b)
    }
}

impl Scalar for Var<'_> {
    type Plain = f64;
    const ORDER: usize = 1;
    fn all_nonpositive(self) -> bool {
        self.value <= 0.0
    }
    fn plain(self) -> f64 {
        self.value
    }
    fn constants(self, value: f64) -> Self {
        self.constant(value)
    }
    fn constant(self, value: f64) -> Self {
        Self { index: CONSTANT, value, ..self }
    }
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.unary(root, if root > 0.0 { 0.5 / root } else { root })
    }
    fn exp(self) -> Self {
        let y = self.value.exp();
        self.unary(y, y)
    }
    fn ln(self) -> Self {
        self.unary(self.value.ln(), 1.0 / self.value)
    }
    fn sin(self) -> Self {
        let (sin, cos) = self.value.sin_cos();
        self.unary(sin, cos)
    }
    fn cos(self) -> Self {
        let (sin, cos) = self.value.sin_cos();
        self.unary(cos, -sin)
    }
    fn tan(self) -> Self {
        let y = self.value.tan();
        self.unary(y, 1.0 + y * y)
    }
    fn atan(self) -> Self {
        self.unary(self.value.atan(), 1.0 / (1.0 + self.value * self.value))
    }
    fn tanh(self) -> Self {
        let y = self.value.tanh();
        self.unary(y, 1.0 - y * y)
    }
    fn powf(self, p: f64) -> Self {
        let infinite = p < 1.0 && self.value == 0.0;
        let slope = if infinite { 0.0 } else { p * self.value.powf(p - 1.0) };
        self.unary(self.value.powf(p), slope)
    }
    fn abs(self) -> Self {
        self.unary(self.value.abs(), Scalar::sign(self.value))
    }
    fn where_nonpositive(self, yes: Self, no: Self) -> Self {
        yes.check_tape(self.tape);
        no.check_tape(self.tape);
        if self.value <= 0.0 { yes } else { no }
    }
}
