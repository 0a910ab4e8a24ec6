//! A function with its Jacobian and the derivatives of that.

use super::derivatives::{Linearized, Seed, differentiate, differentiate_again};
use super::schedule::Code;
use super::{GroupedFunction, run};
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
    /// `function`, which computes `results` of `graph`. `None` if it has algebraic variables, whose
    /// second derivatives are not among these, or if it becomes too large.
    pub(crate) fn new(
        function: &GroupedFunction,
        graph: &Graph,
        results: &[Value],
    ) -> Option<Self> {
        let parts = &function.0;
        if parts.unknowns.is_some() {
            return None;
        }
        let seeds = |variable: usize| vec![(variable, Seed::One)];
        let mut linearized = differentiate(graph, results, &seeds);
        let second = differentiate_again(&mut linearized);
        let Linearized { dag, values, rows, .. } = linearized;
        let (mut curvatures, mut all) = (Vec::new(), values);
        all.extend(rows.iter().flatten().map(|(_, id)| *id));
        for (entry, derivatives) in second.into_iter().enumerate() {
            if parts.pattern.places()[entry] >= parts.pattern.rows() {
                continue;
            }
            for (variable, id) in derivatives {
                curvatures.push(Curvature { entry, variable });
                all.push(id);
            }
        }
        let code = Code::new(&dag, parts.linearization.registers, &all).ok()?;
        let curved = Arc::new(Curved { curvatures, code });
        Some(Self { function: function.clone(), curved })
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
        run(&self.curved.code, memory)
    }
}
