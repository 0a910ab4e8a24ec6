//! The method RODAS with exact sensitivities through sparse Jacobians and their derivatives, as a
//! model.

use super::by_count::by_count;
use super::elimination::Elimination;
use super::lanes::{gather, load, scatter, store};
use super::outputs::Outputs;
use super::tangents::{Substep, Tangents};
use super::{CurvedFunction, SparseFunction, SparsePlant};
use crate::points::Points;
use crate::rodas4::{A, C, GAMMA};
use crate::{Dims, Linearization, Model, OutputLinearization, Stages};
use pinc_ad::simd::{Isa, Simd, Task, Work};

/// Stages of the method.
pub(super) const STAGES: usize = 6;

/// The method of [`Rodas4`](crate::Rodas4) over steps of `sample_time_s` seconds, each in
/// `substeps` parts, as a [`Model`].
///
/// The points of a horizon are in the lanes of the vectors of `isa`. The sensitivities are those of
/// the method itself, exact to rounding: its equations, differentiated, are linear systems with the
/// same matrix, and with the second derivatives of f on the right.
///
/// # Panics
///
/// If `sample_time_s` is not positive and finite or `substeps` is 0, if the functions are not of
/// the size of the plant, or if the machine does not have the instruction set.
#[must_use]
pub fn sparse_rodas4<F: CurvedFunction, H: SparseFunction>(
    plant: SparsePlant<F, H>,
    sample_time_s: f64,
    substeps: usize,
    isa: Isa,
) -> Box<dyn Model> {
    assert!(sample_time_s > 0.0 && sample_time_s.is_finite(), "the step must be positive");
    assert!(substeps > 0, "at least one substep");
    plant.check();
    by_count(Build { plant, sample_time_s, substeps }, isa)
}

#[derive(Clone)]
struct Build<F, H> {
    plant: SparsePlant<F, H>,
    sample_time_s: f64,
    substeps: usize,
}

impl<F: CurvedFunction, H: SparseFunction> Task for Build<F, H> {
    type Output = Box<dyn Model>;

    fn run<V: Simd>(self, zero: V) -> Box<dyn Model> {
        let Self { plant: SparsePlant { dims, rhs, outputs }, sample_time_s, substeps } = self;
        #[expect(clippy::cast_precision_loss, reason = "a number of substeps is far below 2^53")]
        let h = sample_time_s / substeps as f64;
        let pattern = rhs.pattern();
        Box::new(SparseRodas4 {
            dims,
            sample_time_s,
            substeps,
            h,
            zero,
            memory: rhs.memory(zero),
            elimination: Elimination::new(pattern, zero),
            x: vec![zero; dims.nx],
            k: vec![[zero]; STAGES * dims.nx],
            entries: vec![zero; STAGES * pattern.entries()],
            tangents: Tangents::new(&rhs, zero),
            outputs: Outputs::new(dims, outputs, zero),
            rhs,
        })
    }
}

/// The model, on one kind of vectors.
#[derive(Clone, Debug)]
struct SparseRodas4<F, H, V> {
    dims: Dims,
    rhs: F,
    sample_time_s: f64,
    substeps: usize,
    h: f64,
    zero: V,
    /// That of f, with the stage's (x, u, p).
    memory: Vec<V>,
    elimination: Elimination<V>,
    /// The state at the beginning of a substep.
    x: Vec<V>,
    /// `k_i`, stage by stage.
    k: Vec<[V; 1]>,
    /// The entries of the Jacobian at each stage.
    entries: Vec<V>,
    tangents: Tangents<V>,
    outputs: Outputs<H, V>,
}

impl<F: CurvedFunction, H: SparseFunction, V: Simd> SparseRodas4<F, H, V> {
    /// A substep of the state; with all that is needed of the derivatives of f, if they are asked
    /// for.
    #[inline(always)]
    fn substep(&mut self, linearized: bool) {
        let Self { dims, rhs, h, zero, memory, elimination, x, k, entries, tangents, .. } = self;
        let (nx, count) = (dims.nx, rhs.pattern().entries());
        x.copy_from_slice(&memory[..nx]);
        let (values, derivatives) =
            if linearized { rhs.curve(memory) } else { rhs.linearize(memory) }.split_at(nx);
        gather(&mut entries[..count], derivatives, memory);
        for (k, &value) in k.iter_mut().zip(values) {
            *k = [memory[usize::from(value)]];
        }
        if linearized {
            gather(&mut tangents.second, &derivatives[count..], memory);
        }
        elimination.factorize(rhs.pattern(), &entries[..count], 1.0 / (*h * GAMMA));
        elimination.solve(&mut k[..nx]);
        for stage in 1..STAGES {
            let (a, c) = (&A[stage - 1], &C[stage - 1]);
            let (known, rest) = k.split_at_mut(stage * nx);
            for (i, (to, &x)) in memory.iter_mut().zip(&*x).enumerate() {
                *to = combined(x, a, known, nx, i, *zero);
            }
            let values = if linearized {
                let (values, derivatives) = rhs.linearize(memory).split_at(nx);
                gather(&mut entries[stage * count..][..count], derivatives, memory);
                values
            } else {
                rhs.values(memory)
            };
            let scaled = c.map(|c| c / *h);
            for (i, &value) in values.iter().enumerate() {
                rest[i] = [combined(memory[usize::from(value)], &scaled, known, nx, i, *zero)];
            }
            elimination.solve(&mut rest[..nx]);
        }
        for (x, [k]) in memory.iter_mut().zip(&k[(STAGES - 1) * nx..]) {
            *x = *x + *k;
        }
    }
}

/// `from + factors_1 k_1 + factors_2 k_2 + ..` of state i.
#[inline(always)]
fn combined<V: Simd>(from: V, factors: &[f64; 5], k: &[[V; 1]], nx: usize, i: usize, zero: V) -> V {
    let mut sum = from;
    for (&factor, k) in factors.iter().zip(k.chunks_exact(nx)) {
        sum = k[i][0].mul_add(zero.constant(factor), sum);
    }
    sum
}

/// A step of one point.
struct Step<'a, F, H, V> {
    model: &'a mut SparseRodas4<F, H, V>,
    at: Stages<'a>,
    next: &'a mut [f64],
}

impl<F: CurvedFunction, H: SparseFunction, V: Simd> Work for Step<'_, F, H, V> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { model, at, next } = self;
        load(&mut model.memory, model.dims, at, 0, model.zero);
        for _ in 0..model.substeps {
            model.substep(false);
        }
        for (to, &x) in next.iter_mut().zip(&model.memory) {
            scatter(x, 1, |_, value| *to = value);
        }
    }
}

/// Steps of some points with their Jacobians.
struct Linearize<'a, F, H, V> {
    model: &'a mut SparseRodas4<F, H, V>,
    points: Points<'a>,
}

impl<F: CurvedFunction, H: SparseFunction, V: Simd> Work for Linearize<'_, F, H, V> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { model, mut points } = self;
        let dims = model.dims;
        let columns = points.columns(dims);
        for begin in (0..points.at.x.len() / dims.nx).step_by(V::LANES) {
            let filled = load(&mut model.memory, dims, points.at, begin, model.zero);
            model.tangents.reset(model.zero);
            for _ in 0..model.substeps {
                model.substep(true);
                let SparseRodas4 { rhs, h, zero, elimination, k, entries, tangents, .. } = model;
                let (pattern, h, zero) = (rhs.pattern(), *h, *zero);
                tangents.propagate(columns, Substep { pattern, entries, k, elimination, h, zero });
            }
            let (x, place) = (&model.memory[..dims.nx], (begin, filled, columns));
            store(&mut points, dims, x, place, |i, column| model.tangents.get(i, column));
        }
    }
}

impl<F: CurvedFunction, H: SparseFunction, V: Simd> Model for SparseRodas4<F, H, V> {
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
        out.check(at.count(self.dims), self.dims);
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
