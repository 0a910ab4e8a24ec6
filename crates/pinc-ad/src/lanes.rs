//! Several points at once, element by element.

use crate::Scalar;
use crate::scalar::without_derivatives;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// `L` numbers that go through an equation together.
///
/// Every operation is a loop over a fixed-size array, which the compiler turns into vector
/// instructions of the width that the surrounding code may use.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(align(64))]
pub struct Lanes<const L: usize>(pub [f64; L]);

impl<const L: usize> Lanes<L> {
    /// The same `value` in every lane.
    #[inline(always)]
    #[must_use]
    pub const fn splat(value: f64) -> Self {
        Self([value; L])
    }

    /// (Loops, since `array::map` and `from_fn` are not sure to be inlined into SIMD code.)
    #[inline(always)]
    fn map(mut self, f: impl Fn(f64) -> f64) -> Self {
        for a in &mut self.0 {
            *a = f(*a);
        }
        self
    }

    #[inline(always)]
    fn zip(mut self, other: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        for (a, b) in self.0.iter_mut().zip(&other.0) {
            *a = f(*a, *b);
        }
        self
    }
}

macro_rules! lanewise {
    ($($trait:ident $method:ident),*) => {$(
        impl<const L: usize> $trait for Lanes<L> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                self.zip(other, f64::$method)
            }
        }
        impl<const L: usize> $trait<f64> for Lanes<L> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: f64) -> Self {
                self.map(|a| a.$method(other))
            }
        }
    )*};
}
lanewise!(Add add, Sub sub, Mul mul, Div div);

impl<const L: usize> Neg for Lanes<L> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.map(|a| -a)
    }
}

/// The functions of a [`Scalar`] with a `map`: the functions of numbers, lane by lane.
macro_rules! functions_by_lane {
    ($($method:ident)+) => {
        $(
            #[inline(always)]
            fn $method(self) -> Self {
                self.map(f64::$method)
            }
        )+
        #[inline(always)]
        fn powf(self, p: f64) -> Self {
            self.map(|a| a.powf(p))
        }
    };
    () => {
        functions_by_lane!(exp ln sin cos tan atan tanh);
    };
}
#[cfg(target_arch = "x86_64")]
pub(crate) use functions_by_lane;

impl<const L: usize> Scalar for Lanes<L> {
    without_derivatives!();
    #[inline(always)]
    fn all_nonpositive(self) -> bool {
        self.0.iter().all(|lane| *lane <= 0.0)
    }
    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        Self::splat(value)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.map(f64::sqrt)
    }
    functions_by_lane!();
    #[inline(always)]
    fn where_nonpositive(self, mut yes: Self, no: Self) -> Self {
        for ((yes, no), test) in yes.0.iter_mut().zip(&no.0).zip(&self.0) {
            *yes = test.where_nonpositive(*yes, *no);
        }
        yes
    }
}
