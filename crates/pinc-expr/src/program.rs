//! Equations as a list of steps on registers, run over any kind of number.

use crate::error::ExpressionProblem;
use crate::graph::{Graph, Node, Number, Operation, Value};
use pinc_ad::Scalar;
use pinc_ad::simd::Work;
use std::collections::BTreeSet;
use std::marker::PhantomData;

/// The most values that can be kept at once.
pub(crate) const MOST_REGISTERS: usize = 256;

/// One step: `registers[to] = operation(registers[a], registers[b], registers[c])`.
#[derive(Clone, Copy, Debug)]
struct Step {
    operation: Operation,
    a: u8,
    b: u8,
    c: u8,
    to: u8,
}

/// dx = f(x, u, p) or y = h(x, u, p), computed step by step.
///
/// The registers begin with the states, inputs and parameters. A register is taken again once its
/// value has been used for the last time, so that few are needed.
#[derive(Clone, Debug)]
pub(crate) struct Program {
    steps: Vec<Step>,
    /// The register of each result.
    results: Vec<u8>,
    registers: usize,
}

impl Program {
    /// The steps that lead from the first `variables` registers to `results`.
    pub(crate) fn new(
        graph: &Graph,
        variables: usize,
        results: &[Value],
    ) -> Result<Self, ExpressionProblem> {
        match Self::in_order(&graph.nodes, variables, results) {
            Err(ExpressionProblem::TooLarge(_)) => {
                let (nodes, results) = result_by_result(&graph.nodes, results);
                Self::in_order(&nodes, variables, &results)
            }
            found => found,
        }
    }

    /// The steps in the order of the nodes.
    fn in_order(
        nodes: &[Node],
        variables: usize,
        results: &[Value],
    ) -> Result<Self, ExpressionProblem> {
        let last_use = last_uses(nodes, results);
        let mut registers = Registers::new(variables);
        let mut place = vec![0; nodes.len()];
        let mut steps = Vec::new();
        for (i, node) in nodes.iter().enumerate() {
            if let Operation::Variable(index) = node.operation {
                place[i] = index;
            }
        }
        for (i, node) in nodes.iter().enumerate() {
            if last_use[i].is_none() || matches!(node.operation, Operation::Variable(_)) {
                continue;
            }
            let [a, b, c] = node.operands.map(|operand| operand.map_or(0, |value| place[value.0]));
            // A step reads before it writes, so that its result may replace an operand.
            let ends = |v: &&Value| last_use[v.0] == Some(i);
            let ending: BTreeSet<_> = node.operands.iter().flatten().filter(ends).collect();
            ending.into_iter().for_each(|value| registers.release(place[value.0]));
            place[i] = registers.take();
            steps.push((node.operation, [a, b, c, place[i]]));
        }
        let needed = registers.needed;
        let narrow = |register: usize| {
            u8::try_from(register).map_err(|_| ExpressionProblem::TooLarge(needed))
        };
        let steps = steps.into_iter().map(|(operation, [a, b, c, to])| {
            let (a, b, c, to) = (narrow(a)?, narrow(b)?, narrow(c)?, narrow(to)?);
            Ok(Step { operation, a, b, c, to })
        });
        let steps = steps.collect::<Result<_, _>>()?;
        let results = results.iter().map(|result| narrow(place[result.0]));
        let results = results.collect::<Result<_, _>>()?;
        narrow(needed.saturating_sub(1))?;
        Ok(Self { steps, results, registers: needed })
    }

    /// Writes the results into `to`.
    ///
    /// The steps are compiled once per kind of number and number of registers, for the instruction
    /// set that the number stands for, whatever the variables are converted from.
    #[inline(always)]
    pub(crate) fn run<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], to: &mut [S]) {
        self.run_on(&Variables { x, u, p, z: &[] }, Same, to);
    }

    /// Writes the results, on the kind of number that `convert` makes of the variables, into `to`.
    #[inline(always)]
    pub(crate) fn run_on<S: Scalar, C: Convert<S>>(
        &self,
        at: &Variables<'_, S>,
        convert: C,
        to: &mut [C::To],
    ) {
        let Some(&first) = at.x.first() else { return };
        let program = self;
        match self.registers {
            0..=8 => first.vectorize(Run::<S, C, 8> { program, at, convert, to }),
            9..=16 => first.vectorize(Run::<S, C, 16> { program, at, convert, to }),
            17..=64 => first.vectorize(Run::<S, C, 64> { program, at, convert, to }),
            _ => first.vectorize(Run::<S, C, MOST_REGISTERS> { program, at, convert, to }),
        }
    }
}

/// The values of the variables: states, inputs, parameters and algebraic variables.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Variables<'a, S> {
    pub(crate) x: &'a [S],
    pub(crate) u: &'a [S],
    pub(crate) p: &'a [S],
    pub(crate) z: &'a [S],
}

/// On which kind of number a program runs, given one of the variables.
pub(crate) trait Convert<S> {
    type To: Scalar;

    /// The variable with this place among all.
    fn convert(&self, value: S, place: usize) -> Self::To;
}

/// On the kind of the variables.
pub(crate) struct Same;

impl<S: Scalar> Convert<S> for Same {
    type To = S;

    #[inline(always)]
    fn convert(&self, value: S, _place: usize) -> S {
        value
    }
}

/// For each value the last one that is made of it, `usize::MAX` if it is a result;
/// `None` for values that no result needs.
fn last_uses(nodes: &[Node], results: &[Value]) -> Vec<Option<usize>> {
    let mut last_use = vec![None; nodes.len()];
    for result in results {
        // No node has this place, so the register is never free again.
        last_use[result.0] = Some(usize::MAX);
    }
    for (i, node) in nodes.iter().enumerate().rev() {
        if last_use[i].is_some() {
            for operand in node.operands.iter().flatten() {
                last_use[operand.0] = last_use[operand.0].max(Some(i));
            }
        }
    }
    last_use
}

/// The nodes in an order in which each comes when the first result needs it, and the results in it:
/// fewer are then kept at once where results have little in common.
fn result_by_result(nodes: &[Node], results: &[Value]) -> (Vec<Node>, Vec<Value>) {
    let mut places: Vec<Option<Value>> = vec![None; nodes.len()];
    let mut ordered = Vec::new();
    for result in results {
        let mut open = vec![*result];
        while let Some(&value) = open.last() {
            let Node { operation, operands } = nodes[value.0];
            let missing = operands.into_iter().flatten().find(|v| places[v.0].is_none());
            if places[value.0].is_some() {
                open.pop();
            } else if let Some(operand) = missing {
                open.push(operand);
            } else {
                let operands = operands.map(|operand| operand.and_then(|v| places[v.0]));
                places[value.0] = Some(Value(ordered.len()));
                ordered.push(Node { operation, operands });
                open.pop();
            }
        }
    }
    let results = results.iter().filter_map(|result| places[result.0]).collect();
    (ordered, results)
}

/// Which registers are free.
struct Registers {
    free: Vec<usize>,
    needed: usize,
}

impl Registers {
    fn new(taken: usize) -> Self {
        Self { free: Vec::new(), needed: taken }
    }

    fn take(&mut self) -> usize {
        self.free.pop().unwrap_or_else(|| {
            self.needed += 1;
            self.needed - 1
        })
    }

    fn release(&mut self, register: usize) {
        self.free.push(register);
    }
}

/// A run of a program with `R` registers, a power of 2.
struct Run<'a, S, C: Convert<S>, const R: usize> {
    program: &'a Program,
    at: &'a Variables<'a, S>,
    convert: C,
    to: &'a mut [C::To],
}

impl<S: Scalar, C: Convert<S>, const R: usize> Work for Run<'_, S, C, R> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Variables { x, u, p, z } = *self.at;
        let mut registers = [self.convert.convert(x[0], 0); R];
        let mut first = 0;
        for part in [x, u, p, z] {
            for (i, (to, &value)) in registers[first..].iter_mut().zip(part).enumerate() {
                *to = self.convert.convert(value, first + i);
            }
            first += part.len();
        }
        // A known number of registers spares the check of each index, of which derivatives are little
        // the slower. Their code is long: it serves any number.
        if const { C::To::ORDER == 0 } {
            run_steps(&self.program.steps, &mut registers);
        } else {
            run_steps(&self.program.steps, registers.as_mut_slice());
        }
        for (to, &register) in self.to.iter_mut().zip(&self.program.results) {
            *to = registers[usize::from(register) % R];
        }
    }
}

/// Takes registers, an array or a slice of a power of 2, through some steps. Not inlined: what the
/// variables were converted from is of no account here.
#[inline(never)]
fn run_steps<S: Scalar, R: AsMut<[S]> + ?Sized>(steps: &[Step], registers: &mut R) {
    let first = registers.as_mut()[0];
    first.vectorize(Steps { steps, registers, number: PhantomData });
}

/// Steps on registers `R` of numbers `S`.
struct Steps<'a, S, R: ?Sized> {
    steps: &'a [Step],
    registers: &'a mut R,
    number: PhantomData<S>,
}

impl<S: Scalar, R: AsMut<[S]> + ?Sized> Work for Steps<'_, S, R> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let registers = self.registers.as_mut();
        // If their number is known, the remainder spares the check of the index.
        let last = registers.len() - 1;
        for step in self.steps {
            let [a, b, c] = [step.a, step.b, step.c].map(|place| usize::from(place) & last);
            let value = apply(step.operation, &registers[a], &registers[b], &registers[c]);
            registers[usize::from(step.to) & last] = value;
        }
    }
}

#[inline(always)]
pub(crate) fn apply<S: Scalar>(operation: Operation, a: &S, b: &S, c: &S) -> S {
    let (a, b, c) = (*a, *b, *c);
    let of = |number: Number| number.value();
    match operation {
        Operation::Variable(_) => a,
        Operation::Constant(number) => a.constant(of(number)),
        Operation::Add => a + b,
        Operation::Sub => a - b,
        Operation::Mul => a * b,
        Operation::Div => a / b,
        Operation::Min => a.min(b),
        Operation::Max => a.max(b),
        Operation::Where => a.where_nonpositive(b, c),
        Operation::Neg => -a,
        Operation::AddNumber(number) => a + of(number),
        Operation::SubFrom(number) => -a + of(number),
        Operation::MulNumber(number) => a * of(number),
        Operation::DivInto(number) => a.constant(of(number)) / a,
        Operation::Power(number) => a.powf(of(number)),
        Operation::Function(function) => function.of(a),
    }
}
