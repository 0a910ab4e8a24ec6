//! Explicit Runge-Kutta methods with a fixed number of substeps, as models.

mod batched;
mod linearize;
mod method;

use crate::feedthrough::feedthrough;
use crate::output::OutputWorkspace;
use crate::points::Points;
use crate::{Dims, Linearization, Model, OutputLinearization, Plant, Stages};
use batched::{LinearizeBatched, StepInVectors};
use linearize::Linearize;
use method::StackWorkspace;
pub use method::{Classical, DormandPrince, Method};
use pinc_ad::simd::Isa;
use std::marker::PhantomData;

/// The most states, inputs or parameters of a plant whose numbers are in registers and on the
/// stack.
const SMALL: usize = 6;

/// The most columns with which a plant's points are in the lanes of vectors. With more, each root
/// and quotient would be a longer chain of vectors than when the columns are in the lanes.
const FEW: usize = 3;

/// Columns at a time of a plant with a long equation ([`Plant::LONG`]), whose points are always in
/// the lanes: of few columns, and of more.
const FEW_IF_LONG: usize = 4;
const MANY_IF_LONG: usize = 8;

/// The classical Runge-Kutta method of order 4 with a fixed number of substeps.
pub type Rk4<P> = RungeKutta<P, Classical>;

/// The method of order 5 of Dormand and Prince with a fixed number of substeps.
pub type Rk5<P> = RungeKutta<P, DormandPrince>;

/// An explicit Runge-Kutta method with a fixed number of substeps h = T / substeps, as a [`Model`]
/// of a small plant ([`RungeKutta::suits`]), compiled for its equation. The tableaus are with
/// [`Classical`] and [`DormandPrince`].
///
/// The Jacobians differentiate the method itself, exact to rounding, by dual numbers through it. All
/// columns go through it together, in the lanes of the machine's widest vectors, for two points
/// side by side; of plants with few columns or a long equation ([`Plant::LONG`]) the lanes are
/// points.
#[derive(Clone, Debug)]
pub struct RungeKutta<P, M> {
    plant: P,
    dims: Dims,
    sample_time_s: f64,
    substeps: usize,
    isa: Isa,
    /// Vectors of half as many lanes, or the same where there are none.
    narrow: Isa,
    outputs: OutputWorkspace,
    method: PhantomData<M>,
}

impl<P: Plant, M: Method> RungeKutta<P, M> {
    /// The method over steps of `sample_time_s` seconds, each in `substeps` parts.
    ///
    /// # Panics
    ///
    /// If `sample_time_s` is not positive and finite or `substeps` is 0, or if the plant is too
    /// large ([`RungeKutta::suits`]).
    #[must_use]
    pub fn new(plant: P, sample_time_s: f64, substeps: usize) -> Self {
        assert!(sample_time_s > 0.0 && sample_time_s.is_finite(), "the step must be positive");
        assert!(substeps > 0, "at least one substep");
        assert!(Self::suits(&plant), "at most {SMALL} states, {SMALL} inputs, {SMALL} parameters");
        let dims = plant.dims();
        let columns = (dims.np == 0).then_some(dims.nx + dims.nu);
        assert!(P::COLUMNS.is_none() || P::COLUMNS == columns, "as many columns as the type says");
        let (isa, outputs) = (Isa::detect(), OutputWorkspace::new(dims));
        let narrow = if Isa::available().contains(&Isa::Avx2) { Isa::Avx2 } else { isa };
        Self { plant, dims, sample_time_s, substeps, isa, narrow, outputs, method: PhantomData }
    }

    /// Whether the plant is small enough: it has at most six states, six inputs and six parameters.
    /// Those that are larger go through [`DynPlant::model`](crate::DynPlant::model).
    #[must_use]
    pub fn suits(plant: &P) -> bool {
        let Dims { nx, nu, np, .. } = plant.dims();
        nx.max(nu).max(np) <= SMALL
    }

    /// The most columns of a Jacobian that are few.
    const FEW_COLUMNS: usize = if P::LONG { FEW_IF_LONG } else { FEW };

    /// Whether there may be few columns, and whether more, by what the plant's type says.
    const MAY_BE: [bool; 2] = match P::COLUMNS {
        Some(columns) => [columns <= Self::FEW_COLUMNS, columns > Self::FEW_COLUMNS],
        None => [true; 2],
    };

    /// The number of substeps a step is divided into.
    #[must_use]
    pub fn substeps(&self) -> usize {
        self.substeps
    }

    /// The step of the method, in s.
    fn h(&self) -> f64 {
        self.sample_time_s / self.substeps as f64
    }

    /// Linearizes any number of points in the lanes of vectors, `N` columns at a time: what is left
    /// over when vectors are filled goes into narrower ones, if these suffice.
    fn linearize_batched<const N: usize>(&mut self, points: Points<'_>) {
        let count = points.at.count(self.dims);
        let rest = count % self.isa.lanes();
        let whole = if rest <= self.narrow.lanes() { count - rest } else { count };
        let (whole, rest) = points.split(self.dims, whole);
        let (h, substeps, method) = (self.h(), self.substeps, self.method);
        for (isa, points) in [(self.isa, whole), (self.narrow, rest)] {
            if !points.at.x.is_empty() {
                let plant = &self.plant;
                isa.dispatch(LinearizeBatched::<P, M, N> { plant, h, substeps, points, method });
            }
        }
    }

    /// Linearizes any number of points with columns in the lanes, two and two.
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

    fn linearize_side_by_side<const C: usize>(&mut self, points: Points<'_>) {
        let (h, substeps, method) = (self.h(), self.substeps, self.method);
        let plant = &self.plant;
        self.isa.dispatch(Linearize::<P, M, C> { plant, h, substeps, points, method });
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
        let (h, substeps, method, at) = (self.h(), self.substeps, self.method, (x, u, p));
        let plant = &self.plant;
        if const { P::LONG } {
            self.narrow.dispatch(StepInVectors::<P, M> { plant, h, substeps, at, next, method });
        } else {
            let mut workspace = StackWorkspace::new(0.0);
            workspace.workspace(plant.dims()).predict::<P, M>(plant, h, substeps, at, next);
        }
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        out.check(at.count(self.dims), self.dims);
        let points = Points { at, out };
        let are_few = points.columns(self.plant.dims()) <= Self::FEW_COLUMNS;
        // Constants, so that what is never called is not compiled.
        if const { P::LONG && Self::MAY_BE[0] } && are_few {
            self.linearize_batched::<FEW_IF_LONG>(points);
        } else if const { P::LONG && Self::MAY_BE[1] } {
            self.linearize_batched::<MANY_IF_LONG>(points);
        } else if const { !P::LONG && Self::MAY_BE[0] } && are_few {
            self.linearize_batched::<FEW>(points);
        } else if const { !P::LONG && Self::MAY_BE[1] } {
            self.linearize_in_pairs(points);
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
