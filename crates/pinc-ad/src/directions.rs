//! Derivatives in several directions at once, in the lanes of a vector.

use crate::simd::Work;
use crate::{Derivative, Lanes, Scalar};
use std::ops::{Add, Neg, Sub};

/// The derivatives of `P` values, each in as many directions as `V` has lanes.
///
/// As the derivative part of a dual number, `Dual<Lanes<P>, 1, Directions<V, P>>`, it takes all
/// columns of a Jacobian through an equation in one register, beside values that are computed only
/// once; and `P` points side by side, so that the processor has independent work while one point
/// waits for its last result.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Directions<V, const P: usize>(pub [V; P]);

impl<V: Scalar, const P: usize> Directions<V, P> {
    #[inline(always)]
    fn map(mut self, f: impl Fn(V) -> V) -> Self {
        for a in &mut self.0 {
            *a = f(*a);
        }
        self
    }

    #[inline(always)]
    fn zip(mut self, other: Self, f: impl Fn(V, V) -> V) -> Self {
        for (a, b) in self.0.iter_mut().zip(&other.0) {
            *a = f(*a, *b);
        }
        self
    }
}

impl<V: Scalar, const P: usize> Add for Directions<V, P> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        self.zip(b, |a, b| a + b)
    }
}

impl<V: Scalar, const P: usize> Sub for Directions<V, P> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        self.zip(b, |a, b| a - b)
    }
}

impl<V: Scalar, const P: usize> Neg for Directions<V, P> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.map(|a| -a)
    }
}

impl<V: Scalar, const P: usize> Derivative<Lanes<P>> for Directions<V, P> {
    #[inline(always)]
    fn zero(self) -> Self {
        self.map(|a| a.constant(0.0))
    }
    #[inline(always)]
    fn times(mut self, factors: Lanes<P>) -> Self {
        for (a, factor) in self.0.iter_mut().zip(&factors.0) {
            *a = *a * *factor;
        }
        self
    }
    #[inline(always)]
    fn times_add(mut self, factors: Lanes<P>, b: Self) -> Self {
        for ((a, factor), b) in self.0.iter_mut().zip(&factors.0).zip(&b.0) {
            *a = a.mul_add(a.constant(*factor), *b);
        }
        self
    }
    #[inline(always)]
    fn where_nonpositive(mut self, tests: Lanes<P>, no: Self) -> Self {
        for ((yes, test), no) in self.0.iter_mut().zip(&tests.0).zip(&no.0) {
            *yes = yes.constant(*test).where_nonpositive(*yes, *no);
        }
        self
    }
    #[inline(always)]
    fn vectorize<W: Work>(self, work: W) -> W::Output {
        self.0[0].vectorize(work)
    }
}
