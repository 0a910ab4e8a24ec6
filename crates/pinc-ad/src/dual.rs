//! Dual numbers: forward-mode derivatives.
//!
//! # Dual numbers in one screen
//!
//! Extend the numbers by infinitesimals `e_1 .. e_N` with `e_i e_j = 0`. Then every smooth function
//! obeys
//!
//! ```text
//! f(a + v_1 e_1 + .. + v_N e_N) = f(a) + f'(a) v_1 e_1 + .. + f'(a) v_N e_N
//! ```
//!
//! Evaluating f on a dual number therefore gives its value in [`Dual::re`] and its derivatives in N
//! directions in [`Dual::eps`], by these rules:
//!
//! ```text
//! (a + v e) + (b + w e) = (a + b) +  (v + w) e
//! (a + v e) * (b + w e) =  a b    +  (v b + a w) e
//! (a + v e) / (b + w e) =  a/b    +  (v - (a/b) w)/b e
//! sqrt(a + v e)         =  sqrt a +  v / (2 sqrt a) e
//! exp(a + v e)          =  exp a  +  v exp a e
//! tanh(a + v e)         =  tanh a +  (1 - tanh^2 a) v e
//! ```
//!
//! To get `df/dx_j`, give `x_j` eps = 1 in one direction and all other variables 0 in it.

use crate::Scalar;
use crate::simd::Work;
use std::fmt::Debug;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A value with its derivatives in `N` directions; the value may be any [`Scalar`], and a
/// derivative is one as well, or anything else that can be scaled by it (see [`Derivative`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dual<S, const N: usize = 1, E = S> {
    /// The value.
    pub re: S,
    /// The derivatives, one per direction.
    pub eps: [E; N],
}

/// The derivative of a value of kind `S`: an element of a vector space over it. Every [`Scalar`] is
/// one over itself; [`Directions`](crate::Directions) has several directions in one vector.
pub trait Derivative<S>:
    Copy + Debug + Add<Output = Self> + Sub<Output = Self> + Neg<Output = Self>
{
    /// 0, in the context of `self`.
    #[must_use]
    fn zero(self) -> Self;

    /// `self * a`
    #[must_use]
    fn times(self, a: S) -> Self;

    /// `self * a + b`
    #[must_use]
    fn times_add(self, a: S, b: Self) -> Self;

    /// `self` where `test <= 0`, `no` elsewhere.
    #[must_use]
    fn where_nonpositive(self, test: S, no: Self) -> Self;

    /// Does `work` compiled for the instruction set of `self`: see [`Scalar::vectorize`].
    fn vectorize<W: Work>(self, work: W) -> W::Output;
}

impl<S: Scalar> Derivative<S> for S {
    #[inline(always)]
    fn zero(self) -> Self {
        self.constant(0.0)
    }
    #[inline(always)]
    fn times(self, a: S) -> Self {
        self * a
    }
    #[inline(always)]
    fn times_add(self, a: S, b: Self) -> Self {
        self.mul_add(a, b)
    }
    #[inline(always)]
    fn where_nonpositive(self, test: S, no: Self) -> Self {
        test.where_nonpositive(self, no)
    }
    #[inline(always)]
    fn vectorize<W: Work>(self, work: W) -> W::Output {
        Scalar::vectorize(self, work)
    }
}

impl<S: Scalar, const N: usize> Dual<S, N> {
    /// `value` as a constant: all derivatives 0. This also lifts a dual number one level up.
    #[inline(always)]
    pub fn lift(value: S) -> Self {
        Self { re: value, eps: [value.constant(0.0); N] }
    }

    /// `value` as the variable of direction `direction`: derivative 1 there, 0 elsewhere. With
    /// `direction >= N` it is a constant.
    #[inline(always)]
    pub fn variable(value: S, direction: usize) -> Self {
        let mut variable = Self::lift(value);
        if let Some(eps) = variable.eps.get_mut(direction) {
            *eps = value.constant(1.0);
        }
        variable
    }
}

impl<S: Scalar, const N: usize, E: Derivative<S>> Dual<S, N, E> {
    /// The dual number with value `re` and derivatives `slope * eps[i]`: the chain rule.
    #[inline(always)]
    fn chain(self, re: S, slope: S) -> Self {
        self.scaled(re, |e| e.times(slope))
    }

    /// The dual number with value `re` and derivatives f(eps\[i\]). (A loop, since `array::map` is
    /// not sure to be inlined into SIMD code.)
    #[inline(always)]
    fn scaled(self, re: S, f: impl Fn(E) -> E) -> Self {
        let mut eps = self.eps;
        for e in &mut eps {
            *e = f(*e);
        }
        Self { re, eps }
    }

    #[inline(always)]
    fn zip(self, other: Self, re: S, f: impl Fn(E, E) -> E) -> Self {
        let mut eps = self.eps;
        for (e, other) in eps.iter_mut().zip(&other.eps) {
            *e = f(*e, *other);
        }
        Self { re, eps }
    }
}

impl<S: Scalar, const N: usize, E: Derivative<S>> Add for Dual<S, N, E> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        self.zip(b, self.re + b.re, |v, w| v + w)
    }
}

impl<S: Scalar, const N: usize, E: Derivative<S>> Sub for Dual<S, N, E> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        self.zip(b, self.re - b.re, |v, w| v - w)
    }
}

impl<S: Scalar, const N: usize, E: Derivative<S>> Mul for Dual<S, N, E> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        self.zip(b, self.re * b.re, |v, w| v.times_add(b.re, w.times(self.re)))
    }
}

impl<S: Scalar, const N: usize, E: Derivative<S>> Div for Dual<S, N, E> {
    type Output = Self;
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        let inverse = b.re.constant(1.0) / b.re;
        let quotient = self.re / b.re;
        self.zip(b, quotient, |v, w| (v - w.times(quotient)).times(inverse))
    }
}

impl<S: Scalar, const N: usize, E: Derivative<S>> Neg for Dual<S, N, E> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.scaled(-self.re, |e| -e)
    }
}

impl<S: Scalar, const N: usize, E: Derivative<S>> Add<f64> for Dual<S, N, E> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: f64) -> Self {
        Self { re: self.re + b, ..self }
    }
}

impl<S: Scalar, const N: usize, E: Derivative<S>> Sub<f64> for Dual<S, N, E> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: f64) -> Self {
        Self { re: self.re - b, ..self }
    }
}

impl<S: Scalar, const N: usize, E: Derivative<S>> Mul<f64> for Dual<S, N, E> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: f64) -> Self {
        let factor = self.re.constant(b);
        self.scaled(self.re * b, |e| e.times(factor))
    }
}

impl<S: Scalar, const N: usize, E: Derivative<S>> Div<f64> for Dual<S, N, E> {
    type Output = Self;
    #[inline(always)]
    fn div(self, b: f64) -> Self {
        let factor = self.re.constant(1.0 / b);
        self.scaled(self.re / b, |e| e.times(factor))
    }
}

impl<S: Scalar, const N: usize, E: Derivative<S>> Scalar for Dual<S, N, E> {
    type Plain = S::Plain;
    const ORDER: usize = S::ORDER + 1;
    #[inline(always)]
    fn all_nonpositive(self) -> bool {
        self.re.all_nonpositive()
    }
    #[inline(always)]
    fn plain(self) -> S::Plain {
        self.re.plain()
    }
    #[inline(always)]
    fn constants(self, value: S::Plain) -> Self {
        self.scaled(self.re.constants(value), E::zero)
    }
    #[inline(always)]
    fn constant(self, value: f64) -> Self {
        self.scaled(self.re.constant(value), E::zero)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        let root = self.re.sqrt();
        let slope = root.constant(0.5) / root;
        self.chain(root, root.where_nonpositive(root.constant(0.0), slope))
    }
    #[inline(always)]
    fn exp(self) -> Self {
        let y = self.re.exp();
        self.chain(y, y)
    }
    #[inline(always)]
    fn ln(self) -> Self {
        self.chain(self.re.ln(), self.re.constant(1.0) / self.re)
    }
    #[inline(always)]
    fn sin(self) -> Self {
        self.chain(self.re.sin(), self.re.cos())
    }
    #[inline(always)]
    fn cos(self) -> Self {
        self.chain(self.re.cos(), -self.re.sin())
    }
    #[inline(always)]
    fn tan(self) -> Self {
        let y = self.re.tan();
        self.chain(y, y * y + 1.0)
    }
    #[inline(always)]
    fn atan(self) -> Self {
        let slope = self.re.constant(1.0) / (self.re * self.re + 1.0);
        self.chain(self.re.atan(), slope)
    }
    #[inline(always)]
    fn tanh(self) -> Self {
        let y = self.re.tanh();
        self.chain(y, -(y * y) + 1.0)
    }
    #[inline(always)]
    fn powf(self, p: f64) -> Self {
        let slope = self.re.powf(p - 1.0) * p;
        let slope = if p < 1.0 {
            // Infinite at 0 and counted as 0; NaN below 0, as the value.
            (-self.re)
                .where_nonpositive(self.re.where_nonpositive(self.re.constant(0.0), slope), slope)
        } else {
            slope
        };
        self.chain(self.re.powf(p), slope)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.chain(self.re.abs(), self.re.sign())
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        let mut eps = self.eps;
        for ((e, a_eps), b_eps) in eps.iter_mut().zip(&a.eps).zip(&b.eps) {
            *e = e.times_add(a.re, a_eps.times_add(self.re, *b_eps));
        }
        Self { re: self.re.mul_add(a.re, b.re), eps }
    }
    #[inline(always)]
    fn vectorize<W: Work>(self, work: W) -> W::Output {
        self.eps[0].vectorize(work)
    }
    #[inline(always)]
    fn where_nonpositive(self, yes: Self, no: Self) -> Self {
        let test = self.re;
        yes.zip(no, test.where_nonpositive(yes.re, no.re), |y, n| y.where_nonpositive(test, n))
    }
}
