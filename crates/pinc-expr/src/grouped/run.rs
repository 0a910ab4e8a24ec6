//! Code, run on vectors.

use super::dag::Op;
use super::schedule::{Code, Step};
use crate::graph::Function;
use pinc_ad::simd::{Simd, Work, cos, sin, sin_cos, tan};

/// A run of some code, whose registers have their constants and variables.
pub(super) struct Run<'a, V> {
    pub(super) code: &'a Code,
    pub(super) registers: &'a mut [V],
}

/// Registers whose numbers need no check, if there are enough.
pub(super) const FEW: usize = 256;

/// Takes an expression of the operands through some steps. (No closures: where they are not
/// inlined, they are compiled without the vectors' instructions.)
macro_rules! each {
    ($r:ident, $steps:ident, $a:ident => $value:expr) => {
        for Step { operands: [a, ..], to } in $steps {
            let $a = $r.get(*a);
            $r.set(*to, $value);
        }
    };
    ($r:ident, $steps:ident, $a:ident $b:ident => $value:expr) => {
        for Step { operands: [a, b, _], to } in $steps {
            let ($a, $b) = ($r.get(*a), $r.get(*b));
            $r.set(*to, $value);
        }
    };
    ($r:ident, $steps:ident, $a:ident $b:ident $c:ident => $value:expr) => {
        for Step { operands: [a, b, c], to } in $steps {
            let ($a, $b, $c) = ($r.get(*a), $r.get(*b), $r.get(*c));
            $r.set(*to, $value);
        }
    };
}

/// The registers of some code.
trait Registers<V> {
    fn get(&self, place: u16) -> V;
    fn set(&mut self, place: u16, value: V);
    fn all(&mut self) -> &mut [V];
}

impl<V: Simd> Registers<V> for &mut [V; FEW] {
    #[inline(always)]
    fn get(&self, place: u16) -> V {
        // The remainder spares the check of the index.
        self[usize::from(place) % FEW]
    }
    #[inline(always)]
    fn set(&mut self, place: u16, value: V) {
        self[usize::from(place) % FEW] = value;
    }
    #[inline(always)]
    fn all(&mut self) -> &mut [V] {
        *self
    }
}

impl<V: Simd> Registers<V> for &mut [V] {
    #[inline(always)]
    fn get(&self, place: u16) -> V {
        self[usize::from(place)]
    }
    #[inline(always)]
    fn set(&mut self, place: u16, value: V) {
        self[usize::from(place)] = value;
    }
    #[inline(always)]
    fn all(&mut self) -> &mut [V] {
        self
    }
}

impl<V: Simd> Work for Run<'_, V> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { code, registers } = self;
        match registers.first_chunk_mut::<FEW>() {
            Some(few) if code.registers <= FEW => steps(code, few),
            _ => steps(code, registers),
        }
    }
}

#[inline(always)]
fn steps<V: Simd>(code: &Code, mut r: impl Registers<V>) {
    let r = &mut r;
    for group in &code.groups {
        let steps = &code.steps[group.begin..group.end];
        match group.op {
            // They are in their registers from the start.
            Op::Variable(_) | Op::Constant(_) => {}
            Op::Add => each!(r, steps, a b => a + b),
            Op::Sub => each!(r, steps, a b => a - b),
            Op::Mul => each!(r, steps, a b => a * b),
            Op::Div => each!(r, steps, a b => a / b),
            Op::MulAdd => each!(r, steps, a b c => a.mul_add(b, c)),
            Op::MulSub => each!(r, steps, a b c => a.mul_add(b, -c)),
            Op::NegMulAdd => each!(r, steps, a b c => a.neg_mul_add(b, c)),
            Op::Where => each!(r, steps, a b c => a.where_nonpositive(b, c)),
            Op::Neg => each!(r, steps, a => -a),
            Op::RootSlope => each!(r, steps, a => root_slope(a)),
            Op::Function(Function::Sqrt) => each!(r, steps, a => a.sqrt()),
            op => long(op, steps, r.all()),
        }
    }
}

/// Takes an operation that is long, and therefore compiled once, through some steps.
#[inline(never)]
fn long<V: Simd>(op: Op, steps: &[Step], registers: &mut [V]) {
    if let Some(&first) = registers.first() {
        first.vectorize(Long { op, steps, registers });
    }
}

struct Long<'a, V> {
    op: Op,
    steps: &'a [Step],
    registers: &'a mut [V],
}

impl<V: Simd> Work for Long<'_, V> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { op, steps, registers: mut r } = self;
        match op {
            Op::Power(number) => each!(r, steps, a => a.powf(number.value())),
            Op::PowerSlope(number) => each!(r, steps, a => power_slope(a, number.value())),
            Op::Function(Function::Exp) => each!(r, steps, a => a.exp()),
            Op::Function(Function::Log) => each!(r, steps, a => a.ln()),
            Op::Function(Function::Sin) => each!(r, steps, a => sin(a)),
            Op::Function(Function::Cos) => each!(r, steps, a => cos(a)),
            Op::SineCosine => {
                for Step { operands: [a, cosine, _], to } in steps {
                    let (sin, cos) = sin_cos(r.get(*a));
                    r.set(*to, sin);
                    r.set(*cosine, cos);
                }
            }
            Op::Function(Function::Tan) => each!(r, steps, a => tan(a)),
            Op::Function(Function::Tanh) => each!(r, steps, a => a.tanh()),
            Op::Function(Function::Atan) => each!(r, steps, a => a.atan()),
            Op::Function(Function::Abs) => each!(r, steps, a => a.abs()),
            Op::Function(Function::Sign) => each!(r, steps, a => a.sign()),
            Op::Min => each!(r, steps, a b => a.min(b)),
            Op::Max => each!(r, steps, a b => a.max(b)),
            // The others are short.
            _ => {}
        }
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
