//! Algebraic equations, solved wherever the right-hand side is evaluated.

use crate::algebraic::{Algebraic, LARGEST_BLOCK, MOST_UNKNOWNS};
use crate::error::ExpressionProblem;
use crate::graph::Graph;
use crate::program::{Convert, Program, Same, Variables};
use pinc_ad::simd::Work;
use pinc_ad::{Dual, NewtonRoot, NewtonSystem, Scalar, correct, newton};

/// Systems of equations that are solved one after the other.
#[derive(Clone, Debug)]
pub(crate) struct AlgebraicSystem {
    pub(crate) names: Vec<String>,
    pub(crate) blocks: Vec<BlockProgram>,
}

/// One of them.
#[derive(Clone, Debug)]
pub(crate) struct BlockProgram {
    /// The places of its unknowns among all.
    pub(crate) unknowns: Vec<usize>,
    /// The names of its equations.
    pub(crate) equations: Vec<String>,
    pub(crate) limits: [[f64; 2]; LARGEST_BLOCK],
    starts: Program,
    residuals: Program,
}

impl AlgebraicSystem {
    /// `variables`: the number of states, inputs and varying parameters.
    pub(crate) fn new(
        graph: &Graph,
        variables: usize,
        equations: &Algebraic,
    ) -> Result<Self, ExpressionProblem> {
        let all = variables + equations.names.len();
        let block = |block: &crate::structure::Block| {
            let starts: Vec<_> = block.unknowns.iter().map(|i| equations.starts[*i]).collect();
            let residuals: Vec<_> =
                block.equations.iter().map(|i| equations.residuals[*i]).collect();
            Ok(BlockProgram {
                equations: block.equations.iter().map(|i| equations.names[*i].clone()).collect(),
                limits: limits(equations, &block.unknowns),
                starts: Program::new(graph, all, &starts)?,
                residuals: Program::new(graph, all, &residuals)?,
                unknowns: block.unknowns.clone(),
            })
        };
        let blocks = equations.blocks.iter().map(block).collect::<Result<_, _>>()?;
        Ok(Self { names: equations.names.clone(), blocks })
    }

    /// Writes the algebraic variables into `z`; NaN where no root is found.
    #[inline(never)]
    pub(crate) fn solve<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], z: &mut [S]) {
        if let Some(&first) = x.first() {
            first.vectorize(Solve { system: self, x, u, p, z });
        }
    }

    /// Runs `program` at the algebraic variables that belong to (x, u, p).
    #[inline(never)]
    pub(crate) fn run<S: Scalar>(&self, program: &Program, [x, u, p]: [&[S]; 3], to: &mut [S]) {
        let Some(&first) = x.first() else { return };
        let mut z = [first; MOST_UNKNOWNS];
        let z = &mut z[..self.names.len()];
        self.solve(x, u, p, z);
        run_once(program, &Variables { x, u, p, z }, Same, to);
    }
}

/// The boxes of some unknowns.
pub(crate) fn limits(equations: &Algebraic, unknowns: &[usize]) -> [[f64; 2]; LARGEST_BLOCK] {
    let mut limits = [[0.0, 1.0]; LARGEST_BLOCK];
    for (to, &unknown) in limits.iter_mut().zip(unknowns) {
        *to = equations.limits[unknown];
    }
    limits
}

struct Solve<'a, S> {
    system: &'a AlgebraicSystem,
    x: &'a [S],
    u: &'a [S],
    p: &'a [S],
    z: &'a mut [S],
}

impl<S: Scalar> Work for Solve<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { system, x, u, p, z } = self;
        for block in &system.blocks {
            let mut on = OnPrograms { block, x, u, p, z: &mut *z };
            if block.unknowns.len() == 1 {
                on.solve::<1>();
            } else {
                on.solve::<LARGEST_BLOCK>();
            }
        }
    }
}

/// A block at a point.
pub(crate) struct OnPrograms<'a, S> {
    pub(crate) block: &'a BlockProgram,
    pub(crate) x: &'a [S],
    pub(crate) u: &'a [S],
    pub(crate) p: &'a [S],
    /// All algebraic variables: of the blocks before this one they are known.
    pub(crate) z: &'a mut [S],
}

impl<S: Scalar> OnPrograms<'_, S> {
    /// Where the search begins; also written into `z`.
    #[inline(always)]
    pub(crate) fn start<const N: usize>(&mut self) -> [S::Plain; N] {
        let mut start = [self.x[0].plain(); N];
        let at = Variables { x: self.x, u: self.u, p: self.p, z: &*self.z };
        run_once(&self.block.starts, &at, Plain, &mut start);
        start
    }

    /// The root that is found from `start`, which makes its derivatives exact and is written into
    /// `z`.
    #[inline(always)]
    pub(crate) fn find<const N: usize>(&mut self, start: [S::Plain; N]) -> NewtonRoot<S::Plain, N> {
        let mut limits = [[0.0, 1.0]; N];
        limits.iter_mut().zip(&self.block.limits).for_each(|(to, from)| *to = *from);
        newton(self, start, &limits)
    }

    #[inline(always)]
    fn solve<const N: usize>(&mut self) {
        let start = self.start::<N>();
        let root = self.find(start);
        self.set(&root.solved());
        let Self { block, x, u, p, .. } = *self;
        let mut own = [x[0]; N];
        for (to, &unknown) in own.iter_mut().zip(&block.unknowns) {
            *to = self.z[unknown];
        }
        let mut g = own;
        for _ in 0..S::ORDER {
            run_once(&block.residuals, &Variables { x, u, p, z: &*self.z }, Same, &mut g);
            correct(block.unknowns.len(), &root.inverse, &g, &mut own);
            for (from, &unknown) in own.iter().zip(&block.unknowns) {
                self.z[unknown] = *from;
            }
        }
    }

    /// Sets the unknowns, as constants.
    #[inline(always)]
    fn set<const N: usize>(&mut self, values: &[S::Plain; N]) {
        for (from, &unknown) in values.iter().zip(&self.block.unknowns) {
            self.z[unknown] = self.x[0].constants(*from);
        }
    }
}

impl<S: Scalar, const N: usize> NewtonSystem<S::Plain, N> for OnPrograms<'_, S> {
    #[inline(always)]
    fn count(&self) -> usize {
        self.block.unknowns.len()
    }

    #[inline(always)]
    fn linearize(
        &mut self,
        z: &[S::Plain; N],
        g: &mut [S::Plain; N],
        slopes: &mut [[S::Plain; N]; N],
    ) {
        self.set(z);
        let Self { block, x, u, p, .. } = *self;
        let at = Variables { x, u, p, z: &*self.z };
        let first = x.len() + u.len() + p.len();
        let mut lifted = [Dual::lift(z[0]); N];
        for (j, &unknown) in block.unknowns.iter().enumerate() {
            run_once(&block.residuals, &at, Lift { direction: first + unknown }, &mut lifted);
            for (i, residual) in lifted.iter().enumerate() {
                g[i] = residual.re;
                slopes[i][j] = residual.eps[0];
            }
        }
    }
}

/// On the plain numbers of the variables.
struct Plain;

impl<S: Scalar> Convert<S> for Plain {
    type To = S::Plain;

    #[inline(always)]
    fn convert(&self, value: S, _place: usize) -> S::Plain {
        value.plain()
    }
}

/// On plain numbers with the derivative by one of the variables.
struct Lift {
    direction: usize,
}

impl<S: Scalar> Convert<S> for Lift {
    type To = Dual<S::Plain>;

    #[inline(always)]
    fn convert(&self, value: S, place: usize) -> Dual<S::Plain> {
        Dual::variable(value.plain(), usize::from(place != self.direction))
    }
}

/// Not inlined: the code would stand at each of its places.
#[inline(never)]
fn run_once<S: Scalar, C: Convert<S>>(
    program: &Program,
    at: &Variables<'_, S>,
    convert: C,
    to: &mut [C::To],
) {
    program.run_on(at, convert, to);
}
