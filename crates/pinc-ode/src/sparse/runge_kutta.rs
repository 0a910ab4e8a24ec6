//! Runge-Kutta methods with exact sensitivities through sparse Jacobians, as models.

use super::by_count::by_count;
use super::lanes::{gather, load, scatter, store};
use super::outputs::Outputs;
use super::propagation::{Sensitivities, Substep};
use super::small::{Small, Steps};
use super::tableau::{Stage, Tableau, places};
use super::{SparseFunction, SparsityPattern};
use crate::points::Points;
use crate::{Dims, Linearization, Model, OutputLinearization, Stages};
use pinc_ad::simd::{Isa, Simd, Task, Work};

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
/// sparse J. So they are those of the method itself, exact to rounding.
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
    assert!(sample_time_s > 0.0 && sample_time_s.is_finite(), "the step must be positive");
    assert!(substeps > 0, "at least one substep");
    plant.check();
    by_count(Build { plant, tableau, sample_time_s, substeps }, isa)
}

#[derive(Clone)]
struct Build<F> {
    plant: SparsePlant<F>,
    tableau: Tableau,
    sample_time_s: f64,
    substeps: usize,
}

impl<F: SparseFunction> Task for Build<F> {
    type Output = Box<dyn Model>;

    fn run<V: Simd>(self, zero: V) -> Box<dyn Model> {
        let Self { plant, tableau, sample_time_s, substeps } = self;
        #[expect(clippy::cast_precision_loss, reason = "a number of substeps is far below 2^53")]
        let h = sample_time_s / substeps as f64;
        let stages = tableau.stages_of(h);
        let pattern = plant.rhs.pattern();
        let nx = pattern.rows();
        Box::new(SparseRungeKutta {
            sample_time_s,
            substeps,
            zero,
            memory: plant.rhs.memory(zero),
            x: vec![zero; places(&stages) * nx],
            entries: vec![zero; stages.len() * pattern.entries()],
            sensitivities: Sensitivities::new(pattern, &stages, zero),
            small: Small::new(pattern, zero),
            outputs: Outputs::new(plant.dims, plant.outputs, zero),
            dims: plant.dims,
            rhs: plant.rhs,
            stages,
        })
    }
}

/// The model, on one kind of vectors.
#[derive(Clone, Debug)]
struct SparseRungeKutta<F, V> {
    dims: Dims,
    rhs: F,
    sample_time_s: f64,
    substeps: usize,
    stages: Vec<Stage>,
    zero: V,
    /// That of f, with the stage's (x, u, p).
    memory: Vec<V>,
    /// The places of the stages: see [`Stage`].
    x: Vec<V>,
    /// The entries of its Jacobian at each stage.
    entries: Vec<V>,
    sensitivities: Sensitivities<V>,
    small: Option<Small<V>>,
    outputs: Outputs<F, V>,
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

impl<F: SparseFunction, V: Simd> SparseRungeKutta<F, V> {
    /// Keeps the state as that at the beginning of a substep.
    #[inline(always)]
    fn begin(&mut self) {
        for (to, &x) in self.x.iter_mut().zip(&self.memory[..self.dims.nx]) {
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

    /// A substep of the state and of its derivatives by the first `columns` variables.
    #[inline(always)]
    fn linearized_substep(&mut self, number: usize, columns: usize) {
        self.begin();
        let Self { dims, rhs, stages, zero, memory, x, entries, .. } = self;
        let (nx, count) = (dims.nx, rhs.pattern().entries());
        for s in 0..stages.len() {
            let (values, rest) = rhs.linearize(memory).split_at(nx);
            gather(&mut entries[s * count..][..count], rest, memory);
            advance(stages, s, values, x, memory, *zero);
        }
        let Self { rhs, entries, stages, sensitivities, zero, .. } = self;
        let pattern = rhs.pattern();
        let substep = Substep { number, pattern, entries, stages };
        sensitivities.propagate(&substep, columns, *zero);
    }

    /// The derivative of a state by a variable.
    #[inline(always)]
    fn derivative(&self, state: usize, variable: usize) -> V {
        match &self.small {
            Some(small) => small.get(state, variable),
            None => self.sensitivities.get(state, variable),
        }
    }
}

/// A step of one point.
struct Step<'a, F, V> {
    model: &'a mut SparseRungeKutta<F, V>,
    at: Stages<'a>,
    next: &'a mut [f64],
}

impl<F: SparseFunction, V: Simd> Work for Step<'_, F, V> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { model, at, next } = self;
        load(&mut model.memory, model.dims, at, 0, model.zero);
        for _ in 0..model.substeps {
            model.substep();
        }
        for (to, &x) in next.iter_mut().zip(&model.memory) {
            scatter(x, 1, |_, value| *to = value);
        }
    }
}

/// Steps of some points with their Jacobians.
struct Linearize<'a, F, V> {
    model: &'a mut SparseRungeKutta<F, V>,
    points: Points<'a>,
}

impl<F: SparseFunction, V: Simd> Work for Linearize<'_, F, V> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { model, mut points } = self;
        let dims = model.dims;
        let columns = points.columns(dims);
        for begin in (0..points.at.x.len() / dims.nx).step_by(V::LANES) {
            let filled = load(&mut model.memory, dims, points.at, begin, model.zero);
            let SparseRungeKutta { rhs, stages, substeps, memory, zero, small, .. } = &mut *model;
            if let Some(small) = small {
                let (substeps, zero) = (*substeps, *zero);
                small.run(Steps { rhs, stages, substeps, memory, zero });
            } else {
                model.sensitivities.reset(model.zero);
                for number in 0..model.substeps {
                    model.linearized_substep(number, columns);
                }
            }
            let (x, place) = (&model.memory[..dims.nx], (begin, filled, columns));
            store(&mut points, dims, x, place, |i, column| model.derivative(i, column));
        }
    }
}

impl<F: SparseFunction, V: Simd> Model for SparseRungeKutta<F, V> {
    fn dims(&self) -> Dims {
        self.dims
    }

    fn sample_time_s(&self) -> f64 {
        self.sample_time_s
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        let at = Stages { x, u, p };
        assert!(at.count(self.dims) == 1 && next.len() == x.len(), "one point");
        self.zero.vectorize(Step { model: self, at, next });
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        let dims = self.dims;
        out.check(at.count(dims), dims);
        self.zero.vectorize(Linearize { model: self, points: Points { at, out } });
    }

    fn output(&mut self, x: &[f64], u: &[f64], p: &[f64], y: &mut [f64]) {
        self.outputs.values(Stages { x, u, p }, y);
    }

    fn feedthrough(&self) -> Vec<bool> {
        self.outputs.feedthrough()
    }

    fn linearize_output(&mut self, at: Stages<'_>, out: OutputLinearization<'_>) {
        self.outputs.linearize(at, out);
    }
}
