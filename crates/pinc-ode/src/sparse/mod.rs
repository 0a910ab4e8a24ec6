//! Plants whose Jacobians are known to be zero in most places: the interface, and the
//! Runge-Kutta and Rosenbrock methods on it.

mod adjoint;
mod by_count;
mod cotangents;
mod elimination;
mod gradient;
mod lanes;
mod lu;
mod model;
mod outputs;
mod pattern;
mod propagation;
mod rosenbrock;
mod runge_kutta;
mod small;
mod tableau;
mod tangents;

pub(crate) use lanes::{WIDEST, scatter};
pub use pattern::SparsityPattern;
pub use rosenbrock::sparse_rosenbrock;
pub use runge_kutta::{SparsePlant, sparse_runge_kutta};
pub use tableau::Tableau;

use pinc_ad::simd::Simd;
use std::fmt::Debug;

/// A function of the variables (x, u, p) with its Jacobian, of which it is known where it is zero
/// everywhere. It is evaluated at as many points as a vector has lanes.
pub trait SparseFunction: Clone + Debug + Send + Sync + 'static {
    /// Where the Jacobian is not zero everywhere: a row for each value, a column for each of x, u
    /// and p, one after the other.
    fn pattern(&self) -> &SparsityPattern;

    /// Room to compute in, for the other methods. It begins with the variables: set them there.
    fn memory<V: Simd>(&self, zero: V) -> Vec<V>;

    /// Computes the values at the variables in `memory`, and returns their places there.
    fn values<V: Simd>(&self, memory: &mut [V]) -> &[u16];

    /// Computes the values and the entries of the Jacobian, in the order of the pattern, and
    /// returns their places in `memory`, values first.
    fn linearize<V: Simd>(&self, memory: &mut [V]) -> &[u16];
}

/// A [`SparseFunction`] with the second derivatives that are not zero everywhere.
pub trait CurvedFunction: SparseFunction {
    /// Which these are: the derivatives of entries of the Jacobian in columns of x.
    fn curvatures(&self) -> &[Curvature];

    /// Computes the values, the entries of the Jacobian and the second derivatives, and returns
    /// their places in `memory`, in this order.
    fn curve<V: Simd>(&self, memory: &mut [V]) -> &[u16];
}

/// A second derivative: an entry of the Jacobian, counted through the pattern, by a
/// variable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Curvature {
    /// The entry.
    pub entry: usize,
    /// The variable: its place in (x, u, p).
    pub variable: usize,
}
