//! A function and its Jacobian as code for vectors: steps grouped by operation.

mod dag;
mod derivatives;
mod linear;
mod run;
mod schedule;

use crate::error::ExpressionProblem;
use crate::graph::{Graph, Value};
use derivatives::differentiate;
use pinc_ad::simd::Simd;
use pinc_ode::{SparseFunction, SparsityPattern};
use run::Run;
use schedule::Code;
use std::sync::Arc;

/// Values of a graph as a function of its variables, with those derivatives that are not zero
/// everywhere.
#[derive(Clone, Debug)]
pub(crate) struct GroupedFunction(Arc<Parts>);

#[derive(Debug)]
struct Parts {
    /// Values alone.
    values: Code,
    /// Values, then the entries of the Jacobian.
    linearization: Code,
    pattern: SparsityPattern,
}

impl GroupedFunction {
    /// The function from the first `variables` nodes' values to `results`.
    pub(crate) fn new(
        graph: &Graph,
        variables: usize,
        results: &[Value],
    ) -> Result<Self, ExpressionProblem> {
        let (dag, ids, rows) = differentiate(graph, results);
        let values = Code::new(&dag, variables, &ids)?;
        let entries = rows.iter().flatten().map(|(_, id)| *id);
        let all: Vec<_> = ids.iter().copied().chain(entries).collect();
        let linearization = Code::new(&dag, variables, &all)?;
        let places = rows.iter().map(|row| row.iter().map(|(variable, _)| *variable));
        let pattern = SparsityPattern::new(variables, places);
        Ok(Self(Arc::new(Parts { values, linearization, pattern })))
    }
}

impl SparseFunction for GroupedFunction {
    fn pattern(&self) -> &SparsityPattern {
        &self.0.pattern
    }

    fn memory<V: Simd>(&self, zero: V) -> Vec<V> {
        let mut memory = Vec::new();
        for code in [&self.0.values, &self.0.linearization] {
            let begin = memory.len() + code.variables;
            memory.resize(memory.len() + code.registers, zero);
            let constants = code.constants.iter().map(|constant| zero.constant(*constant));
            memory[begin..].iter_mut().zip(constants).for_each(|(to, constant)| *to = constant);
        }
        memory
    }

    #[inline(always)]
    fn values<V: Simd>(&self, memory: &mut [V], at: &[V], values: &mut [V]) {
        let code = &self.0.values;
        let registers = &mut memory[..code.registers];
        run(code, registers, at);
        copy(code, registers, 0, values);
    }

    #[inline(always)]
    fn linearize<V: Simd>(
        &self,
        memory: &mut [V],
        at: &[V],
        values: &mut [V],
        entries: &mut [V],
    ) {
        let code = &self.0.linearization;
        let registers = &mut memory[self.0.values.registers..];
        run(code, registers, at);
        copy(code, registers, 0, values);
        copy(code, registers, values.len(), entries);
    }
}

#[inline(always)]
fn run<V: Simd>(code: &Code, registers: &mut [V], at: &[V]) {
    registers[..code.variables].copy_from_slice(at);
    let Some(&first) = at.first() else { return };
    first.vectorize(Run { code, registers });
}

/// Copies the results from the `begin`-th on.
#[inline(always)]
fn copy<V: Simd>(code: &Code, registers: &[V], begin: usize, to: &mut [V]) {
    for (to, &register) in to.iter_mut().zip(&code.results[begin..]) {
        *to = registers[usize::from(register)];
    }
}
