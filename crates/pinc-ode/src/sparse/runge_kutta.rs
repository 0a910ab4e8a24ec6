//! Runge-Kutta methods with exact sensitivities through sparse Jacobians, as models.

use super::adjoint::Adjoint;
use super::by_count::by_count;
use super::lanes::gather;
use super::model::{SparseModel, Stepper, checked_substep};
use super::propagation::{Sensitivities, Substep};
use super::small::{Small, Steps};
use super::tableau::{Stage, Tableau, places};
use super::{SparseFunction, SparsityPattern};
use crate::{Dims, Model};
use pinc_ad::simd::{Isa, Simd, Task};

/// The entries of all substeps are kept where they take no more bytes than this.
const MOST_KEPT: usize = 65_536;

/// A plant x' = f(x, u, p), y = h(x, u, p) as functions with sparse Jacobians.
#[derive(Clone, Debug)]
pub struct SparsePlant<F, H = F> {
    /// The sizes.
    pub dims: Dims,
    /// f
    pub rhs: F,
    /// h; `None` if the outputs are the states.
    pub outputs: Option<H>,
}

impl<F: SparseFunction, H: SparseFunction> SparsePlant<F, H> {
    /// Panics if the functions are not of the size of the plant.
    pub(super) fn check(&self) {
        let Dims { nx, nu, np, ny } = self.dims;
        let size = |pattern: &SparsityPattern| [pattern.rows(), pattern.columns()];
        assert!(size(self.rhs.pattern()) == [nx, nx + nu + np], "size of f");
        let outputs = self.outputs.as_ref().map_or([ny, nx + nu + np], |h| size(h.pattern()));
        assert!(outputs == [ny, nx + nu + np], "size of h");
    }
}

/// The method of `tableau` over steps of `sample_time_s` seconds, each in `substeps` parts, as a
/// [`Model`].
///
/// The points of a horizon are in the lanes of the vectors of `isa`. At each stage f and the
/// entries of its Jacobian are computed at all of them; the sensitivities S follow S' = J S with
/// sparse J. So they are the derivatives of the method itself, exact to rounding.
///
/// # Panics
///
/// If `sample_time_s` is not positive and finite or `substeps` is 0, if the functions are not of
/// the size of the plant, or if the machine does not have the instruction set.
#[must_use]
pub fn sparse_runge_kutta<F: SparseFunction>(
    plant: SparsePlant<F>,
    tableau: Tableau,
    sample_time_s: f64,
    substeps: usize,
    isa: Isa,
) -> Box<dyn Model> {
    let h = checked_substep(&plant, sample_time_s, substeps);
    by_count(Build { plant, stages: tableau.stages_of(h), sample_time_s, substeps }, isa)
}

#[derive(Clone)]
struct Build<F> {
    plant: SparsePlant<F>,
    stages: Vec<Stage>,
    sample_time_s: f64,
    substeps: usize,
}

impl<F: SparseFunction> Task for Build<F> {
    type Output = Box<dyn Model>;

    fn run<V: Simd>(self, zero: V) -> Box<dyn Model> {
        let Self { plant: SparsePlant { dims, rhs, outputs }, stages, sample_time_s, substeps } =
            self;
        let pattern = rhs.pattern();
        let of_substep = stages.len() * pattern.entries();
        let fits = substeps * of_substep * size_of::<V>() <= MOST_KEPT;
        let kept = if fits { substeps } else { 1 };
        let stepper = Explicit {
            nx: dims.nx,
            substeps,
            zero,
            memory: rhs.memory(zero),
            x: vec![zero; places(&stages) * dims.nx],
            entries: vec![zero; kept * of_substep],
            keeps_all: kept == substeps,
            sensitivities: Sensitivities::new(pattern, &stages, zero),
            adjoint: Adjoint::new(pattern, &stages, substeps, zero),
            small: Small::new(pattern, zero),
            rhs,
            stages,
        };
        Box::new(SparseModel::new((dims, outputs), sample_time_s, stepper, zero))
    }
}

/// The method, on one kind of vectors.
#[derive(Debug)]
struct Explicit<F, V> {
    nx: usize,
    rhs: F,
    substeps: usize,
    stages: Vec<Stage>,
    zero: V,
    /// The memory of f, with the stage's (x, u, p).
    memory: Vec<V>,
    /// The places of the stages: see [`Stage`].
    x: Vec<V>,
    /// The entries of its Jacobian at each stage, of all substeps or of one.
    entries: Vec<V>,
    keeps_all: bool,
    sensitivities: Sensitivities<V>,
    adjoint: Adjoint<V>,
    small: Option<Small<V>>,
}

/// Adds the slope of stage `s`, whose components are at `slope` in `memory`, to what is made of it
/// in the places `x`, and makes the next stage the current one.
#[inline(always)]
fn advance<V: Simd>(
    stages: &[Stage],
    s: usize,
    slope: &[u16],
    x: &mut [V],
    memory: &mut [V],
    zero: V,
) {
    let nx = slope.len();
    for step in &stages[s].moves {
        let factor = zero.constant(step.factor);
        for (i, &place) in slope.iter().enumerate() {
            let sum = memory[usize::from(place)].mul_add(factor, x[step.from * nx + i]);
            x[step.to * nx + i] = sum;
        }
    }
    let next = stages.get(s + 1).map_or(0, |stage| stage.input);
    for (to, &x) in memory.iter_mut().zip(&x[next * nx..][..nx]) {
        *to = x;
    }
}

impl<F: SparseFunction, V: Simd> Explicit<F, V> {
    /// Keeps the state as that at the beginning of a substep.
    #[inline(always)]
    fn begin(&mut self) {
        for (to, &x) in self.x.iter_mut().zip(&self.memory[..self.nx]) {
            *to = x;
        }
    }

    /// A substep of the state alone.
    #[inline(always)]
    fn substep(&mut self) {
        self.begin();
        let Self { rhs, stages, zero, memory, x, .. } = self;
        for s in 0..stages.len() {
            let places = rhs.values(memory);
            advance(stages, s, places, x, memory, *zero);
        }
    }

    /// A substep of the state, with the entries of the Jacobian at each stage in a `place` for those
    /// of a substep.
    #[inline(always)]
    fn recorded_substep(&mut self, place: usize) {
        self.begin();
        let Self { nx, rhs, stages, zero, memory, x, entries, .. } = self;
        let count = rhs.pattern().entries();
        let entries = &mut entries[place * stages.len() * count..];
        for s in 0..stages.len() {
            let (values, rest) = rhs.linearize(memory).split_at(*nx);
            gather(&mut entries[s * count..][..count], rest, memory);
            advance(stages, s, values, x, memory, *zero);
        }
    }

    /// A substep of the state and of its derivatives by the first `columns` variables.
    #[inline(always)]
    fn linearized_substep(&mut self, number: usize, columns: usize) {
        self.recorded_substep(0);
        let Self { rhs, entries, stages, sensitivities, zero, .. } = self;
        let pattern = rhs.pattern();
        let substep = Substep { number, pattern, entries, stages };
        sensitivities.propagate(&substep, columns, *zero);
    }
}

impl<F: SparseFunction, V: Simd> Stepper<V> for Explicit<F, V> {
    #[inline(always)]
    fn memory(&self) -> &[V] {
        &self.memory
    }

    #[inline(always)]
    fn memory_mut(&mut self) -> &mut [V] {
        &mut self.memory
    }

    #[inline(always)]
    fn step(&mut self) {
        for _ in 0..self.substeps {
            self.substep();
        }
    }

    #[inline(always)]
    fn linearize(&mut self, columns: usize) {
        let Self { rhs, stages, substeps, memory, zero, small, .. } = &mut *self;
        if let Some(small) = small {
            let (substeps, zero) = (*substeps, *zero);
            return small.run(Steps { rhs, stages, substeps, memory, zero }, columns);
        }
        self.sensitivities.reset(columns, self.zero);
        for number in 0..self.substeps {
            self.linearized_substep(number, columns);
        }
    }

    #[inline(always)]
    fn derivative(&self, state: usize, variable: usize) -> V {
        match &self.small {
            Some(small) => small.get(state, variable),
            None => self.sensitivities.get(state, variable),
        }
    }

    #[inline(always)]
    fn pull_back(&mut self, weights: impl Fn(usize) -> V, columns: usize) -> Option<&[V]> {
        let (nx, all) = (self.nx, self.keeps_all);
        for number in 0..self.substeps {
            if all {
                self.recorded_substep(number);
                continue;
            }
            self.adjoint.gradient.start(number).copy_from_slice(&self.memory[..nx]);
            if number + 1 < self.substeps {
                self.substep();
            }
        }
        self.adjoint.gradient.begin(weights, self.zero);
        for number in (0..self.substeps).rev() {
            if !all {
                self.memory[..nx].copy_from_slice(self.adjoint.gradient.start(number));
                self.recorded_substep(0);
            }
            let Self { rhs, stages, entries, adjoint, zero, .. } = &mut *self;
            let pattern = rhs.pattern();
            let place = if all { number } else { 0 } * stages.len() * pattern.entries();
            adjoint.pull_back(pattern, (stages, &entries[place..]), columns, *zero);
        }
        Some(&self.adjoint.gradient.numbers)
    }
}
