//! Code, run on vectors.

use super::dag::Op;
use super::schedule::{Code, Step};
use crate::graph::Function;
use pinc_ad::Scalar;
use pinc_ad::simd::{Simd, Work, cos, sin};

/// A run of some code, whose registers have their constants and variables.
pub(super) struct Run<'a, V> {
    pub(super) code: &'a Code,
    pub(super) registers: &'a mut [V],
}

impl<V: Simd> Work for Run<'_, V> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { code, registers } = self;
        let r = &mut registers[..code.registers];
        for group in &code.groups {
            let steps = &code.steps[group.begin..group.end];
            match group.op {
                // They are in their registers from the start.
                Op::Variable(_) | Op::Constant(_) => {}
                Op::Add => binary(r, steps, |a, b| a + b),
                Op::Sub => binary(r, steps, |a, b| a - b),
                Op::Mul => binary(r, steps, |a, b| a * b),
                Op::Div => binary(r, steps, |a, b| a / b),
                Op::Min => binary(r, steps, Scalar::min),
                Op::Max => binary(r, steps, Scalar::max),
                Op::MulAdd => ternary(r, steps, |a, b, c| a.mul_add(b, c)),
                Op::MulSub => ternary(r, steps, |a, b, c| a.mul_add(b, -c)),
                Op::NegMulAdd => ternary(r, steps, |a, b, c| a.neg_mul_add(b, c)),
                Op::Where => ternary(r, steps, |a, b, c| a.where_nonpositive(b, c)),
                Op::Neg => unary(r, steps, |a| -a),
                Op::RootSlope => unary(r, steps, root_slope),
                Op::Power(number) => unary(r, steps, |a| a.powf(number.value())),
                Op::PowerSlope(number) => unary(r, steps, |a| power_slope(a, number.value())),
                Op::Function(function) => apply(r, steps, function),
            }
        }
    }
}

#[inline(always)]
fn apply<V: Simd>(r: &mut [V], steps: &[Step], function: Function) {
    match function {
        Function::Sqrt => unary(r, steps, Scalar::sqrt),
        Function::Exp => unary(r, steps, Scalar::exp),
        Function::Log => unary(r, steps, Scalar::ln),
        Function::Sin => unary(r, steps, sin),
        Function::Cos => unary(r, steps, cos),
        Function::Tan => unary(r, steps, |a| sin(a) / cos(a)),
        Function::Tanh => unary(r, steps, Scalar::tanh),
        Function::Atan => unary(r, steps, Scalar::atan),
        Function::Abs => unary(r, steps, Scalar::abs),
        Function::Sign => unary(r, steps, Scalar::sign),
    }
}

#[inline(always)]
fn unary<V: Simd>(r: &mut [V], steps: &[Step], f: impl Fn(V) -> V) {
    for Step { operands: [a, ..], to } in steps {
        r[usize::from(*to)] = f(r[usize::from(*a)]);
    }
}

#[inline(always)]
fn binary<V: Simd>(r: &mut [V], steps: &[Step], f: impl Fn(V, V) -> V) {
    for Step { operands: [a, b, _], to } in steps {
        r[usize::from(*to)] = f(r[usize::from(*a)], r[usize::from(*b)]);
    }
}

#[inline(always)]
fn ternary<V: Simd>(r: &mut [V], steps: &[Step], f: impl Fn(V, V, V) -> V) {
    for Step { operands: [a, b, c], to } in steps {
        r[usize::from(*to)] = f(r[usize::from(*a)], r[usize::from(*b)], r[usize::from(*c)]);
    }
}

/// As in the root of a [`pinc_ad::Dual`].
#[inline(always)]
fn root_slope<V: Simd>(root: V) -> V {
    root.where_nonpositive(root.constant(0.0), root.constant(0.5) / root)
}

/// As in the power of a [`pinc_ad::Dual`].
#[inline(always)]
fn power_slope<V: Simd>(a: V, p: f64) -> V {
    let slope = a.powf(p - 1.0) * p;
    if p < 1.0 {
        let at_zero = a.where_nonpositive(a.constant(0.0), slope);
        (-a).where_nonpositive(at_zero, slope)
    } else {
        slope
    }
}
