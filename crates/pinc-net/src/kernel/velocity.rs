//! A plant's equation on vectors, with the plant's type forgotten.

use super::physics::DIRECTIONS;
use pinc_ad::Dual;
use pinc_ad::simd::{Simd, Work};
use pinc_ode::Plant;
use std::fmt::Debug;

/// A number that the kernel gives to a plant: a vector with some of its derivatives.
pub(super) type Wide<V> = Dual<V, DIRECTIONS>;

/// f(x, u) on vectors. The kernel calls it once for a vector of points, so that the call costs
/// nothing that could be measured; and the kernel is compiled once and not once per plant.
pub(super) trait Velocity<V>: Debug + Send + Sync {
    /// Writes f(x, u) into `dx`.
    fn rhs(&self, x: &[Wide<V>], u: &[Wide<V>], dx: &mut [Wide<V>]);
}

impl<V: Simd, P: Plant> Velocity<V> for P {
    fn rhs(&self, x: &[Wide<V>], u: &[Wide<V>], dx: &mut [Wide<V>]) {
        let vector = x[0].re;
        vector.vectorize(Evaluation { plant: self, x, u, dx });
    }
}

struct Evaluation<'a, V, P> {
    plant: &'a P,
    x: &'a [Wide<V>],
    u: &'a [Wide<V>],
    dx: &'a mut [Wide<V>],
}

impl<V: Simd, P: Plant> Work for Evaluation<'_, V, P> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        self.plant.rhs(self.x, self.u, self.dx);
    }
}
