//! The Rosenbrock method RODAS with exact sensitivities through sparse Jacobians and their derivatives, as a
//! model.

use super::by_count::by_count;
use super::cotangents::Cotangents;
use super::elimination::Elimination;
use super::lanes::gather;
use super::model::{SparseModel, Stepper, checked_substep};
use super::tangents::{Substep, Tangents};
use super::{CurvedFunction, SparseFunction, SparsePlant};
use crate::Model;
use pinc_ad::simd::{Isa, Simd, Task};

/// Stages of the method.
pub(super) const STAGES: usize = 6;

pub(super) const GAMMA: f64 = 0.25;

/// `a_ij` of stages 2 to 6. The last stage starts from the solution of an embedded method of order
/// 3.
pub(super) const A: [[f64; 5]; 5] = [
    [1.544, 0.0, 0.0, 0.0, 0.0],
    [0.946_678_528_081_582_6, 0.255_701_169_898_328_4, 0.0, 0.0, 0.0],
    [3.314_825_187_068_521, 2.896_124_015_972_201, 0.998_641_913_997_781_7, 0.0, 0.0],
    [
        1.221_224_509_226_641,
        6.019_134_481_288_629,
        12.537_083_329_320_87,
        -0.687_886_036_105_895,
        0.0,
    ],
    [
        1.221_224_509_226_641,
        6.019_134_481_288_629,
        12.537_083_329_320_87,
        -0.687_886_036_105_895,
        1.0,
    ],
];

/// `c_ij` of stages 2 to 6.
pub(super) const C: [[f64; 5]; 5] = [
    [-5.6688, 0.0, 0.0, 0.0, 0.0],
    [-2.430_093_356_833_875, -0.206_359_915_709_191_5, 0.0, 0.0, 0.0],
    [-0.107_352_905_815_137_5, -9.594_562_251_023_355, -20.470_286_148_096_16, 0.0, 0.0],
    [
        7.496_443_313_967_647,
        -10.246_804_314_643_52,
        -33.999_903_528_199_05,
        11.708_908_932_061_6,
        0.0,
    ],
    [
        8.083_246_795_921_522,
        -7.981_132_988_064_893,
        -31.521_594_328_743_71,
        16.319_305_431_231_36,
        -6.058_818_238_834_054,
    ],
];

/// The Rosenbrock method RODAS over steps of `sample_time_s` seconds, each in `substeps` parts of
/// h = T / substeps, as a [`Model`]:
///
/// ```text
/// (I / (h gamma) - J) k_i = f(y_i, u, p) + sum_(j<i) c_ij k_j / h,    i = 1 .. 6
/// y_i = x + sum_(j<i) a_ij k_j,    J = df/dx(x, u, p),    gamma = 1/4
/// x+ = y_6 + k_6
/// ```
///
/// Each substep solves six linear systems with one matrix, where an implicit method would iterate
/// on a nonlinear one. It is L-stable: fast modes die out however long the step is, where an
/// explicit method needs h |lambda| < 3. Global error O(h^4), or less where a mode is much faster
/// than h. Reference: Hairer and Wanner, *Solving Ordinary Differential Equations II*, section IV.7
/// and table IV.7.2 (the form without products of J) and the code RODAS there.
///
/// The points of a horizon are in the lanes of the vectors of `isa`. The sensitivities differentiate
/// the method itself, exact to rounding: its equations, differentiated, are linear systems with the
/// same matrix, and with the second derivatives of f on the right.
///
/// # Panics
///
/// If `sample_time_s` is not positive and finite or `substeps` is 0, if the functions are not of
/// the size of the plant, or if the machine does not have the instruction set.
#[must_use]
pub fn sparse_rosenbrock<F: CurvedFunction, H: SparseFunction>(
    plant: SparsePlant<F, H>,
    sample_time_s: f64,
    substeps: usize,
    isa: Isa,
) -> Box<dyn Model> {
    let h = checked_substep(&plant, sample_time_s, substeps);
    by_count(Build { plant, h, sample_time_s, substeps }, isa)
}

#[derive(Clone)]
struct Build<F, H> {
    plant: SparsePlant<F, H>,
    h: f64,
    sample_time_s: f64,
    substeps: usize,
}

impl<F: CurvedFunction, H: SparseFunction> Task for Build<F, H> {
    type Output = Box<dyn Model>;

    fn run<V: Simd>(self, zero: V) -> Box<dyn Model> {
        let Self { plant: SparsePlant { dims, rhs, outputs }, h, sample_time_s, substeps } = self;
        let pattern = rhs.pattern();
        let stepper = Rosenbrock {
            nx: dims.nx,
            substeps,
            h,
            zero,
            memory: rhs.memory(zero),
            elimination: Elimination::new(pattern, zero),
            x: vec![zero; dims.nx],
            k: vec![[zero]; STAGES * dims.nx],
            entries: vec![zero; STAGES * pattern.entries()],
            tangents: Tangents::new(&rhs, zero),
            cotangents: Cotangents::new(pattern, substeps, zero),
            rhs,
        };
        Box::new(SparseModel::new((dims, outputs), sample_time_s, stepper, zero))
    }
}

/// The method, on one kind of vectors.
#[derive(Debug)]
struct Rosenbrock<F, V> {
    nx: usize,
    rhs: F,
    substeps: usize,
    h: f64,
    zero: V,
    /// The memory of f, with the stage's (x, u, p).
    memory: Vec<V>,
    elimination: Elimination<V>,
    /// The state at the beginning of a substep.
    x: Vec<V>,
    /// `k_i`, stage by stage.
    k: Vec<[V; 1]>,
    /// The entries of the Jacobian at each stage.
    entries: Vec<V>,
    tangents: Tangents<V>,
    cotangents: Cotangents<V>,
}

impl<F: CurvedFunction, V: Simd> Rosenbrock<F, V> {
    /// A substep of the state; with all that is needed of the derivatives of f, if they are asked
    /// for.
    #[inline(always)]
    fn substep(&mut self, linearized: bool) {
        let Self { nx, rhs, h, zero, memory, elimination, x, k, entries, tangents, .. } = self;
        let (nx, count) = (*nx, rhs.pattern().entries());
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

impl<F: CurvedFunction, V: Simd> Stepper<V> for Rosenbrock<F, V> {
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
            self.substep(false);
        }
    }

    #[inline(always)]
    fn linearize(&mut self, columns: usize) {
        self.tangents.reset(columns, self.zero);
        for _ in 0..self.substeps {
            self.substep(true);
            let Self { rhs, h, zero, elimination, k, entries, tangents, .. } = self;
            let (pattern, h, zero) = (rhs.pattern(), *h, *zero);
            tangents.propagate(columns, Substep { pattern, entries, k, elimination, h, zero });
        }
    }

    #[inline(always)]
    fn derivative(&self, state: usize, variable: usize) -> V {
        self.tangents.get(state, variable)
    }

    #[inline(always)]
    fn pull_back(&mut self, weights: impl Fn(usize) -> V, columns: usize) -> Option<&[V]> {
        let last = self.substeps - 1;
        for number in 0..self.substeps {
            self.cotangents.gradient.start(number).copy_from_slice(&self.memory[..self.nx]);
            if number < last {
                self.substep(false);
            }
        }
        self.cotangents.gradient.begin(weights, self.zero);
        for number in (0..self.substeps).rev() {
            self.memory[..self.nx].copy_from_slice(self.cotangents.gradient.start(number));
            self.substep(true);
            let Self { rhs, h, zero, elimination, k, entries, tangents, cotangents, .. } = self;
            let (pattern, h, zero) = (rhs.pattern(), *h, *zero);
            let substep = Substep { pattern, entries, k, elimination, h, zero };
            cotangents.pull_back(substep, (&tangents.curvatures, &tangents.second), columns);
        }
        Some(&self.cotangents.gradient.numbers)
    }
}
