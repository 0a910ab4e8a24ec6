//! Functions of one number as polynomials with a bound of their error.

use crate::function::Smooth;
use crate::interval::Interval;
use crate::rounding::{UNIT, to_f64, up};
use std::f64::consts::PI;

/// The largest degree of a fit.
pub(crate) const MOST: usize = 20;

/// How much larger an interpolant's deviation can be than that at the nodes: its Lebesgue constant,
/// which is at most 2/pi ln(n + 1) + 1 for n + 1 Chebyshev nodes.
const LEBESGUE: f64 = 3.0;

/// Interpolation at the Chebyshev nodes of one degree.
#[derive(Clone, Debug)]
pub(crate) struct Interpolation {
    nodes: Vec<f64>,
    /// From values at the nodes to coefficients of powers, one row per power.
    to_powers: Vec<Vec<f64>>,
}

/// A function on an interval, as a polynomial of (x - middle) / radius.
#[derive(Clone, Debug)]
pub(crate) struct Fit {
    /// The coefficients of the powers 0, 1, ..
    pub(crate) powers: Vec<f64>,
    /// A bound of the error on the interval, without the error of evaluating the polynomial.
    pub(crate) error: f64,
    /// A bound of the function's slope on the interval.
    pub(crate) slope: f64,
}

impl Interpolation {
    /// By polynomials of degree `degree`, [`MOST`] at most.
    pub(crate) fn new(degree: usize) -> Self {
        let degree = degree.min(MOST);
        let count = to_f64(degree + 1);
        let angle = |i: usize| PI * (to_f64(i) + 0.5) / count;
        let nodes: Vec<f64> = (0..=degree).map(|i| angle(i).cos()).collect();
        let mut to_powers = vec![vec![0.0; degree + 1]; degree + 1];
        // T_0 and T_1 in powers; the next by T_(m+1) = 2 x T_m - T_(m-1).
        let (mut polynomial, mut next) = (vec![0.0; degree + 2], vec![0.0; degree + 2]);
        (polynomial[0], next[1]) = (1.0, 1.0);
        for m in 0..=degree {
            let scale = if m == 0 { 1.0 } else { 2.0 } / count;
            for (row, coefficient) in to_powers.iter_mut().zip(&polynomial) {
                for (i, to) in row.iter_mut().enumerate() {
                    *to += scale * (to_f64(m) * angle(i)).cos() * coefficient;
                }
            }
            let shifted = |i: usize| i.checked_sub(1).map_or(0.0, |below| 2.0 * next[below]);
            let after = (0..next.len()).map(|i| shifted(i) - polynomial[i]).collect();
            (polynomial, next) = (next, after);
        }
        Self { nodes, to_powers }
    }

    /// The degree of the polynomials.
    pub(crate) fn degree(&self) -> usize {
        self.nodes.len() - 1
    }

    /// The function within `radius` of `middle`; none where it is not smooth or not finite.
    ///
    /// With n + 1 nodes the interpolant is off by the product of the distances from the nodes, times
    /// the largest Taylor coefficient of order n + 1. For Chebyshev nodes the product is at most
    /// radius^(n + 1) / 2^n; nodes that are off by 10 u change it by a factor of less than
    /// 1 + 30 (n + 1)^2 u (by Markov's inequality and the Lebesgue constant), for which `up` has room.
    /// The polynomial that is returned need not be the interpolant: how far it is from the function
    /// at the nodes is computed, and that times the Lebesgue constant added.
    pub(crate) fn fit(&self, function: Smooth, middle: f64, radius: f64) -> Option<Fit> {
        let on = Interval::around(middle, radius);
        let degree = self.nodes.len() - 1;
        if !(on.low.is_finite() && on.high.is_finite() && function.is_smooth(on)) {
            return None;
        }
        let values: Vec<_> =
            self.nodes.iter().map(|node| function.value(middle + radius * node)).collect();
        let power = |row: &Vec<f64>| row.iter().zip(&values).map(|(a, v)| a * v.value).sum();
        let powers: Vec<f64> = self.to_powers.iter().map(power).collect();
        let size: f64 = powers.iter().map(|power| power.abs()).sum();
        let deviation = self.nodes.iter().zip(&values).map(|(node, at)| {
            let fitted = powers.iter().rev().fold(0.0, |sum, power| sum * node + power);
            (fitted - at.value).abs() + at.error
        });
        let deviation = deviation.fold(0.0, f64::max) + 4.0 * to_f64(degree + 1) * UNIT * size;
        let slope = function.slope_bound(on);
        // The nodes in x are rounded.
        let shift = slope * 4.0 * UNIT * (middle.abs() + radius);
        let product = (0..degree).fold(radius, |product, _| product * 0.5 * radius);
        let remainder = function.coefficient_bound(degree + 1, on) * product;
        let error = up(remainder + LEBESGUE * (deviation + shift));
        (error.is_finite() && slope.is_finite()).then_some(Fit { powers, error, slope })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{Numbers, exact, zero};
    use num_rational::BigRational;

    #[test]
    fn fits_are_as_close_as_they_say_and_not_much_closer() {
        for (function, middle) in [
            (Smooth::Tanh, 0.4),
            (Smooth::Tanh, -3.0),
            (Smooth::Sqrt, 2.0),
            (Smooth::Exp, 1.0),
            (Smooth::Ln, 2.0),
            (Smooth::Sin, 7.0),
            (Smooth::Cos, -2.0),
            (Smooth::Atan, 0.7),
            (Smooth::Recip, -2.0),
            (Smooth::Power(1.7), 2.0),
            (Smooth::Power(-3.0), 2.0),
        ] {
            for degree in [2, 4, 6] {
                let fit = Interpolation::new(degree).fit(function, middle, 0.3).unwrap();
                let off = |i: u32| {
                    let t = f64::from(i) / 500.0 - 1.0;
                    let fitted = fit.powers.iter().rev().fold(0.0, |sum, power| sum * t + power);
                    (fitted - function.value(middle + 0.3 * t).value).abs()
                };
                let found = (0..=1000).map(off).fold(0.0, f64::max);
                assert!(found <= fit.error, "{function:?} {degree}: {found} {}", fit.error);
                // The Taylor coefficient is bounded at the worst point and phase.
                assert!(fit.error < 30.0 * found + 1e-14, "{function:?} {degree}: {found}");
            }
        }
        let fit = |function, middle| Interpolation::new(3).fit(function, middle, 0.3);
        assert!(fit(Smooth::Sqrt, 0.2).is_none() && fit(Smooth::Recip, -0.1).is_none());
        assert!(fit(Smooth::Ln, 0.0).is_none() && fit(Smooth::Exp, f64::NAN).is_none());
        assert!(fit(Smooth::Power(0.5), 0.1).is_none() && fit(Smooth::Power(2.0), 0.1).is_some());
    }
    /// The largest distance from the function at the nodes, exactly: of the polynomial from the
    /// computed value, what that is off by, and what the rounded argument makes of the slope.
    fn distance(over: &Interpolation, fit: &Fit, function: Smooth, at: [f64; 2]) -> BigRational {
        let [middle, radius] = at;
        let distances = over.nodes.iter().map(|node| {
            let argument = middle + radius * node;
            let value = function.value(argument);
            let powers = fit.powers.iter().rev();
            let fitted = powers.fold(zero(), |sum, power| sum * exact(*node) + exact(*power));
            let shift = exact(argument) - (exact(middle) + exact(radius) * exact(*node));
            size(fitted - exact(value.value)) + exact(value.error) + exact(fit.slope) * size(shift)
        });
        distances.max().expect("there are nodes")
    }

    fn size(of: BigRational) -> BigRational {
        if of < zero() { -of } else { of }
    }

    /// Cases in which each part in turn is larger than what the others exceed their due by: the
    /// distance at the nodes (many powers), their rounded arguments (large slopes), the evaluation
    /// (powers that cancel), the error of the values (large exponents), and the interpolation.
    #[test]
    fn each_part_of_a_fits_error_is_needed() {
        let mut numbers = Numbers::new();
        for _ in 0..20 {
            let cases = [
                (Smooth::Exp, 16, [numbers.between(-1.0, 1.0), 0.1]),
                (Smooth::Exp, 8, [numbers.between(600.0, 601.0), 0.7]),
                (Smooth::Sin, 20, [numbers.between(-1.0, 1.0), numbers.between(4.0, 8.0)]),
                (Smooth::Sin, 2, [numbers.between(-1.0, 1.0), numbers.between(100.0, 300.0)]),
                (Smooth::Power(1.5), 2, [1e150 * numbers.between(1.0, 2.0), 1e100]),
                (Smooth::Power(3.0), 4, [1e6 * numbers.between(1.0, 2.0), 1e-3]),
                (Smooth::Tanh, 6, [numbers.between(2.0, 3.0), 0.3]),
            ];
            for (function, degree, at) in cases {
                let over = Interpolation::new(degree);
                let fit = over.fit(function, at[0], at[1]).unwrap();
                let on = Interval::around(at[0], at[1]);
                // With the function's largest coefficient of the next order.
                let mut needed = exact(function.coefficient_bound(degree + 1, on));
                for _ in 0..=degree {
                    needed *= exact(at[1]);
                }
                needed *= exact(0.5_f64.powi(i32::try_from(degree).unwrap()));
                needed += exact(LEBESGUE) * distance(&over, &fit, function, at);
                assert!(needed <= exact(fit.error), "{function:?} {degree} {at:?}");
                assert!(fit.slope >= function.slope_bound(on));
            }
        }
        let most = 2.0 / PI * to_f64(MOST + 1).ln() + 1.0;
        assert!(LEBESGUE >= most * (1.0 + 1e-6));
        let over = Interpolation::new(4);
        assert!(over.fit(Smooth::Sin, f64::MAX, f64::MAX).is_none());
        assert!(over.fit(Smooth::Exp, 650.0, 100.0).is_none());
    }
}
