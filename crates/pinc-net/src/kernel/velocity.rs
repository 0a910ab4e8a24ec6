//! A plant's equation on vectors, with the plant's type forgotten: the kernel is compiled once, in this
//! crate, and not once per plant.

use super::physics::DIRECTIONS;
use pinc_ad::Dual;
use pinc_ad::simd::{Isa, Simd, Task, Work};
use pinc_ode::Plant;
use std::any::Any;
use std::fmt::Debug;

/// A number that the kernel gives to a plant: a vector with some of its derivatives.
pub(super) type Wide<V> = Dual<V, DIRECTIONS>;

/// f(x, u) on vectors. The kernel calls it once for a vector of points, so that the call costs
/// nothing that could be measured.
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
        self.plant.rhs(self.x, self.u, &[], self.dx);
    }
}

/// A plant's [`Velocity`] on the vectors of one instruction set, with their type forgotten too.
pub(super) struct AnyVelocity(Box<dyn Any>);

impl AnyVelocity {
    pub(super) fn new<P: Plant>(plant: &P, isa: Isa) -> Self {
        isa.dispatch(Forget { plant })
    }

    /// The velocity on vectors `V`.
    ///
    /// # Panics
    ///
    /// If they are those of another instruction set.
    pub(super) fn on<V: Simd>(self) -> Box<dyn Velocity<V>> {
        *self.0.downcast().expect("made for the same instruction set")
    }
}

struct Forget<'a, P> {
    plant: &'a P,
}

impl<P: Plant> Task for Forget<'_, P> {
    type Output = AnyVelocity;

    fn run<V: Simd>(self, _zero: V) -> AnyVelocity {
        let velocity: Box<dyn Velocity<V>> = Box::new(self.plant.clone());
        AnyVelocity(Box::new(velocity))
    }
}
