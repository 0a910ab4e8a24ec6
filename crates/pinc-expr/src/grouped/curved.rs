//! A function with its Jacobian and the derivatives of that.

use super::derivatives::{Linearized, Seed, differentiate, differentiate_again};
use super::schedule::Code;
use super::{GroupedFunction, run};
use crate::algebraic::Algebraic;
use crate::error::ExpressionProblem;
use crate::graph::{Graph, Value};
use pinc_ad::simd::Simd;
use pinc_ode::{Curvature, CurvedFunction, SparseFunction, SparsityPattern};
use std::sync::Arc;

/// A [`GroupedFunction`] with those second derivatives that are not zero everywhere.
#[derive(Clone, Debug)]
pub(crate) struct GroupedCurved {
    function: GroupedFunction,
    curved: Arc<Curved>,
}

#[derive(Debug)]
struct Curved {
    curvatures: Vec<Curvature>,
    /// Values, the entries of the Jacobian, then the second derivatives.
    code: Code,
}

impl GroupedCurved {
    /// `function`, which computes `results` of `graph` with the algebraic variables of
    /// `equations`.
    pub(crate) fn new(
        function: &GroupedFunction,
        graph: &Graph,
        equations: &Algebraic,
        results: &[Value],
    ) -> Result<Self, ExpressionProblem> {
        let parts = &function.0;
        let variables = parts.pattern.columns();
        // Unknowns and what belongs to them are held: their derivatives are in the values.
        let seeds = |variable: usize| match variable < variables {
            true => vec![(variable, Seed::One)],
            false => Vec::new(),
        };
        let mut linearized = match &parts.unknowns {
            None => differentiate(graph, results, &seeds),
            Some(unknowns) => {
                let (graph, results) = unknowns.substituted(graph, equations, results);
                differentiate(&graph, &results, &seeds)
            }
        };
        let second = differentiate_again(&mut linearized, &seeds);
        let Linearized { mut dag, values, rows, .. } = linearized;
        let zero = dag.constant(0.0);
        let (mut curvatures, mut curved) = (Vec::new(), Vec::new());
        let (mut entry, mut second) = (0, second.into_iter());
        let mut all = values;
        for (i, row) in rows.iter().enumerate() {
            let places = &parts.pattern.places()[parts.pattern.row(i)];
            let mut known = row.iter().zip(&mut second).peekable();
            for &variable in places {
                let here = known.next_if(|((place, _), _)| *place == variable);
                let (id, derivatives) = here.map_or((zero, Vec::new()), |((_, id), d)| (*id, d));
                all.push(id);
                if variable < parts.pattern.rows() {
                    let of = |(variable, id)| (Curvature { entry, variable }, id);
                    curved.extend(derivatives.into_iter().map(of));
                }
                entry += 1;
            }
        }
        for (curvature, id) in curved {
            curvatures.push(curvature);
            all.push(id);
        }
        let code = Code::new(&dag, parts.linearization.registers, &all)?;
        let curved = Arc::new(Curved { curvatures, code });
        Ok(Self { function: function.clone(), curved })
    }
}

impl SparseFunction for GroupedCurved {
    fn pattern(&self) -> &SparsityPattern {
        self.function.pattern()
    }

    fn memory<V: Simd>(&self, zero: V) -> Vec<V> {
        let code = &self.curved.code;
        let mut memory = self.function.memory(zero);
        memory.resize(memory.len().max(code.registers), zero);
        for (to, constant) in memory[code.first..].iter_mut().zip(&code.constants) {
            *to = zero.constant(*constant);
        }
        memory
    }

    #[inline(always)]
    fn values<V: Simd>(&self, memory: &mut [V]) -> &[u16] {
        self.function.values(memory)
    }

    #[inline(always)]
    fn linearize<V: Simd>(&self, memory: &mut [V]) -> &[u16] {
        self.function.linearize(memory)
    }
}

impl CurvedFunction for GroupedCurved {
    fn curvatures(&self) -> &[Curvature] {
        &self.curved.curvatures
    }

    #[inline(always)]
    fn curve<V: Simd>(&self, memory: &mut [V]) -> &[u16] {
        if let Some(unknowns) = &self.function.0.unknowns {
            unknowns.solve(memory, true);
        }
        run(&self.curved.code, memory)
    }
}
