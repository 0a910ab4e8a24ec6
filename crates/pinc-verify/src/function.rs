//! The functions of equations and nets: values, and bounds of their Taylor coefficients.

use crate::elementary::{self, Approximate};
use crate::interval::{Interval, whole};
use crate::rounding::{to_f64, up};
use std::f64::consts::PI;

/// A smooth function of one number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Smooth {
    Recip,
    Sqrt,
    Exp,
    Ln,
    Sin,
    Cos,
    Atan,
    Tanh,
    Power(f64),
}

/// Terms of the sum in the bound for tanh that are added one by one.
const POLES: usize = 6;

impl Smooth {
    /// The value at one number.
    pub(crate) fn value(self, x: f64) -> Approximate {
        match self {
            Self::Recip => Approximate::rounded(1.0 / x),
            Self::Sqrt => Approximate::rounded(x.sqrt()),
            Self::Exp => elementary::exp(x),
            Self::Ln => elementary::ln(x),
            Self::Sin => elementary::sin_cos(x)[0],
            Self::Cos => elementary::sin_cos(x)[1],
            Self::Atan => elementary::atan(x),
            Self::Tanh => elementary::tanh(x),
            Self::Power(p) => match whole(p) {
                Some(_) => {
                    let found = Interval::point(x).power(p);
                    let value = 0.5 * found.low + 0.5 * found.high;
                    Approximate { value, error: up(found.high - found.low) }
                }
                None => elementary::power(x, p),
            },
        }
    }

    /// Whether the function is analytic on all of `on`.
    pub(crate) fn is_smooth(self, on: Interval) -> bool {
        match self {
            Self::Recip => !on.contains(0.0),
            Self::Sqrt | Self::Ln => on.low > 0.0,
            Self::Exp | Self::Sin | Self::Cos | Self::Atan | Self::Tanh => true,
            Self::Power(p) => match whole(p) {
                Some(n) => n >= 0 || !on.contains(0.0),
                None => on.low > 0.0,
            },
        }
    }

    /// A bound of the absolute value of the Taylor coefficient of order `n`, 1 at least, at any
    /// point of `on`, where the function is smooth.
    ///
    /// Sine and cosine: 1/n!. Atan: 1 / (n (1 + x^2)^(n/2)), since 1 / (1 + x^2) is the imaginary
    /// part of 1 / (x - i), whose coefficients are a geometric series. Tanh: its poles are at i pi (k + 1/2) with
    /// residue 1, so that the coefficient is at most 2 sum over k >= 0 of (x^2 + (pi (k +
    /// 1/2))^2)^(-(n + 1)/2); the sum from k = m on is below the integral of (pi s)^(-n - 1) from m.
    pub(crate) fn coefficient_bound(self, n: usize, on: Interval) -> f64 {
        let order = to_f64(n);
        let nearest = on.mignitude();
        let bound = match self {
            Self::Recip => inverse_power(nearest, n + 1),
            Self::Exp => {
                let top = elementary::exp(on.high);
                (top.value + top.error) / factorial(n)
            }
            Self::Ln => inverse_power(nearest, n) / order,
            Self::Sin | Self::Cos => 1.0 / factorial(n),
            Self::Atan => inverse_power(1.0 + nearest * nearest, n).sqrt() / order,
            Self::Tanh => {
                let pole = |k: usize| {
                    let distance = nearest * nearest + (PI * (to_f64(k) + 0.5)).powi(2);
                    inverse_power(distance, n + 1).sqrt()
                };
                let first: f64 = (0..POLES).map(pole).sum();
                let rest = inverse_power(to_f64(POLES), n) / order;
                2.0 * (first + rest * inverse_power(PI, n + 1))
            }
            Self::Sqrt => binomial(0.5, n) * largest_power(on, 0.5 - order),
            Self::Power(p) => {
                let binomial = binomial(p, n);
                // A polynomial of lower degree has no such coefficient.
                if binomial > 0.0 { binomial * largest_power(on, p - order) } else { 0.0 }
            }
        };
        // Up to some 10^3 roundings, each of one unit: powers of up to 21 factors, each factor of
        // a few roundings.
        bound * (1.0 + 1e-12)
    }

    /// A bound of the derivative's absolute value on `on`.
    pub(crate) fn slope_bound(self, on: Interval) -> f64 {
        match self {
            Self::Tanh => {
                // Below 1 the roundings of difference, square and difference sum up to less than 4 u.
                let at = elementary::tanh(on.mignitude());
                let least = (at.value - at.error).max(0.0);
                1.0 - least * least + 1e-15
            }
            _ => self.coefficient_bound(1, on),
        }
    }
}

/// n!
fn factorial(n: usize) -> f64 {
    (1..=n).map(to_f64).product()
}

/// |p (p - 1) .. (p - n + 1)| / n!
fn binomial(p: f64, n: usize) -> f64 {
    (0..n).map(|i| ((p - to_f64(i)) / to_f64(i + 1)).abs()).product()
}

/// x^-n.
fn inverse_power(x: f64, n: usize) -> f64 {
    let power: f64 = std::iter::repeat_n(x, n).product();
    1.0 / power
}

/// The largest |x|^p on `on`, at one of its ends.
fn largest_power(on: Interval, p: f64) -> f64 {
    let ends = [on.mignitude(), on.magnitude()];
    let at = |x: f64| match whole(p) {
        Some(n) if n >= 0 => std::iter::repeat_n(x, n.unsigned_abs() as usize).product(),
        Some(n) => inverse_power(x, n.unsigned_abs() as usize),
        None if x > 0.0 => {
            let found = elementary::power(x, p);
            found.value + found.error
        }
        None => f64::INFINITY,
    };
    at(ends[0]).max(at(ends[1]))
}
