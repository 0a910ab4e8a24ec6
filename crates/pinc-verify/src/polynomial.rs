//! Bounds of one polynomial on its box, by cutting the box.

use crate::basis::Basis;
use crate::rounding::{UNIT, to_f64, up};

/// A polynomial of the variables of a basis, each in [-1, 1].
#[derive(Clone, Debug)]
pub(crate) struct Polynomial {
    pub(crate) coefficients: Vec<f64>,
    /// What rounding may have changed it by.
    pub(crate) rounding: f64,
}

/// What cutting needs to know of a basis.
#[derive(Clone, Debug)]
pub(crate) struct Cuts {
    exponents: Vec<Vec<u8>>,
    /// For each variable and monomial: the places of those with a lower or the same exponent of
    /// this variable, the lowest first.
    lower: Vec<Vec<Vec<usize>>>,
    binomials: Vec<Vec<f64>>,
}

/// What is known of the absolute value of a polynomial.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AbsoluteBound {
    /// It is nowhere larger.
    pub(crate) most: f64,
    /// Somewhere it is at least this.
    pub(crate) least: f64,
}

/// Parts of a box that are looked at, at most.
const MOST_PARTS: usize = 400;

impl Cuts {
    pub(crate) fn new(basis: &Basis) -> Self {
        let exponents: Vec<Vec<u8>> =
            (0..basis.monomials()).map(|place| basis.exponents(place).to_vec()).collect();
        let place = |of: &[u8]| exponents.iter().position(|other| other == of);
        let lower_of = |of: &Vec<u8>, variable: usize| {
            let with = |power| {
                let mut other = of.clone();
                other[variable] = power;
                place(&other)
            };
            (0..=of[variable]).filter_map(with).collect()
        };
        let lower = (0..basis.variables())
            .map(|variable| exponents.iter().map(|of| lower_of(of, variable)).collect());
        let lower = lower.collect();
        let mut binomials: Vec<Vec<f64>> = vec![vec![1.0]];
        for n in 1..=basis.degree() {
            let above = &binomials[n - 1];
            let entry = |k: usize| {
                above.get(k).copied().unwrap_or(0.0)
                    + k.checked_sub(1).map_or(0.0, |left| above[left])
            };
            binomials.push((0..=n).map(entry).collect());
        }
        Self { exponents, lower, binomials }
    }

    /// A range of the polynomial: monomials with even exponents alone are nowhere negative.
    fn range(&self, of: &Polynomial) -> [f64; 2] {
        let (mut below, mut above) = (0.0, 0.0);
        let rest = of.coefficients.iter().zip(&self.exponents).skip(1);
        for (coefficient, exponents) in rest {
            let even = exponents.iter().all(|power| power % 2 == 0);
            if !(even && *coefficient > 0.0) {
                below += coefficient.abs();
            }
            if !(even && *coefficient < 0.0) {
                above += coefficient.abs();
            }
        }
        let middle = of.coefficients[0];
        // For the last difference and sum, as far as they come from the middle; for the rest `up` has
        // room.
        let slack = of.rounding + 4.0 * UNIT * middle.abs();
        [middle - up(below + slack), middle + up(above + slack)]
    }

    /// How much the monomials change with each variable: the sum of the absolute coefficients, times
    /// the exponents. `degree` is the lowest that counts.
    pub(crate) fn changes(&self, coefficients: &[f64], degree: u32) -> Vec<f64> {
        let mut sums = vec![0.0; self.lower.len()];
        for (coefficient, exponents) in coefficients.iter().zip(&self.exponents) {
            if exponents.iter().map(|power| u32::from(*power)).sum::<u32>() >= degree {
                for (sum, power) in sums.iter_mut().zip(exponents) {
                    *sum += coefficient.abs() * f64::from(*power);
                }
            }
        }
        sums
    }

    /// The polynomial on the lower or upper half of a variable: x = (y + side) / 2.
    pub(crate) fn half(&self, of: &Polynomial, variable: usize, side: f64) -> Polynomial {
        let mut coefficients = vec![0.0; of.coefficients.len()];
        let mut size = 0.0;
        for (place, coefficient) in of.coefficients.iter().enumerate() {
            let lower = &self.lower[variable][place];
            let power = lower.len() - 1;
            let all = coefficient * HALVES[power];
            size += coefficient.abs();
            for (j, to) in lower.iter().enumerate() {
                let sign = if (power - j) % 2 == 1 { side } else { 1.0 };
                coefficients[*to] += all * self.binomials[power][j] * sign;
            }
        }
        // The absolute values of what each coefficient is split into sum up to its own.
        let units = 2.0 * to_f64(self.binomials.len() + 2) * UNIT;
        Polynomial { coefficients, rounding: up(of.rounding + units * size) }
    }

    /// Bounds of the absolute value of `of` on its box, with cuts until it is known to be at most
    /// `goal` everywhere, or larger somewhere.
    pub(crate) fn bound(&self, of: &Polynomial, goal: f64) -> AbsoluteBound {
        let largest = |[low, high]: [f64; 2]| low.abs().max(high.abs());
        let whole = largest(self.range(of));
        let at_middle = |of: &Polynomial| (of.coefficients[0].abs() - of.rounding).max(0.0);
        let mut found = AbsoluteBound { most: 0.0, least: at_middle(of) };
        let mut open = vec![of.clone()];
        let mut parts = 0;
        while let Some(part) = open.pop() {
            let most = largest(self.range(&part));
            parts += 1;
            found.least = found.least.max(at_middle(&part));
            if most <= goal {
                found.most = found.most.max(most);
                continue;
            }
            let changes = self.changes(&part.coefficients, 1);
            let largest = (0..changes.len()).max_by(|a, b| changes[*a].total_cmp(&changes[*b]));
            let Some(variable) = largest.filter(|_| found.least <= goal && parts < MOST_PARTS)
            else {
                return AbsoluteBound { most: whole, ..found };
            };
            open.extend([-1.0, 1.0].map(|side| self.half(&part, variable, side)));
        }
        found
    }
}

/// 2^-n
const HALVES: [f64; 21] = {
    let mut halves = [1.0; 21];
    let mut n = 1;
    while n < 21 {
        halves[n] = halves[n - 1] * 0.5;
        n += 1;
    }
    halves
};

#[cfg(test)]
mod tests {
    use super::*;

    /// 1 + 2 x - 3 x y^2 + y^3 and parts of it.
    #[test]
    fn halves_and_bounds_of_a_polynomial() {
        let basis = Basis::of_space(2, 3);
        let cuts = Cuts::new(&basis);
        let mut coefficients = vec![0.0; basis.monomials()];
        for (exponents, value) in [([0, 0], 1.0), ([1, 0], 2.0), ([1, 2], -3.0), ([0, 3], 1.0)] {
            let place = (0..basis.monomials()).find(|place| basis.exponents(*place) == exponents);
            coefficients[place.unwrap()] = value;
        }
        let of = Polynomial { coefficients, rounding: 0.0 };
        let at = |of: &Polynomial, x: f64, y: f64| -> f64 {
            let value = |(place, c): (usize, &f64)| {
                let [a, b] = [0, 1].map(|i| i32::from(basis.exponents(place)[i]));
                c * x.powi(a) * y.powi(b)
            };
            of.coefficients.iter().enumerate().map(value).sum()
        };
        let (left, upper) = (cuts.half(&of, 0, -1.0), cuts.half(&of, 1, 1.0));
        for (x, y) in [(0.3, -0.8), (-1.0, 0.5), (0.0, 0.0), (1.0, 1.0)] {
            assert!((at(&left, x, y) - at(&of, 0.5 * (x - 1.0), y)).abs() < 1e-14);
            assert!((at(&upper, x, y) - at(&of, x, 0.5 * (y + 1.0))).abs() < 1e-14);
        }
        // The largest absolute value is 3, at (1, 0) and at (-1, 1); without cuts it is 7.
        let [low, high] = cuts.range(&of);
        assert!((low + 5.0).abs() < 1e-6 && (high - 7.0).abs() < 1e-6, "{low} {high}");
        let found = cuts.bound(&of, 3.05);
        assert!(found.most >= 3.0 && found.most <= 3.05 && found.least > 2.5, "{found:?}");
        let failed = cuts.bound(&of, 2.9);
        assert!(failed.most > 6.9 && failed.least > 2.0, "{failed:?}");
        assert_eq!(cuts.changes(&of.coefficients, 3), [3.0, 9.0]);
    }
}
