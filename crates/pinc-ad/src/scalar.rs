//! The trait that equations are written over.

use crate::ImplicitEquations;
use crate::simd::Work;
use std::fmt::Debug;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A number that an equation can be written over: `f64`, [`Dual`](crate::Dual),
/// [`Lanes`](crate::Lanes), [`Var`](crate::Var) and any nesting of them.
///
/// Plain numbers go on the right of an operator: `x * 2.0`, not `2.0 * x`.
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
    /// This kind of number without its derivatives, as many lanes: `f64` or `Lanes`, say. An
    /// equation that solves another one inside iterates on it (see [`plain`](Scalar::plain)).
    type Plain: Scalar<Plain = Self::Plain>;

    /// Up to which order it carries derivatives: how many kinds of number that differentiate are
    /// nested in it.
    const ORDER: usize;

    /// The constant `value` in the context of `self` (same tape, same lanes); its derivatives are
    /// 0.
    #[must_use]
    fn constant(self, value: f64) -> Self;

    /// The value alone, lane by lane.
    ///
    /// An equation g(z, x) = 0 inside another is solved for z on plain numbers; one Newton step on
    /// the kind of number itself then gives z its derivatives `dz/dx = -g_x / g_z`, exact to first
    /// order (implicit function theorem). Iterating on numbers with derivatives would cost several
    /// times as much. [`solve_implicit`](crate::solve_implicit) does this.
    #[must_use]
    fn plain(self) -> Self::Plain;

    /// The constant `value`, lane by lane, in the context of `self`; its derivatives are 0.
    #[must_use]
    fn constants(self, value: Self::Plain) -> Self;

    /// The square root; NaN below 0. Its derivative at 0, which is infinite, counts as 0: so
    /// `x.max(0).sqrt()` and the length of a zero vector have finite derivatives.
    #[must_use]
    fn sqrt(self) -> Self;

    /// e to the power of `self`.
    #[must_use]
    fn exp(self) -> Self;

    /// The natural logarithm; -infinity at 0 (with an infinite derivative), NaN below.
    #[must_use]
    fn ln(self) -> Self;

    /// The sine of an angle in radians.
    #[must_use]
    fn sin(self) -> Self;

    /// The cosine of an angle in radians.
    #[must_use]
    fn cos(self) -> Self;

    /// The tangent of an angle in radians.
    #[must_use]
    fn tan(self) -> Self;

    /// The angle in radians, in (-pi/2, pi/2), whose tangent is `self`.
    #[must_use]
    fn atan(self) -> Self;

    /// The hyperbolic tangent.
    #[must_use]
    fn tanh(self) -> Self;

    /// `self` to the power `p`; NaN below 0 unless `p` is whole. For p < 1 the derivative at 0,
    /// which is infinite, counts as 0, as for [`sqrt`](Scalar::sqrt).
    #[must_use]
    fn powf(self, p: f64) -> Self;

    /// `self` to the whole power `n`, by repeated squaring; 1 for n = 0.
    #[inline(always)]
    #[must_use]
    fn powi(self, n: i32) -> Self {
        let mut rest = n.unsigned_abs();
        let mut square = self;
        let mut power = None;
        while rest > 0 {
            if rest % 2 == 1 {
                power = Some(power.map_or(square, |power| power * square));
            }
            rest /= 2;
            if rest > 0 {
                square = square * square;
            }
        }
        let one = self.constant(1.0);
        match power {
            None => one,
            Some(power) if n < 0 => one / power,
            Some(power) => power,
        }
    }

    /// The absolute value; its derivative is [`sign`](Scalar::sign), 0 at 0.
    #[inline(always)]
    #[must_use]
    fn abs(self) -> Self {
        self.where_nonpositive(self.constant(0.0) - self, self)
    }

    /// -1, 0 or 1 as `self` is negative, 0 or positive; NaN for NaN. Its derivative is 0
    /// everywhere.
    #[inline(always)]
    #[must_use]
    fn sign(self) -> Self {
        let constant = |value| self.constant(value);
        let not_positive = (-self).where_nonpositive(constant(0.0), constant(-1.0));
        let positive_or_nan = (-self).where_nonpositive(constant(1.0), self);
        self.where_nonpositive(not_positive, positive_or_nan)
    }

    /// The smaller of two numbers, NaN if one is. It has the derivative of the number taken, which
    /// is `other` if both are equal.
    #[inline(always)]
    #[must_use]
    fn min(self, other: Self) -> Self {
        // The sum is taken where neither comparison holds: of infinities of one sign, or with a
        // NaN.
        let rest = (self - other).where_nonpositive(self, self + other);
        (other - self).where_nonpositive(other, rest)
    }

    /// The larger of two numbers, NaN if one is. It has the derivative of the number taken, which
    /// is `other` if both are equal.
    #[inline(always)]
    #[must_use]
    fn max(self, other: Self) -> Self {
        let rest = (other - self).where_nonpositive(self, self + other);
        (self - other).where_nonpositive(other, rest)
    }

    /// `self * a + b`. Whether the product is rounded before the sum is up to the kind of number:
    /// kinds that can do it in one fast instruction fuse it.
    #[inline(always)]
    #[must_use]
    fn mul_add(self, a: Self, b: Self) -> Self {
        self * a + b
    }

    /// Runs `work`, compiled for the instruction set that this kind of number needs. Code over
    /// numbers that is too long to be inlined at each of its places goes through here.
    #[inline(always)]
    fn vectorize<W: Work>(self, work: W) -> W::Output {
        work.run()
    }

    /// `yes` where `self <= 0`, `no` elsewhere (also where `self` is NaN, so that NaN stays
    /// visible). Both sides are evaluated; the result has the derivative of the side taken.
    #[must_use]
    fn where_nonpositive(self, yes: Self, no: Self) -> Self;

    /// Whether the value is <= 0 in all lanes: when an iteration on several of them may end.
    #[must_use]
    fn all_nonpositive(self) -> bool;

    /// Unknowns z with 0 = g(x, z), for kinds of number that record an equation: they keep `start`,
    /// `limits` and the residuals beside it. The others have no such unknowns, and the caller solves
    /// for z itself. [`solve_implicit`](crate::solve_implicit) does both.
    #[inline(always)]
    fn declare<E: ImplicitEquations<K, N>, const K: usize, const N: usize>(
        equations: &E,
        x: &[Self; K],
        start: [Self::Plain; N],
        limits: &[[f64; 2]; N],
    ) -> Option<[Self; N]> {
        let _ = (equations, x, start, limits);
        None
    }
}

/// What a number without derivatives says of them.
macro_rules! without_derivatives {
    () => {
        type Plain = Self;
        const ORDER: usize = 0;
        #[inline(always)]
        fn plain(self) -> Self {
            self
        }
        #[inline(always)]
        fn constants(self, value: Self) -> Self {
            value
        }
    };
}
pub(crate) use without_derivatives;

macro_rules! functions {
    ($($method:ident)*) => {$(
        #[inline(always)]
        fn $method(self) -> Self {
            f64::$method(self)
        }
    )*};
}

impl Scalar for f64 {
    without_derivatives!();
    #[inline(always)]
    fn all_nonpositive(self) -> bool {
        self <= 0.0
    }
    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        value
    }
    functions!(sqrt exp ln sin cos tan atan tanh);
    #[inline(always)]
    fn powf(self, p: f64) -> Self {
        f64::powf(self, p)
    }
    #[inline(always)]
    fn where_nonpositive(self, yes: Self, no: Self) -> Self {
        if self <= 0.0 { yes } else { no }
    }
}
