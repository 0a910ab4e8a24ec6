//! The growth of errors along a flow: the logarithmic norm, component by component.

use crate::interval::Interval;
use crate::rounding::{to_f64, up};

/// Bounds of exp(M s), at s = 1 and at all s in \[0, 1\], for a matrix M whose entries are at least
/// h J on the diagonal and h |J| off it.
///
/// Errors of a flow obey `|e_i|' <= J_ii |e_i| + sum over j of |J_ij| |e_j| + |defect_i|` (the
/// logarithmic norm; Söderlind, BIT 46, 2006, 631), so that |e| stays below the solution of the
/// linear equation with M.
///
/// Rounding: the series is rounded up once. Its entries are sums of products of at most [`TERMS`]
/// entries of M, which are not negative but for the diagonal; the shift of that counts by e^-c alone,
/// where c is below 700 or the bound of e^-c far too large. All this changes the entries by a factor
/// of less than 1 + 1e-12, and `up` has room for 1e-10. In sums and products of entries the room
/// grows as the errors do. What is added to the series is more than what may underflow of entries.
#[derive(Clone, Debug)]
pub(crate) struct Growth {
    end: Vec<Vec<f64>>,
    largest: Vec<Vec<f64>>,
}

/// Terms of the exponential's series, for matrices with a norm of at most 1/2.
const TERMS: usize = 14;

impl Growth {
    /// That over `h` seconds with a Jacobian in `jacobian`, row by row; none if it is not bounded.
    pub(crate) fn new(jacobian: &[Interval], n: usize, h: f64) -> Option<Self> {
        let row = |i: usize, row: &[Interval]| -> Vec<f64> {
            let entry = |(j, of): (usize, &Interval)| match i == j {
                true => of.high * h,
                false => of.magnitude() * h,
            };
            row.iter().enumerate().map(entry).collect()
        };
        let m: Vec<_> = jacobian.chunks_exact(n).enumerate().map(|(i, of)| row(i, of)).collect();
        let shift = (0..n).map(|i| -m[i][i]).fold(0.0, f64::max);
        let mut shifted = m.clone();
        let mut largest = m;
        for i in 0..n {
            shifted[i][i] += shift;
            largest[i][i] = largest[i][i].max(0.0);
        }
        // exp(M) = exp(-c) exp(M + c I).
        let falling = Interval::point(-shift).exp().high;
        let mut end = exponential(shifted)?;
        end.iter_mut().flatten().for_each(|entry| *entry *= falling);
        Some(Self { end, largest: exponential(largest)? })
    }

    /// Bounds of the error at the end, and at any time before, of an error `start` at the beginning
    /// and a defect whose integral is at most `defect`.
    pub(crate) fn propagate(&self, start: &[f64], defect: &[f64]) -> [Vec<f64>; 2] {
        let both: Vec<f64> = start.iter().zip(defect).map(|(a, b)| a + b).collect();
        let end = product(&self.end, start).into_iter().zip(product(&self.largest, defect));
        let end = end.map(|(a, b)| a + b).collect();
        [end, product(&self.largest, &both)]
    }
}

fn product(matrix: &[Vec<f64>], vector: &[f64]) -> Vec<f64> {
    // Products of small numbers may underflow.
    let row = |row: &Vec<f64>| {
        row.iter().zip(vector).map(|(a, b)| a * b).sum::<f64>() + f64::MIN_POSITIVE
    };
    matrix.iter().map(row).collect()
}

fn multiply(a: &[Vec<f64>], b: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let n = a.len();
    let entry = |i: usize, j: usize| (0..n).map(|k| a[i][k] * b[k][j]).sum();
    (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect()
}

/// An upper bound of the exponential of a matrix without negative entries, by scaling and squaring;
/// none if it overflows.
fn exponential(mut of: Vec<Vec<f64>>) -> Option<Vec<Vec<f64>>> {
    let n = of.len();
    let norm = of.iter().map(|row| row.iter().sum()).fold(0.0, f64::max);
    let mut halvings = 0;
    while norm * 0.5_f64.powi(halvings) > 0.5 {
        halvings += 1;
        if halvings > 20 {
            return None;
        }
    }
    of.iter_mut().flatten().for_each(|entry| *entry *= 0.5_f64.powi(halvings));
    let identity = |i: usize, j: usize| if i == j { 1.0 } else { 0.0 };
    let mut term: Vec<Vec<f64>> =
        (0..n).map(|i| (0..n).map(|j| identity(i, j)).collect()).collect();
    let mut sum = term.clone();
    for k in 1..=TERMS {
        term = multiply(&term, &of);
        for (sum, term) in sum.iter_mut().flatten().zip(term.iter_mut().flatten()) {
            *term /= to_f64(k);
            *sum += *term;
        }
    }
    // The terms left out sum up to less than 2 0.5^15 / 15! in norm.
    sum.iter_mut().flatten().for_each(|entry| *entry = up(*entry + 1e-16));
    for _ in 0..halvings {
        sum = multiply(&sum, &sum);
    }
    sum.iter().flatten().all(|entry| entry.is_finite()).then_some(sum)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn growth_matches_the_exponential() {
        // J = [-2 1; 0 3], h = 1: exp has e^-2, e^3 and (e^3 - e^-2) / 5.
        let jacobian = [[-2.0, -2.0], [-1.0, 1.0], [0.0, 0.0], [3.0, 3.0]];
        let jacobian = jacobian.map(|[low, high]| Interval { low, high });
        let growth = Growth::new(&jacobian, 2, 1.0).unwrap();
        let (a, b) = ((-2.0_f64).exp(), 3.0_f64.exp());
        let [end, _] = growth.propagate(&[1.0, 1.0], &[0.0, 0.0]);
        let close = |found: f64, exact: f64| found >= exact && found < exact * (1.0 + 1e-7);
        assert!(close(end[0], a + (b - a) / 5.0) && close(end[1], b), "{end:?}");
        // A defect may act at the very end, or at the beginning: the first state's does not fall.
        let [end, before] = growth.propagate(&[0.0, 0.0], &[1.0, 0.0]);
        assert!(close(end[0], 1.0) && close(before[0], 1.0), "{end:?}");
        assert!(Growth::new(&[Interval::ENTIRE], 1, 1.0).is_none());
    }
}
