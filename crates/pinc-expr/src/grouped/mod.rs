//! A function and its Jacobian as code for vectors: steps grouped by operation.

mod curved;
mod dag;
mod derivatives;
mod implicit;
mod linear;
mod run;
mod schedule;
#[cfg(test)]
mod tests;

use crate::algebraic::Algebraic;
use crate::error::ExpressionProblem;
use crate::graph::{Graph, Value};
pub(crate) use curved::GroupedCurved;
use derivatives::{Linearized, Seed, differentiate};
use implicit::Unknowns;
use pinc_ad::simd::Simd;
use pinc_ode::{SparseFunction, SparsityPattern};
use run::{FEW, Run};
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
    /// The algebraic variables, if there are any.
    unknowns: Option<Unknowns>,
}

impl GroupedFunction {
    /// The function from the first `variables` nodes' values, and the algebraic variables that
    /// belong to them, to `results`.
    pub(crate) fn new(
        graph: &Graph,
        variables: usize,
        equations: &Algebraic,
        results: &[Value],
    ) -> Result<Self, ExpressionProblem> {
        let unknowns = match equations.names.is_empty() {
            true => None,
            false => Some(Unknowns::new(graph, variables, equations)?),
        };
        let seeds = |variable: usize| match &unknowns {
            Some(unknowns) => unknowns.seeds(variable),
            None => vec![(variable, Seed::One)],
        };
        let Linearized { dag, values: ids, rows, .. } = differentiate(graph, results, &seeds);
        let first = unknowns.as_ref().map_or(variables, |unknowns| unknowns.registers);
        let values = Code::new(&dag, first, &ids)?;
        let entries = rows.iter().flatten().map(|(_, id)| *id);
        let all: Vec<_> = ids.iter().copied().chain(entries).collect();
        let linearization = Code::new(&dag, values.registers, &all)?;
        let places = rows.iter().map(|row| row.iter().map(|(variable, _)| *variable));
        let pattern = SparsityPattern::new(variables, places);
        Ok(Self(Arc::new(Parts { values, linearization, pattern, unknowns })))
    }
}

impl SparseFunction for GroupedFunction {
    fn pattern(&self) -> &SparsityPattern {
        &self.0.pattern
    }

    fn memory<V: Simd>(&self, zero: V) -> Vec<V> {
        let Parts { values, linearization, unknowns, .. } = &*self.0;
        let mut memory = vec![zero; linearization.registers.max(FEW)];
        let solving = unknowns.iter().flat_map(Unknowns::code);
        for code in solving.chain([values, linearization]) {
            let constants = code.constants.iter().map(|constant| zero.constant(*constant));
            memory[code.first..].iter_mut().zip(constants).for_each(|(to, from)| *to = from);
        }
        memory
    }

    #[inline(always)]
    fn values<V: Simd>(&self, memory: &mut [V]) -> &[u16] {
        if let Some(unknowns) = &self.0.unknowns {
            unknowns.solve(memory, false);
        }
        run(&self.0.values, memory)
    }

    #[inline(always)]
    fn linearize<V: Simd>(&self, memory: &mut [V]) -> &[u16] {
        if let Some(unknowns) = &self.0.unknowns {
            unknowns.solve(memory, true);
        }
        run(&self.0.linearization, memory)
    }
}

/// Not inlined: portable vectors have no function of their own for [`pinc_ad::Scalar::vectorize`],
/// and the code would stand at each of its places.
#[inline(never)]
fn run<'a, V: Simd>(code: &'a Code, registers: &mut [V]) -> &'a [u16] {
    if let Some(&first) = registers.first() {
        first.vectorize(Run { code, registers });
    }
    &code.results
}
