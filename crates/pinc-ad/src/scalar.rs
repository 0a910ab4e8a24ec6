//! The trait that equations are written over.

use std::fmt::Debug;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A number that an equation can be written over: `f64`, [`Dual`](crate::Dual),
/// [`Lanes`](crate::Lanes), [`Var`](crate::Var) and any nesting of them.
///
/// Plain numbers stand on the right of an operator: `x * 2.0`, not `2.0 * x`.
///
/// There is no ordering, since a comparison cannot be answered once for several lanes: branch with
/// [`where_nonpositive`](Scalar::where_nonpositive). There is no `zero()` or `From<f64>`, since a
/// constant may need the context of a value: make it from one with [`constant`](Scalar::constant).
pub trait Scalar:
    Copy
    + Debug
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
    + Div<f64, Output = Self>
{
    /// This kind of number without its derivatives, as many lanes: `f64` or `Lanes`, say. An equation
    /// that solves another one inside iterates on it (see [`plain`](Scalar::plain)).
    type Plain: Scalar<Plain = Self::Plain>;

    /// The constant `value` in the context of `self` (same tape, same lanes); its derivatives are 0.
    #[must_use]
    fn constant(self, value: f64) -> Self;

    /// The value alone, lane by lane.
    ///
    /// An equation g(z, x) = 0 inside another is solved for z on plain numbers; one Newton step on
    /// the kind of number itself then gives z its derivatives `dz/dx = -g_x / g_z`, exact to first order
    /// (implicit function theorem). Iterating on numbers with derivatives would cost several times
    /// as much.
    #[must_use]
    fn plain(self) -> Self::Plain;

    /// The constant `value`, lane by lane, in the context of `self`; its derivatives are 0.
    #[must_use]
    fn constants(self, value: Self::Plain) -> Self;

    /// The square root; NaN below 0. Its derivative is infinite at 0, and NaN there in a direction
    /// in which the argument does not change.
    #[must_use]
    fn sqrt(self) -> Self;

    /// The hyperbolic tangent.
    #[must_use]
    fn tanh(self) -> Self;

    /// `self * a + b`. Whether the product is rounded before the sum is up to the kind of number:
    /// kinds that can do it in one fast instruction fuse it.
    #[inline(always)]
    #[must_use]
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }

    /// `yes` where `self <= 0`, `no` elsewhere (also where `self` is NaN, so that NaN stays
    /// visible). Both sides are evaluated; the derivative is that of the side taken.
    #[must_use]
    fn where_nonpositive(self, yes: Self, no: Self) -> Self;
}

impl Scalar for f64 {
    type Plain = Self;
    #[inline(always)]
    fn plain(self) -> Self {
        self
    }
    #[inline(always)]
    fn constants(self, value: Self) -> Self {
        value
    }
    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
    #[inline(always)]
    fn tanh(self) -> Self {
        f64::tanh(self)
    }
    #[inline(always)]
    fn where_nonpositive(self, yes: Self, no: Self) -> Self {
        if self <= 0.0 { yes } else { no }
    }
}
