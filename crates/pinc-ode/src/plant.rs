//! The interface of an ordinary differential equation.

use crate::{Dims, Variable};
use pinc_ad::Scalar;
use std::fmt::Debug;
use std::ops::{Add, Div, Mul, Sub};

/// A number that takes coefficients `K` on the right of an operator: an equation over it and `K`
/// serves a plant whose constants are plain numbers (`K` is `f64`) and a family of plants, whose
/// constants are numbers of the same kind as the states (`K` is `Self`). All [`Scalar`]s are over
/// both.
pub trait Over<K>:
    Scalar
    + Add<K, Output = Self>
    + Sub<K, Output = Self>
    + Mul<K, Output = Self>
    + Div<K, Output = Self>
{
}

impl<K, S> Over<K> for S where
    S: Scalar
        + Add<K, Output = Self>
        + Sub<K, Output = Self>
        + Mul<K, Output = Self>
        + Div<K, Output = Self>
{
}

/// A controlled plant x' = f(x, u, p), time-invariant, with outputs y = h(x, u, p).
///
/// The equation is written once, over [`Scalar`], and evaluated on `f64`, dual numbers, a tape and
/// SIMD lanes. Mark [`Plant::rhs`] `#[inline(always)]`: it becomes part of a SIMD kernel, which is
/// twice as slow where it stays a call. What it calls needs the same mark; in place of closures,
/// `array::map` and `array::from_fn`, which are not always inlined, write functions and loops.
///
/// ```
/// use pinc_ad::Scalar;
/// use pinc_ode::{Plant, Variable};
///
/// /// A mass on a spring, pushed by a force: x' = v, v' = u - x.
/// #[derive(Clone, Debug)]
/// struct Spring;
///
/// impl Plant for Spring {
///     fn states(&self) -> &[Variable] {
///         static VARIABLES: [Variable; 2] =
///             [Variable::new("x", "m"), Variable::new("v", "m/s")];
///         &VARIABLES
///     }
///     fn inputs(&self) -> &[Variable] {
///         static VARIABLES: [Variable; 1] =
///             [Variable::new("u", "N")];
///         &VARIABLES
///     }
///     #[inline(always)]
///     fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
///         dx[0] = x[1];
///         dx[1] = u[0] - x[0];
///     }
/// }
/// assert_eq!(Spring.dims().nx, 2);
/// ```
pub trait Plant: Clone + Debug + Send + Sync + 'static {
    /// Whether [`Plant::rhs`] is long: another equation is solved inside, or it has sines and their
    /// like. The Runge-Kutta methods of such a plant compute with points in the lanes of vectors,
    /// however many columns its Jacobians have, so that functions and iterations serve several
    /// points at once.
    const LONG: bool = false;

    /// How many states and inputs a plant without parameters has together, if its type says it: its
    /// Runge-Kutta methods are then compiled for so many columns of Jacobians, else for any number.
    const COLUMNS: Option<usize> = None;

    /// The states, in order; their number is `nx`.
    fn states(&self) -> &[Variable];

    /// The inputs, in order; their number is `nu`.
    fn inputs(&self) -> &[Variable];

    /// The parameters that may change from call to call, in order: those that an estimator or a
    /// family of plants varies. Fixed numbers of an equation are fields of its type.
    fn parameters(&self) -> &[Variable] {
        &[]
    }

    /// The outputs, in order; the states by default.
    fn outputs(&self) -> &[Variable] {
        self.states()
    }

    /// Writes f(x, u, p) into `dx`.
    ///
    /// # Shapes
    ///
    /// `x` and `dx`: `nx`, in [`Plant::states`]' units and units per second; `u`: `nu`; `p`: `np`.
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], dx: &mut [S]);

    /// The named numbers of f that a family of plants may vary, with their values; none by default.
    /// Outputs do not depend on them.
    fn constants(&self) -> Vec<(String, f64)> {
        Vec::new()
    }

    /// The plant with other [`Plant::constants`], in their order.
    #[must_use]
    fn with_constants(&self, constants: &[f64]) -> Self {
        let _ = constants;
        self.clone()
    }

    /// Writes f(x, u, p) of the plant with other [`Plant::constants`] into `dx`: a plant that has
    /// any writes its equation over the kind of these numbers too, which are `f64` in
    /// [`Plant::rhs`].
    ///
    /// # Shapes
    ///
    /// As [`Plant::rhs`]; `constants`: as many as [`Plant::constants`].
    fn rhs_with<S: Scalar>(&self, constants: &[S], x: &[S], u: &[S], p: &[S], dx: &mut [S]) {
        let _ = constants;
        self.rhs(x, u, p, dx);
    }

    /// Writes the outputs h(x, u, p) into `y`; by default a copy of the states.
    ///
    /// # Shapes
    ///
    /// `x`: `nx`; `u`: `nu`; `p`: `np`; `y`: `ny`, in the units of [`Plant::outputs`].
    fn output<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], y: &mut [S]) {
        let _ = (u, p);
        y.copy_from_slice(x);
    }

    /// Why f(x, u, p) is not finite there, in words, where the plant knows: an equation inside it
    /// without a root, for one. By default nothing is known.
    ///
    /// # Shapes
    ///
    /// `x`: `nx`; `u`: `nu`; `p`: `np`.
    fn explain(&self, x: &[f64], u: &[f64], p: &[f64]) -> Option<String> {
        let _ = (x, u, p);
        None
    }

    /// The numbers of states, inputs, parameters and outputs.
    fn dims(&self) -> Dims {
        Dims::new(self.states().len(), self.inputs().len())
            .with_parameters(self.parameters().len())
            .with_outputs(self.outputs().len())
    }
}
