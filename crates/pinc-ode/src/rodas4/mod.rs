//! A linearly implicit Runge-Kutta method, for stiff plants.

pub(crate) mod lu;
mod stages;

use crate::feedthrough::feedthrough;
use crate::outlined::Outlined;
use crate::output::OutputWorkspace;
use crate::points::Points;
use crate::{Dims, Linearization, Model, OutputLinearization, Plant, Stages};
use lu::Pivot;
use pinc_ad::simd::{Isa, Simd, Task, Work};
use pinc_ad::{Dual, Lanes};
pub(crate) use stages::{A, C, GAMMA};
use stages::{Rates, RatesIn, Workspace};

/// Lanes of the widest vectors.
const WIDE: usize = 8;

/// Lanes of all others.
const NARROW: usize = 4;

/// The Rosenbrock method RODAS with a fixed number of substeps h = T / substeps, as a [`Model`]:
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
/// than h.
///
/// The Jacobians are those of the method itself, exact to rounding, by dual numbers through it,
/// second derivatives of f included. Reference: Hairer and Wanner, *Solving Ordinary Differential
/// Equations II*, section IV.7 and table IV.7.2 (the form without products of J) and the code RODAS
/// there.
#[derive(Clone, Debug)]
pub struct Rodas4<P> {
    plant: Outlined<P>,
    dims: Dims,
    sample_time_s: f64,
    substeps: usize,
    isa: Isa,
    value: Workspace<f64>,
    tangents: Tangents,
    outputs: OutputWorkspace,
}

impl<P: Plant> Rodas4<P> {
    /// The method over steps of `sample_time_s` seconds, each in `substeps` parts.
    ///
    /// # Panics
    ///
    /// If `sample_time_s` is not positive and finite or `substeps` is 0.
    #[must_use]
    pub fn new(plant: P, sample_time_s: f64, substeps: usize) -> Self {
        assert!(sample_time_s > 0.0 && sample_time_s.is_finite(), "the step must be positive");
        assert!(substeps > 0, "at least one substep");
        let dims = plant.dims();
        let value = Workspace::new(dims, 0.0);
        let (isa, outputs) = (Isa::detect(), OutputWorkspace::new(dims));
        let tangents = Tangents::new(dims, isa);
        let plant = Outlined(plant);
        Self { plant, dims, sample_time_s, substeps, isa, value, tangents, outputs }
    }

    /// The number of substeps a step is divided into.
    #[must_use]
    pub fn substeps(&self) -> usize {
        self.substeps
    }

    /// The step of the method, in s.
    #[expect(clippy::cast_precision_loss, reason = "a number of substeps is far below 2^53")]
    fn h(&self) -> f64 {
        self.sample_time_s / self.substeps as f64
    }
}

/// The numbers of a linearization: as many directions of differentiation go through the method
/// together as a vector of the instruction set has lanes.
#[derive(Clone, Debug)]
enum Tangents {
    Wide(Workspace<Dual<f64, WIDE>>),
    Narrow(Workspace<Dual<f64, NARROW>>),
}

impl Tangents {
    fn new(dims: Dims, isa: Isa) -> Self {
        if isa.lanes() == WIDE {
            Self::Wide(Workspace::new(dims, Dual::lift(0.0)))
        } else {
            Self::Narrow(Workspace::new(dims, Dual::lift(0.0)))
        }
    }
}

/// A step in a workspace, compiled for the instruction set at hand.
struct Step<'a, P> {
    plant: &'a P,
    h: f64,
    substeps: usize,
    work: &'a mut Workspace<f64>,
}

impl<P: Plant> Task for Step<'_, P> {
    type Output = ();

    #[inline(always)]
    fn run<V: Simd>(self, zero: V) {
        let Self { plant, h, substeps, work } = self;
        advance(zero, Substeps { rhs: &RatesIn { plant, vector: zero }, h, substeps, work });
    }
}

/// A step from one point with its Jacobians.
struct Linearize<'a, P> {
    plant: &'a P,
    h: f64,
    substeps: usize,
    point: Points<'a>,
    tangents: &'a mut Tangents,
}

impl<P: Plant> Task for Linearize<'_, P> {
    type Output = ();

    #[inline(always)]
    fn run<V: Simd>(self, zero: V) {
        let Self { plant, h, substeps, point, tangents } = self;
        let (dims, rhs) = (plant.dims(), RatesIn { plant, vector: zero });
        // Compiled for the one number of lanes only.
        if const { V::LANES == WIDE } {
            if let Tangents::Wide(work) = tangents {
                linearize(zero, dims, Substeps { rhs: &rhs, h, substeps, work }, point);
            }
        } else if let Tangents::Narrow(work) = tangents {
            linearize(zero, dims, Substeps { rhs: &rhs, h, substeps, work }, point);
        }
    }
}

/// The substeps of a step of any plant.
struct Substeps<'a, S> {
    rhs: &'a dyn Rates<S>,
    h: f64,
    substeps: usize,
    work: &'a mut Workspace<S>,
}

impl<S: Pivot> Work for Substeps<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for _ in 0..self.substeps {
            self.work.step(self.rhs, self.h);
        }
    }
}

/// The vector of code for any machine.
fn portable() -> Lanes<NARROW> {
    Lanes::splat(0.0)
}

/// Not inlined, so that this is compiled once for all plants.
#[inline(never)]
fn advance<V: Simd, S: Pivot>(vector: V, substeps: Substeps<'_, S>) {
    vector.vectorize(substeps);
}

#[inline(never)]
fn linearize<V: Simd, const N: usize>(
    vector: V,
    dims: Dims,
    all: Substeps<'_, Dual<f64, N>>,
    mut point: Points<'_>,
) {
    let (at, columns) = (point.at, point.columns(dims));
    let Substeps { rhs, h, substeps, work } = all;
    for first in (0..columns).step_by(N) {
        let variables = work.x.iter_mut().chain(&mut work.u).chain(&mut work.p);
        let values = at.x.iter().chain(at.u).chain(at.p);
        for (j, (to, &value)) in variables.zip(values).enumerate() {
            *to = Dual::variable(value, j.checked_sub(first).unwrap_or(N));
        }
        vector.vectorize(Substeps { rhs, h, substeps, work });
        for (i, result) in work.x.iter().enumerate() {
            point.out.next[i] = result.re;
            for (column, &derivative) in (first..columns).zip(&result.eps) {
                point.set(dims, i, column, derivative);
            }
        }
    }
}

impl<P: Plant> Model for Rodas4<P> {
    fn dims(&self) -> Dims {
        self.dims
    }

    fn sample_time_s(&self) -> f64 {
        self.sample_time_s
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        let h = self.h();
        let Self { plant, substeps, isa, value: work, .. } = self;
        work.x.copy_from_slice(x);
        work.u.copy_from_slice(u);
        work.p.copy_from_slice(p);
        let substeps = *substeps;
        match isa {
            Isa::Portable => {
                advance(portable(), Substeps { rhs: plant, h, substeps, work });
            }
            vectors => vectors.dispatch_narrow(Step { plant: &plant.0, h, substeps, work }),
        }
        next.copy_from_slice(&work.x);
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        let count = at.count(self.dims);
        out.check(count, self.dims);
        let (h, dims, substeps) = (self.h(), self.dims, self.substeps);
        let mut points = Points { at, out };
        for _ in 0..count {
            let (point, rest) = points.split(dims, 1);
            points = rest;
            let Self { plant, isa, tangents, .. } = self;
            match (*isa, tangents) {
                (Isa::Portable, Tangents::Narrow(work)) => {
                    linearize(portable(), dims, Substeps { rhs: plant, h, substeps, work }, point);
                }
                (vectors, tangents) => {
                    let plant = &plant.0;
                    vectors.dispatch_vectors(Linearize { plant, h, substeps, point, tangents });
                }
            }
        }
    }

    fn output(&mut self, x: &[f64], u: &[f64], p: &[f64], y: &mut [f64]) {
        self.plant.0.output(x, u, p, y);
    }

    fn feedthrough(&self) -> Vec<bool> {
        feedthrough(&self.plant.0)
    }

    fn linearize_output(&mut self, at: Stages<'_>, out: OutputLinearization<'_>) {
        self.outputs.linearize(&self.plant.0, at, out);
    }
}
