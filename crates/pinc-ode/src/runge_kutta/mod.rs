//! Explicit Runge-Kutta methods with a fixed number of substeps, as models.

mod batched;
mod linearize;
mod method;

use crate::feedthrough::feedthrough;
use crate::outlined::Outlined;
use crate::output::OutputWorkspace;
use crate::points::Points;
use crate::{Dims, Linearization, Model, OutputLinearization, Plant, Stages};
use batched::{COLUMNS, COLUMNS_IF_LONG, LinearizeBatched, StepInVectors};
use linearize::Linearize;
pub use method::{Classical, DormandPrince, Method};
use method::{HeapWorkspace, StackWorkspace};
use pinc_ad::Dual;
use pinc_ad::simd::Isa;
use std::marker::PhantomData;

/// Plants with more states, inputs or parameters than this are integrated in memory; others in
/// registers and on the stack, which is several times faster.
const SMALL: usize = 6;

/// Directions that go through a plant in memory together.
const DIRECTIONS: usize = 4;

/// The classical Runge-Kutta method of order 4 with a fixed number of substeps.
pub type Rk4<P> = RungeKutta<P, Classical>;

/// The method of order 5 of Dormand and Prince with a fixed number of substeps.
pub type Rk5<P> = RungeKutta<P, DormandPrince>;

/// An explicit Runge-Kutta method with a fixed number of substeps h = T / substeps, as a [`Model`].
/// The tableaus are with [`Classical`] and [`DormandPrince`].
///
/// The Jacobians are those of the method itself, exact to rounding, by dual numbers through it. All
/// columns go through it together, in the lanes of the machine's widest vectors. In
/// [`Model::linearize`] two points do so side by side or, for plants with few columns or a long
/// equation ([`Plant::LONG`]), the lanes are points. Large plants, and machines without such
/// vectors, take one point at a time.
#[derive(Clone, Debug)]
pub struct RungeKutta<P, M> {
    plant: P,
    dims: Dims,
    sample_time_s: f64,
    substeps: usize,
    isa: Isa,
    /// Vectors of half as many lanes, or the same where there are none.
    narrow: Isa,
    heap: Option<HeapWorkspaces<P>>,
    outputs: OutputWorkspace,
    method: PhantomData<M>,
}

/// Numbers of a plant that is not small, or of any plant where the machine has no vectors.
#[derive(Clone, Debug)]
struct HeapWorkspaces<P> {
    plant: Outlined<P>,
    values: HeapWorkspace<f64>,
    tangents: HeapWorkspace<Dual<f64, DIRECTIONS>>,
}

impl<P: Plant, M: Method> RungeKutta<P, M> {
    /// The method over steps of `sample_time_s` seconds, each in `substeps` parts.
    ///
    /// # Panics
    ///
    /// If `sample_time_s` is not positive and finite or `substeps` is 0, or if the plant does not
    /// have the columns that [`Plant::COLUMNS`] says.
    #[must_use]
    pub fn new(plant: P, sample_time_s: f64, substeps: usize) -> Self {
        assert!(sample_time_s > 0.0 && sample_time_s.is_finite(), "the step must be positive");
        assert!(substeps > 0, "at least one substep");
        let dims = plant.dims();
        let columns = P::COLUMNS.is_none_or(|columns| (columns, 0) == (dims.nx + dims.nu, dims.np));
        assert!(columns, "the plant has other columns than it says");
        let isa = Isa::detect();
        let narrow = if Isa::available().contains(&Isa::Avx2) { Isa::Avx2 } else { isa };
        let large = dims.nx.max(dims.nu).max(dims.np) > SMALL;
        let heap = (large || isa == Isa::Portable).then(|| HeapWorkspaces {
            plant: Outlined(plant.clone()),
            values: HeapWorkspace::new(dims, 0.0),
            tangents: HeapWorkspace::new(dims, Dual::lift(0.0)),
        });
        Self {
            plant,
            dims,
            sample_time_s,
            substeps,
            isa,
            narrow,
            heap,
            outputs: OutputWorkspace::new(dims),
            method: PhantomData,
        }
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

    /// Linearizes `C` points of a small plant, side by side.
    fn linearize_side_by_side<const C: usize>(&mut self, points: Points<'_>) {
        let h = self.h();
        let Self { plant, substeps, isa, .. } = self;
        isa.dispatch_vectors(Linearize::<P, M, C> {
            plant,
            h,
            substeps: *substeps,
            points,
            method: PhantomData,
        });
    }

    /// Linearizes any number of points of a plant with `N` columns at most.
    fn linearize_batched<const N: usize>(&mut self, isa: Isa, points: Points<'_>) {
        let h = self.h();
        let Self { plant, substeps, .. } = self;
        isa.dispatch_vectors(LinearizeBatched::<P, M, N> {
            plant,
            h,
            substeps: *substeps,
            points,
            method: PhantomData,
        });
    }

    /// Linearizes any number of points of a plant with a long equation and `N` columns at most:
    /// what is left over when vectors are filled goes into narrower ones, if these suffice.
    fn linearize_long<const N: usize>(&mut self, points: Points<'_>) {
        let count = points.at.count(self.dims);
        let rest = count % self.isa.lanes();
        let whole = if rest <= self.narrow.lanes() { count - rest } else { count };
        let (whole, rest) = points.split(self.dims, whole);
        for (isa, points) in [(self.isa, whole), (self.narrow, rest)] {
            if !points.at.x.is_empty() {
                self.linearize_batched::<N>(isa, points);
            }
        }
    }

    /// Linearizes any number of points of a small plant, two and two.
    fn linearize_in_pairs(&mut self, mut points: Points<'_>) {
        let count = points.at.count(self.dims);
        for _ in 0..count / 2 {
            let (pair, rest) = points.split(self.dims, 2);
            points = rest;
            self.linearize_side_by_side::<2>(pair);
        }
        if count % 2 == 1 {
            self.linearize_side_by_side::<1>(points);
        }
    }

    /// Linearizes one point in memory, some directions at a time.
    fn linearize_on_heap(&mut self, mut points: Points<'_>) {
        let (h, dims) = (self.h(), self.dims);
        let Some(heap) = &mut self.heap else { return };
        let (at, columns) = (points.at, points.columns(dims));
        for first in (0..columns).step_by(DIRECTIONS) {
            let mut work = heap.tangents.workspace();
            let variables = work.x.iter_mut().chain(&mut *work.u).chain(&mut *work.p);
            let values = at.x.iter().chain(at.u).chain(at.p);
            for (j, (to, &value)) in variables.zip(values).enumerate() {
                *to = Dual::variable(value, j.checked_sub(first).unwrap_or(DIRECTIONS));
            }
            work.run::<Outlined<P>, M>(&heap.plant, h, self.substeps);
            for (i, result) in work.x.iter().enumerate() {
                points.out.next[i] = result.re;
                for (column, &derivative) in (first..columns).zip(&result.eps) {
                    points.set(dims, i, column, derivative);
                }
            }
        }
    }
}

/// How the points of a small plant are linearized in vectors.
#[derive(Clone, Copy, Debug)]
enum Way {
    /// Few columns: points in the lanes.
    Batched,
    /// A long equation: points in the lanes, few columns.
    Long,
    /// The same with more columns.
    LongAndWide,
    /// Columns in the lanes, two points side by side.
    InPairs,
}

impl Way {
    const fn of(long: bool, columns: usize) -> Self {
        if columns <= COLUMNS {
            Self::Batched
        } else if long && columns <= COLUMNS_IF_LONG[0] {
            Self::Long
        } else if long && columns <= COLUMNS_IF_LONG[1] {
            Self::LongAndWide
        } else {
            Self::InPairs
        }
    }

    /// Whether some number of columns of the plant leads here.
    const fn is_possible<P: Plant>(self) -> bool {
        match P::COLUMNS {
            Some(columns) => self as usize == Self::of(P::LONG, columns) as usize,
            None => P::LONG || matches!(self, Self::Batched | Self::InPairs),
        }
    }
}

impl<P: Plant, M: Method> Model for RungeKutta<P, M> {
    fn dims(&self) -> Dims {
        self.dims
    }

    fn sample_time_s(&self) -> f64 {
        self.sample_time_s
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        let h = self.h();
        let (plant, substeps, at) = (&self.plant, self.substeps, (x, u, p));
        match &mut self.heap {
            Some(heap) => {
                let HeapWorkspaces { plant, values, .. } = heap;
                values.workspace().predict::<Outlined<P>, M>(plant, h, substeps, at, next);
            }
            None if const { P::LONG } => {
                self.isa.dispatch_narrow(StepInVectors::<P, M> {
                    plant,
                    h,
                    substeps,
                    at,
                    next,
                    method: PhantomData,
                });
            }
            None => {
                let mut workspace = StackWorkspace::new(0.0);
                let mut work = workspace.workspace(plant.dims());
                work.predict::<P, M>(plant, h, substeps, at, next);
            }
        }
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        let count = at.count(self.dims);
        out.check(count, self.dims);
        let mut points = Points { at, out };
        if self.heap.is_some() {
            for _ in 0..count {
                let (point, rest) = points.split(self.dims, 1);
                points = rest;
                self.linearize_on_heap(point);
            }
            return;
        }
        // What is impossible for a plant is not compiled.
        match Way::of(P::LONG, points.columns(self.dims)) {
            Way::Batched if const { Way::Batched.is_possible::<P>() } => {
                self.linearize_batched::<COLUMNS>(self.isa, points);
            }
            Way::Long if const { Way::Long.is_possible::<P>() } => {
                self.linearize_long::<{ COLUMNS_IF_LONG[0] }>(points);
            }
            Way::LongAndWide if const { Way::LongAndWide.is_possible::<P>() } => {
                self.linearize_long::<{ COLUMNS_IF_LONG[1] }>(points);
            }
            Way::InPairs if const { Way::InPairs.is_possible::<P>() } => {
                self.linearize_in_pairs(points);
            }
            way => unreachable!("{way:?}: a plant has the columns that it says"),
        }
    }

    fn output(&mut self, x: &[f64], u: &[f64], p: &[f64], y: &mut [f64]) {
        self.plant.output(x, u, p, y);
    }

    fn feedthrough(&self) -> Vec<bool> {
        feedthrough(&self.plant)
    }

    fn linearize_output(&mut self, at: Stages<'_>, out: OutputLinearization<'_>) {
        self.outputs.linearize(&self.plant, at, out);
    }
}
