//! Plants whose type is erased: what is compiled once per plant, and all else once.

use crate::black_box::NoEquation;
use crate::{BlackBox, Dims, Integrator, Model, OdeError, Plant, Variable};
use pinc_ad::simd::{Isa, Simd, Task, Work};
use pinc_ad::{Dual, Scalar};
use std::any::Any;
use std::fmt::{self, Debug};
use std::sync::Arc;

/// Directional derivatives of a [`VectorDual`].
pub const VECTOR_DIRECTIONS: usize = 4;

/// A vector of values with some directional derivatives, on which [`VectorRhs`] evaluates an
/// equation.
pub type VectorDual<V> = Dual<V, VECTOR_DIRECTIONS>;

/// The variables of a plant, each kind in order.
#[derive(Clone, Copy, Debug)]
pub struct Signature<'a> {
    /// The states.
    pub states: &'a [Variable],
    /// The inputs.
    pub inputs: &'a [Variable],
    /// The parameters that may change from call to call.
    pub parameters: &'a [Variable],
    /// The outputs.
    pub outputs: &'a [Variable],
}

/// The right-hand side of a [`Plant`] with its type erased: what training, integration and analysis
/// ask of a plant.
///
/// Every plant has it. Functions that take `&dyn DynRhs` are called with `&plant`.
pub trait DynRhs: Debug + Send + Sync {
    /// The variables that the equation is about.
    fn signature(&self) -> Signature<'_>;

    /// The sizes.
    fn dims(&self) -> Dims {
        let Signature { states, inputs, parameters, outputs } = self.signature();
        let dims = Dims::new(states.len(), inputs.len());
        dims.with_parameters(parameters.len()).with_outputs(outputs.len())
    }

    /// The states, in order.
    fn states(&self) -> &[Variable] {
        self.signature().states
    }

    /// The inputs, in order.
    fn inputs(&self) -> &[Variable] {
        self.signature().inputs
    }

    /// The parameters that may change from call to call, in order.
    fn parameters(&self) -> &[Variable] {
        self.signature().parameters
    }

    /// The outputs, in order.
    fn outputs(&self) -> &[Variable] {
        self.signature().outputs
    }

    /// Writes f(x, u, p) into `dx`.
    ///
    /// # Shapes
    ///
    /// `x`, `dx`: `nx`; `u`: `nu`; `p`: `np`.
    fn rhs(&self, x: &[f64], u: &[f64], p: &[f64], dx: &mut [f64]);

    /// Writes h(x, u, p) into `y` (`ny`).
    fn output(&self, x: &[f64], u: &[f64], p: &[f64], y: &mut [f64]);

    /// Why f(x, u, p) is not finite there, in words, where the plant knows.
    fn explain(&self, x: &[f64], u: &[f64], p: &[f64]) -> Option<String>;

    /// df/d(x, u, p), shape `[nx, nx + nu + np]`, row by row.
    fn jacobian(&self, x: &[f64], u: &[f64], p: &[f64]) -> Vec<f64>;

    /// Writes f into `dx` and its derivative along a direction of (x, u, p) into `slope` (`nx`).
    fn rhs_along(&self, at: [&[f64]; 3], along: [&[f64]; 3], dx: &mut [f64], slope: &mut [f64]) {
        let [x, u, p] = at;
        self.rhs(x, u, p, dx);
        let (jacobian, along) = (self.jacobian(x, u, p), along.concat());
        for (slope, row) in slope.iter_mut().zip(jacobian.chunks_exact(along.len())) {
            *slope = row.iter().zip(&along).map(|(a, b)| a * b).sum();
        }
    }

    /// The right-hand side on the vectors of an instruction set.
    fn vectorized(&self, isa: Isa) -> AnyVectorRhs;

    /// An owned copy.
    fn to_shared(&self) -> Arc<dyn DynRhs>;

    /// The plant as one without an equation, if it is that.
    fn black_box(&self) -> Option<&BlackBox> {
        None
    }
}

/// Writes f(x, u, p) into `dx`. Not inlined, so that the equation is compiled once for each kind of
/// number.
#[inline(never)]
fn evaluate<P: Plant, S: Scalar>(plant: &P, x: &[S], u: &[S], p: &[S], dx: &mut [S]) {
    plant.rhs(x, u, p, dx);
}

impl<P: Plant> DynRhs for P {
    fn signature(&self) -> Signature<'_> {
        Signature {
            states: Plant::states(self),
            inputs: Plant::inputs(self),
            parameters: Plant::parameters(self),
            outputs: Plant::outputs(self),
        }
    }

    fn rhs(&self, x: &[f64], u: &[f64], p: &[f64], dx: &mut [f64]) {
        evaluate(self, x, u, p, dx);
    }

    fn output(&self, x: &[f64], u: &[f64], p: &[f64], y: &mut [f64]) {
        Plant::output(self, x, u, p, y);
    }

    fn explain(&self, x: &[f64], u: &[f64], p: &[f64]) -> Option<String> {
        Plant::explain(self, x, u, p)
    }

    fn jacobian(&self, x: &[f64], u: &[f64], p: &[f64]) -> Vec<f64> {
        let (nx, nu, all) = (x.len(), u.len(), [x, u, p].concat());
        let f = |v: &[Dual<f64, VECTOR_DIRECTIONS>], dx: &mut [Dual<f64, VECTOR_DIRECTIONS>]| {
            let (x, rest) = v.split_at(nx);
            let (u, p) = rest.split_at(nu);
            evaluate(self, x, u, p, dx);
        };
        let mut jacobian = vec![0.0; nx * all.len()];
        let mut dx = vec![Dual::lift(0.0); nx];
        for first in (0..all.len()).step_by(VECTOR_DIRECTIONS) {
            let seed = |(j, &value): (usize, &f64)| {
                Dual::variable(value, j.checked_sub(first).unwrap_or(VECTOR_DIRECTIONS))
            };
            let v: Vec<_> = all.iter().enumerate().map(seed).collect();
            f(&v, &mut dx);
            for (row, dx) in jacobian.chunks_exact_mut(all.len()).zip(&dx) {
                for (to, derivative) in row[first..].iter_mut().zip(dx.eps) {
                    *to = derivative;
                }
            }
        }
        jacobian
    }

    fn rhs_along(&self, at: [&[f64]; 3], along: [&[f64]; 3], dx: &mut [f64], slope: &mut [f64]) {
        // As many directions as the Jacobian takes at a time: the equation is compiled for these.
        let [x, u, p] = [0, 1, 2].map(|part| {
            let dual = |(&value, &along): (&f64, &f64)| {
                let mut dual = Dual::<f64, VECTOR_DIRECTIONS>::lift(value);
                dual.eps[0] = along;
                dual
            };
            at[part].iter().zip(along[part]).map(dual).collect::<Vec<_>>()
        });
        let mut both = vec![Dual::lift(0.0); x.len()];
        evaluate(self, &x, &u, &p, &mut both);
        for ((dx, slope), both) in dx.iter_mut().zip(slope).zip(both) {
            (*dx, *slope) = (both.re, both.eps[0]);
        }
    }

    fn vectorized(&self, isa: Isa) -> AnyVectorRhs {
        isa.dispatch(Erase { plant: self })
    }

    fn to_shared(&self) -> Arc<dyn DynRhs> {
        Arc::new(self.clone())
    }
}

/// A plant with its type erased, with the integrators that can serve as models of it. The
/// Runge-Kutta methods have the equation of a plant in Rust compiled into them, which takes most of
/// a build: ask for [`DynRhs`] where that is enough.
pub trait DynPlant: DynRhs {
    /// The integrator over steps of `sample_time_s` seconds, each in `substeps` parts.
    ///
    /// # Errors
    ///
    /// [`OdeError::NoModel`] if it cannot be made of this plant.
    fn model(
        &self,
        integrator: Integrator,
        sample_time_s: f64,
        substeps: usize,
    ) -> Result<Box<dyn Model>, OdeError>;
}

/// f(x, u, p) on vectors of points. A training kernel calls it once for a vector, so that the call
/// through a table costs nothing that could be measured.
pub trait VectorRhs<V>: Debug + Send + Sync {
    /// Writes f(x, u, p) into `dx`.
    fn rhs(
        &self,
        x: &[VectorDual<V>],
        u: &[VectorDual<V>],
        p: &[VectorDual<V>],
        dx: &mut [VectorDual<V>],
    );
}

impl<V: Simd, P: Plant> VectorRhs<V> for P {
    fn rhs(
        &self,
        x: &[VectorDual<V>],
        u: &[VectorDual<V>],
        p: &[VectorDual<V>],
        dx: &mut [VectorDual<V>],
    ) {
        let vector = x[0].re;
        vector.vectorize(Evaluation { plant: self, x, u, p, dx });
    }
}

struct Evaluation<'a, V, P> {
    plant: &'a P,
    x: &'a [VectorDual<V>],
    u: &'a [VectorDual<V>],
    p: &'a [VectorDual<V>],
    dx: &'a mut [VectorDual<V>],
}

impl<V: Simd, P: Plant> Work for Evaluation<'_, V, P> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.plant.rhs(self.x, self.u, self.p, self.dx);
    }
}

/// A [`VectorRhs`] on the vectors of one instruction set, with the type of these erased too.
pub struct AnyVectorRhs(Box<dyn Any>);

impl Debug for AnyVectorRhs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("AnyVectorRhs").finish_non_exhaustive()
    }
}

impl AnyVectorRhs {
    pub(crate) fn of<V: Simd>(rhs: Box<dyn VectorRhs<V>>) -> Self {
        Self(Box::new(rhs))
    }

    /// Returns the table of a plant whose equation cannot be seen: every value is NaN.
    #[must_use]
    pub fn none(isa: Isa) -> Self {
        isa.dispatch(EraseNone)
    }

    /// The right-hand side on vectors `V`.
    ///
    /// # Panics
    ///
    /// If it was made for another instruction set than theirs.
    #[must_use]
    pub fn on<V: Simd>(self) -> Box<dyn VectorRhs<V>> {
        *self.0.downcast().expect("made for the same instruction set")
    }
}

struct EraseNone;

impl Task for EraseNone {
    type Output = AnyVectorRhs;

    fn run<V: Simd>(self, _zero: V) -> AnyVectorRhs {
        AnyVectorRhs::of::<V>(Box::new(NoEquation))
    }
}

struct Erase<'a, P> {
    plant: &'a P,
}

impl<P: Plant> Task for Erase<'_, P> {
    type Output = AnyVectorRhs;

    fn run<V: Simd>(self, _zero: V) -> AnyVectorRhs {
        AnyVectorRhs::of::<V>(Box::new(self.plant.clone()))
    }
}
