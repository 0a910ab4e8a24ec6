//! Runge-Kutta methods with exact sensitivities through sparse Jacobians, as models.

use super::SparseFunction;
use super::by_count::ByCount;
use super::propagation::{Sensitivities, Substep};
use super::small::{Small, Steps};
use super::tableau::{Stage, Tableau, places};
use crate::points::Points;
use crate::{Dims, Linearization, Model, OutputLinearization, Stages};
use pinc_ad::simd::{Isa, Simd, Task, Work};

/// Lanes of the widest vector.
const WIDEST: usize = 8;

/// A plant x' = f(x, u, p), y = h(x, u, p) as functions with sparse Jacobians.
#[derive(Clone, Debug)]
pub struct SparsePlant<F> {
    /// The sizes.
    pub dims: Dims,
    /// f
    pub rhs: F,
    /// h; `None` if the outputs are the states.
    pub outputs: Option<F>,
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
    let Dims { nx, nu, np, ny } = plant.dims;
    let size = |function: &F| [function.pattern().rows(), function.pattern().columns()];
    assert!(size(&plant.rhs) == [nx, nx + nu + np], "size of f");
    let outputs = plant.outputs.as_ref().map_or([nx, nx + nu + np], size);
    assert!(outputs == [ny, nx + nu + np], "size of h");
    let build = Build { plant, tableau, sample_time_s, substeps };
    if isa != Isa::Avx512 || !Isa::available().contains(&Isa::Avx2) {
        return isa.dispatch(build);
    }
    let narrow = Isa::Avx2.dispatch(build.clone());
    Box::new(ByCount { wide: isa.dispatch(build), narrow, lanes: isa.lanes() })
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
            outputs: plant.outputs.as_ref().map_or(Vec::new(), |outputs| outputs.memory(zero)),
            plant,
            stages,
        })
    }
}

/// The model, on one kind of vectors.
#[derive(Clone, Debug)]
struct SparseRungeKutta<F, V> {
    plant: SparsePlant<F>,
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
    /// That of h.
    outputs: Vec<V>,
}

/// Writes the variables of points from the one numbered `begin` on to the first places of `memory`;
/// lanes without a point repeat the last. Gives the number of points.
#[inline(always)]
fn load<V: Simd>(memory: &mut [V], dims: Dims, points: Stages<'_>, begin: usize, zero: V) -> usize {
    let Dims { nx, nu, np, .. } = dims;
    let filled = V::LANES.min(points.x.len() / nx - begin);
    let (x, rest) = memory.split_at_mut(nx);
    let (u, rest) = rest.split_at_mut(nu);
    for (to, from) in [(x, points.x), (u, points.u), (&mut rest[..np], points.p)] {
        let width = to.len();
        for (j, to) in to.iter_mut().enumerate() {
            *to = zero.generate(|lane| from[(begin + lane.min(filled - 1)) * width + j]);
        }
    }
    filled
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
        for (to, &x) in self.x.iter_mut().zip(&self.memory[..self.plant.dims.nx]) {
            *to = x;
        }
    }

    /// A substep of the state alone.
    #[inline(always)]
    fn substep(&mut self) {
        self.begin();
        let Self { plant, stages, zero, memory, x, .. } = self;
        for s in 0..stages.len() {
            let places = plant.rhs.values(memory);
            advance(stages, s, places, x, memory, *zero);
        }
    }

    /// A substep of the state and of its derivatives by the first `columns` variables.
    #[inline(always)]
    fn linearized_substep(&mut self, number: usize, columns: usize) {
        self.begin();
        let Self { plant, stages, zero, memory, x, entries, .. } = self;
        let (nx, count) = (plant.dims.nx, plant.rhs.pattern().entries());
        for s in 0..stages.len() {
            let (values, rest) = plant.rhs.linearize(memory).split_at(nx);
            for (to, &place) in entries[s * count..][..count].iter_mut().zip(rest) {
                *to = memory[usize::from(place)];
            }
            advance(stages, s, values, x, memory, *zero);
        }
        let Self { plant, entries, stages, sensitivities, zero, .. } = self;
        let pattern = plant.rhs.pattern();
        let substep = Substep { number, pattern, entries, stages };
        sensitivities.propagate(&substep, columns, *zero);
    }

    /// Writes the state with its derivatives to the points from `begin` on.
    #[inline(always)]
    fn store(&self, points: &mut Points<'_>, begin: usize, filled: usize, columns: usize) {
        let dims = self.plant.dims;
        for (i, &x) in self.memory.iter().enumerate().take(dims.nx) {
            let row = |lane: usize| (begin + lane) * dims.nx + i;
            scatter(x, filled, |lane, value| points.out.next[row(lane)] = value);
            for column in 0..columns {
                let derivatives = match &self.small {
                    Some(small) => small.get(i, column),
                    None => self.sensitivities.get(i, column),
                };
                scatter(derivatives, filled, |lane, derivative| {
                    points.set(dims, row(lane), column, derivative);
                });
            }
        }
    }
}

/// Gives each of the first `filled` lanes to `to`.
#[inline(always)]
fn scatter<V: Simd>(vector: V, filled: usize, mut to: impl FnMut(usize, f64)) {
    let mut lanes = [0.0; WIDEST];
    vector.write(&mut lanes);
    lanes.iter().enumerate().take(filled).for_each(|(lane, &value)| to(lane, value));
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
        load(&mut model.memory, model.plant.dims, at, 0, model.zero);
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
        let dims = model.plant.dims;
        let columns = points.columns(dims);
        for begin in (0..points.at.x.len() / dims.nx).step_by(V::LANES) {
            let filled = load(&mut model.memory, dims, points.at, begin, model.zero);
            let SparseRungeKutta { plant, stages, substeps, memory, zero, small, .. } = &mut *model;
            if let Some(small) = small {
                let (rhs, substeps, zero) = (&plant.rhs, *substeps, *zero);
                small.run(Steps { rhs, stages, substeps, memory, zero });
            } else {
                model.sensitivities.reset(model.zero);
                for number in 0..model.substeps {
                    model.linearized_substep(number, columns);
                }
            }
            model.store(&mut points, begin, filled, columns);
        }
    }
}

/// The outputs at one point.
struct Output<'a, F, V> {
    model: &'a mut SparseRungeKutta<F, V>,
    at: Stages<'a>,
    y: &'a mut [f64],
}

impl<F: SparseFunction, V: Simd> Work for Output<'_, F, V> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { model, at, y } = self;
        let memory = &mut model.outputs;
        let Some(function) = &model.plant.outputs else { return y.copy_from_slice(at.x) };
        load(memory, model.plant.dims, at, 0, model.zero);
        for (to, &place) in y.iter_mut().zip(function.values(memory)) {
            scatter(memory[usize::from(place)], 1, |_, value| *to = value);
        }
    }
}

/// The outputs at some points with their Jacobians.
struct LinearizeOutput<'a, F, V> {
    model: &'a mut SparseRungeKutta<F, V>,
    at: Stages<'a>,
    out: OutputLinearization<'a>,
}

impl<F: SparseFunction, V: Simd> Work for LinearizeOutput<'_, F, V> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { model, at, mut out } = self;
        let dims = model.plant.dims;
        for begin in (0..at.x.len() / dims.nx).step_by(V::LANES) {
            let memory = &mut model.outputs;
            let Some(function) = &model.plant.outputs else { return };
            let filled = load(memory, dims, at, begin, model.zero);
            let (values, entries) = function.linearize(memory).split_at(dims.ny);
            for (i, &value) in values.iter().enumerate() {
                let row = |lane: usize| (begin + lane) * dims.ny + i;
                scatter(memory[usize::from(value)], filled, |lane, value| out.y[row(lane)] = value);
                for entry in function.pattern().row(i) {
                    let column = function.pattern().places()[entry];
                    let derivative = memory[usize::from(entries[entry])];
                    scatter(derivative, filled, |lane, derivative| {
                        set_output(&mut out, dims, row(lane), column, derivative);
                    });
                }
            }
        }
    }
}

/// Writes the derivative of a row (counted through all points) in a column.
#[inline(always)]
fn set_output(
    out: &mut OutputLinearization<'_>,
    Dims { nx, nu, np, .. }: Dims,
    row: usize,
    column: usize,
    derivative: f64,
) {
    if column < nx {
        out.c[row * nx + column] = derivative;
    } else if column < nx + nu {
        out.d[row * nu + column - nx] = derivative;
    } else if !out.e.is_empty() {
        out.e[row * np + column - nx - nu] = derivative;
    }
}

impl<F: SparseFunction, V: Simd> Model for SparseRungeKutta<F, V> {
    fn dims(&self) -> Dims {
        self.plant.dims
    }

    fn sample_time_s(&self) -> f64 {
        self.sample_time_s
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        let at = Stages { x, u, p };
        assert!(at.count(self.plant.dims) == 1 && next.len() == x.len(), "one point");
        self.zero.vectorize(Step { model: self, at, next });
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        let dims = self.plant.dims;
        out.check(at.count(dims), dims);
        self.zero.vectorize(Linearize { model: self, points: Points { at, out } });
    }

    fn output(&mut self, x: &[f64], u: &[f64], p: &[f64], y: &mut [f64]) {
        let at = Stages { x, u, p };
        assert!(at.count(self.plant.dims) == 1 && y.len() == self.plant.dims.ny, "one point");
        self.zero.vectorize(Output { model: self, at, y });
    }

    fn linearize_output(&mut self, at: Stages<'_>, out: OutputLinearization<'_>) {
        let dims = self.plant.dims;
        out.check(at.count(dims), dims);
        let nx = dims.nx;
        for part in [&mut *out.c, &mut *out.d, &mut *out.e] {
            part.fill(0.0);
        }
        if self.plant.outputs.is_none() {
            out.y.copy_from_slice(at.x);
            for c in out.c.chunks_exact_mut(nx * nx) {
                c.iter_mut().step_by(nx + 1).for_each(|diagonal| *diagonal = 1.0);
            }
            return;
        }
        self.zero.vectorize(LinearizeOutput { model: self, at, out });
    }
}
