//! Algebraic equations in code for vectors: Newton's method on registers, and the derivatives of
//! the unknowns by the implicit function theorem.

use super::derivatives::{Linearized, Seed, differentiate};
use super::run;
use super::schedule::Code;
use crate::algebraic::{Algebraic, LARGEST_BLOCK};
use crate::error::ExpressionProblem;
use crate::graph::{Graph, Value};
use crate::implicit::limits;
use crate::structure::{Block, variables_of};
use pinc_ad::simd::{Simd, Work};
use pinc_ad::{NewtonSystem, newton};
use std::collections::BTreeSet;

/// The registers of a function with algebraic equations: states, inputs and parameters, then the
/// unknowns, then the unknowns' derivatives that are not zero everywhere and the inverses of dg/dz.
#[derive(Debug)]
pub(super) struct Unknowns {
    blocks: Vec<BlockCode>,
    /// For each unknown, the variables on which it depends, with the registers of the derivatives.
    derivatives: Vec<Vec<(usize, usize)>>,
    /// States, inputs and parameters.
    variables: usize,
    /// The first register after all.
    pub(super) registers: usize,
}

#[derive(Debug)]
struct BlockCode {
    /// The registers of its unknowns.
    unknowns: Vec<usize>,
    limits: [[f64; 2]; LARGEST_BLOCK],
    starts: Code,
    /// The residuals, then row by row their derivatives by the block's unknowns.
    newton: Code,
    /// For each variable on which the unknowns depend, the derivatives of the residuals by it,
    /// the block's unknowns held.
    slopes: Code,
    /// In the same order, the registers of the unknowns' derivatives.
    derivatives: Vec<usize>,
    /// The first register of the inverse of dg/dz, row by row.
    inverse: usize,
}

impl Unknowns {
    /// `variables`: the number of states, inputs and parameters.
    pub(super) fn new(
        graph: &Graph,
        variables: usize,
        equations: &Algebraic,
    ) -> Result<Self, ExpressionProblem> {
        let count = equations.names.len();
        let mut all = Self {
            blocks: Vec::new(),
            derivatives: vec![Vec::new(); count],
            variables,
            registers: variables + count,
        };
        let places: Vec<_> =
            equations.blocks.iter().map(|block| all.place(graph, block, equations)).collect();
        for (block, (pattern, inverse)) in equations.blocks.iter().zip(places) {
            let code = all.block(graph, block, (&pattern, inverse), equations)?;
            all.registers = code.slopes.registers;
            all.blocks.push(code);
        }
        Ok(all)
    }

    /// Finds the variables on which a block's unknowns depend, registers for the derivatives, and
    /// the first one for the inverse.
    fn place(
        &mut self,
        graph: &Graph,
        block: &Block,
        equations: &Algebraic,
    ) -> (Vec<usize>, usize) {
        let mut pattern = BTreeSet::new();
        for &equation in &block.equations {
            for variable in variables_of(graph, equations.residuals[equation]) {
                match variable.checked_sub(self.variables) {
                    None => {
                        pattern.insert(variable);
                    }
                    Some(unknown) => pattern.extend(self.derivatives[unknown].iter().map(|d| d.0)),
                }
            }
        }
        for &unknown in &block.unknowns {
            for &variable in &pattern {
                self.derivatives[unknown].push((variable, self.registers));
                self.registers += 1;
            }
        }
        let inverse = self.registers;
        self.registers += block.unknowns.len() * block.unknowns.len();
        (pattern.into_iter().collect(), inverse)
    }

    fn block(
        &self,
        graph: &Graph,
        block: &Block,
        (pattern, inverse): (&[usize], usize),
        equations: &Algebraic,
    ) -> Result<BlockCode, ExpressionProblem> {
        let unknowns: Vec<usize> = block.unknowns.iter().map(|i| self.variables + i).collect();
        let n = unknowns.len();
        let pick = |values: &[Value], places: &[usize]| -> Vec<Value> {
            places.iter().map(|place| values[*place]).collect()
        };
        let starts = pick(&equations.starts, &block.unknowns);
        let Linearized { dag, values, .. } = differentiate(graph, &starts, &|_| Vec::new());
        let starts = Code::new(&dag, self.registers, &values)?;

        let residuals = pick(&equations.residuals, &block.equations);
        let own = |variable: usize| -> Vec<(usize, Seed)> {
            let place = unknowns.iter().position(|unknown| *unknown == variable);
            place.into_iter().map(|place| (place, Seed::One)).collect()
        };
        let Linearized { mut dag, mut values, rows, .. } = differentiate(graph, &residuals, &own);
        let zero = dag.constant(0.0);
        for row in &rows {
            let entry = |j: usize| row.iter().find(|(place, _)| *place == j).map_or(zero, |e| e.1);
            values.extend((0..n).map(entry));
        }
        let newton = Code::new(&dag, starts.registers, &values)?;

        let others = |variable: usize| -> Vec<(usize, Seed)> {
            if unknowns.contains(&variable) { Vec::new() } else { self.seeds(variable) }
        };
        let Linearized { mut dag, rows, .. } = differentiate(graph, &residuals, &others);
        let zero = dag.constant(0.0);
        let entry = |variable: usize, row: &Vec<(usize, usize)>| {
            row.iter().find(|(place, _)| *place == variable).map_or(zero, |entry| entry.1)
        };
        let entries = pattern.iter().flat_map(|&v| rows.iter().map(move |row| entry(v, row)));
        let slopes = Code::new(&dag, newton.registers, &entries.collect::<Vec<_>>())?;
        let places = |k: usize| block.unknowns.iter().map(move |i| self.derivatives[*i][k].1);
        Ok(BlockCode {
            limits: limits(equations, &block.unknowns),
            derivatives: (0..pattern.len()).flat_map(places).collect(),
            unknowns,
            starts,
            newton,
            slopes,
            inverse,
        })
    }

    /// `results` of a graph with the unknowns z replaced by
    ///
    /// ```text
    /// z - G g(x, z - G g(x, z)),    G the inverse of dg/dz, held
    /// ```
    ///
    /// which is z where the equations are solved, and whose derivatives by x up to order two, z
    /// held as well, equal the solution's: each such step of Newton's method makes the first order
    /// right that was wrong before it.
    pub(super) fn substituted(
        &self,
        graph: &Graph,
        equations: &Algebraic,
        results: &[Value],
    ) -> (Graph, Vec<Value>) {
        let mut to = Graph::default();
        let mut z: Vec<Value> =
            (0..equations.names.len()).map(|i| to.variable(self.variables + i)).collect();
        for (block, code) in equations.blocks.iter().zip(&self.blocks) {
            let residuals: Vec<_> =
                block.equations.iter().map(|i| equations.residuals[*i]).collect();
            for _ in 0..2 {
                let g = to.copy(graph, &residuals, self.variables, &z);
                for (i, &unknown) in block.unknowns.iter().enumerate() {
                    for (j, &g) in g.iter().enumerate() {
                        let factor = to.variable(code.inverse + i * block.unknowns.len() + j);
                        let step = to.mul(g, factor);
                        z[unknown] = to.sub(z[unknown], step);
                    }
                }
            }
        }
        let results = to.copy(graph, results, self.variables, &z);
        (to, results)
    }

    /// The derivatives of a variable by states, inputs and parameters.
    pub(super) fn seeds(&self, variable: usize) -> Vec<(usize, Seed)> {
        match variable.checked_sub(self.variables) {
            None => vec![(variable, Seed::One)],
            Some(unknown) => {
                let derivatives = self.derivatives[unknown].iter();
                derivatives.map(|(v, register)| (*v, Seed::Register(*register))).collect()
            }
        }
    }

    /// All code, whose constants must be in its registers.
    pub(super) fn code(&self) -> impl Iterator<Item = &Code> {
        self.blocks.iter().flat_map(|block| [&block.starts, &block.newton, &block.slopes])
    }

    /// Solves for the unknowns, and for their derivatives if asked for.
    #[inline(never)]
    pub(super) fn solve<V: Simd>(&self, memory: &mut [V], with_derivatives: bool) {
        if let Some(&first) = memory.first() {
            first.vectorize(Solve { blocks: &self.blocks, memory, with_derivatives });
        }
    }
}

struct Solve<'a, V> {
    blocks: &'a [BlockCode],
    memory: &'a mut [V],
    with_derivatives: bool,
}

impl<V: Simd> Work for Solve<'_, V> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { blocks, memory, with_derivatives } = self;
        for block in blocks {
            let mut on = OnRegisters { block, memory: &mut *memory };
            if block.unknowns.len() == 1 {
                on.solve::<1>(with_derivatives);
            } else {
                on.solve::<LARGEST_BLOCK>(with_derivatives);
            }
        }
    }
}

/// A block with its registers.
struct OnRegisters<'a, V> {
    block: &'a BlockCode,
    memory: &'a mut [V],
}

impl<V: Simd> OnRegisters<'_, V> {
    #[inline(always)]
    fn solve<const N: usize>(&mut self, with_derivatives: bool) {
        let block = self.block;
        let n = block.unknowns.len();
        let mut limits = [[0.0, 1.0]; N];
        limits.iter_mut().zip(&block.limits).for_each(|(to, from)| *to = *from);
        let mut start = [self.memory[0]; N];
        for (to, &place) in start.iter_mut().zip(run(&block.starts, self.memory)) {
            *to = self.memory[usize::from(place)];
        }
        let root = newton(self, start, &limits);
        for (&unknown, z) in block.unknowns.iter().zip(root.solved()) {
            self.memory[unknown] = z;
        }
        if !with_derivatives {
            return;
        }
        for (i, row) in root.inverse.iter().take(n).enumerate() {
            self.memory[block.inverse + i * n..][..n].copy_from_slice(&row[..n]);
        }
        let slopes = run(&block.slopes, self.memory);
        for (to, from) in block.derivatives.chunks_exact(n).zip(slopes.chunks_exact(n)) {
            for (&to, row) in to.iter().zip(&root.inverse) {
                let mut sum = row[0].constant(0.0);
                for (factor, &place) in row.iter().zip(from) {
                    sum = factor.neg_mul_add(self.memory[usize::from(place)], sum);
                }
                self.memory[to] = sum;
            }
        }
    }
}

impl<V: Simd, const N: usize> NewtonSystem<V, N> for OnRegisters<'_, V> {
    #[inline(always)]
    fn count(&self) -> usize {
        self.block.unknowns.len()
    }

    #[inline(always)]
    fn linearize(&mut self, z: &[V; N], g: &mut [V; N], slopes: &mut [[V; N]; N]) {
        let n = self.block.unknowns.len();
        for (&unknown, z) in self.block.unknowns.iter().zip(z) {
            self.memory[unknown] = *z;
        }
        let (values, entries) = run(&self.block.newton, self.memory).split_at(n);
        for (i, row) in entries.chunks_exact(n).enumerate() {
            g[i] = self.memory[usize::from(values[i])];
            for (j, &place) in row.iter().enumerate() {
                slopes[i][j] = self.memory[usize::from(place)];
            }
        }
    }
}
