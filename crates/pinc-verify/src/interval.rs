//! Intervals, rounded outward.

use crate::elementary::{self, Approximate};
use std::ops::{Add, Div, Mul, Neg, Sub};

/// All numbers from `low` to `high`. An operation that is not defined, or not smooth, on all of its
/// operand gives [`Interval::ENTIRE`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// The lower end.
    pub low: f64,
    /// The upper end.
    pub high: f64,
}

impl Interval {
    /// All numbers: nothing is known.
    pub const ENTIRE: Self = Self { low: f64::NEG_INFINITY, high: f64::INFINITY };

    /// The interval of one number.
    #[must_use]
    pub fn point(value: f64) -> Self {
        Self { low: value, high: value }
    }

    /// From two ends as rounding to nearest gives them to what surely holds the exact ones.
    fn outward(low: f64, high: f64) -> Self {
        if low.is_nan() || high.is_nan() {
            return Self::ENTIRE;
        }
        Self { low: low.next_down(), high: high.next_up() }
    }

    /// `middle` with `radius` on both sides; everything if one is no number.
    #[must_use]
    pub fn around(middle: f64, radius: f64) -> Self {
        Self::outward(middle - radius, middle + radius)
    }

    fn of(at: Approximate) -> Self {
        Self::around(at.value, at.error)
    }

    fn hull(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// Whether `value` lies in the interval.
    #[must_use]
    pub fn contains(self, value: f64) -> bool {
        self.low <= value && value <= self.high
    }

    /// The largest absolute value in it.
    #[must_use]
    pub fn magnitude(self) -> f64 {
        self.low.abs().max(self.high.abs())
    }

    /// The smallest absolute value in it.
    #[must_use]
    pub fn mignitude(self) -> f64 {
        if self.contains(0.0) { 0.0 } else { self.low.abs().min(self.high.abs()) }
    }

    /// 1 / x.
    #[must_use]
    pub fn recip(self) -> Self {
        if self.contains(0.0) {
            return Self::ENTIRE;
        }
        Self::outward(1.0 / self.high, 1.0 / self.low)
    }

    /// The image under a function that increases.
    fn increasing(self, f: fn(f64) -> Approximate) -> Self {
        Self { low: Self::of(f(self.low)).low, high: Self::of(f(self.high)).high }
    }

    /// The square root; everything below 0.
    #[must_use]
    pub fn sqrt(self) -> Self {
        if self.low < 0.0 {
            return Self::ENTIRE;
        }
        Self { low: self.low.sqrt().next_down().max(0.0), high: self.high.sqrt().next_up() }
    }

    /// e^x.
    #[must_use]
    pub fn exp(self) -> Self {
        let found = self.increasing(elementary::exp);
        Self { low: found.low.max(0.0), ..found }
    }

    /// The natural logarithm.
    #[must_use]
    pub fn ln(self) -> Self {
        if self.low > 0.0 { self.increasing(elementary::ln) } else { Self::ENTIRE }
    }

    /// The hyperbolic tangent.
    #[must_use]
    pub fn tanh(self) -> Self {
        let found = self.increasing(elementary::tanh);
        Self { low: found.low.max(-1.0), high: found.high.min(1.0) }
    }

    /// The inverse of the tangent.
    #[must_use]
    pub fn atan(self) -> Self {
        self.increasing(elementary::atan)
    }

    /// The sine.
    #[must_use]
    pub fn sin(self) -> Self {
        self.wave(0)
    }

    /// The cosine.
    #[must_use]
    pub fn cos(self) -> Self {
        self.wave(1)
    }

    /// The sine or the cosine: by the middle, off by the radius at most.
    fn wave(self, which: usize) -> Self {
        let (middle, radius) = self.split();
        let at = elementary::sin_cos(middle)[which];
        let found = Self::of(at) + Self { low: -radius, high: radius };
        Self { low: found.low.max(-1.0), high: found.high.min(1.0) }
    }

    /// A number in the middle, and a radius around it that covers the interval.
    pub(crate) fn split(self) -> (f64, f64) {
        let middle = 0.5 * self.low + 0.5 * self.high;
        (middle, (self.high - middle).max(middle - self.low).next_up())
    }

    /// x^p: by multiplications for whole p, else for positive x.
    #[must_use]
    pub fn power(self, p: f64) -> Self {
        if let Some(n) = whole(p) {
            let found = (0..n.unsigned_abs()).fold(Self::point(1.0), |product, _| product * self);
            return if n < 0 { found.recip() } else { found };
        }
        let [low, high] = [self.low, self.high].map(|x| Self::of(elementary::power(x, p)));
        low.hull(high)
    }
}

/// A whole exponent of at most 32.
pub(crate) fn whole(p: f64) -> Option<i32> {
    #[expect(clippy::cast_possible_truncation, reason = "at most 32")]
    (p.fract().abs() < f64::MIN_POSITIVE && p.abs() <= 32.0).then_some(p as i32)
}

impl Add for Interval {
    type Output = Self;
    fn add(self, b: Self) -> Self {
        Self::outward(self.low + b.low, self.high + b.high)
    }
}

impl Neg for Interval {
    type Output = Self;
    fn neg(self) -> Self {
        Self { low: -self.high, high: -self.low }
    }
}

impl Sub for Interval {
    type Output = Self;
    fn sub(self, b: Self) -> Self {
        self + -b
    }
}

impl Mul for Interval {
    type Output = Self;
    fn mul(self, b: Self) -> Self {
        let ends = [self.low * b.low, self.low * b.high, self.high * b.low, self.high * b.high];
        if ends.iter().any(|end| end.is_nan()) {
            return Self::ENTIRE;
        }
        let [low, high] = [f64::min, f64::max].map(|pick| ends.into_iter().fold(ends[0], pick));
        Self::outward(low, high)
    }
}

impl Div for Interval {
    type Output = Self;
    #[expect(clippy::suspicious_arithmetic_impl, reason = "by the reciprocal")]
    fn div(self, b: Self) -> Self {
        self * b.recip()
    }
}
