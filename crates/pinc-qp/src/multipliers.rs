//! The multipliers of a control problem.

use crate::{OcpDims, all_finite};

/// The multipliers of all constraints.
#[derive(Clone, Debug, PartialEq)]
pub struct Multipliers {
    /// lambda, of the dynamics, `[N, n]`.
    pub dynamics: Vec<f64>,
    /// mu, of the bounds, as long as z.
    pub bounds: Vec<f64>,
    /// nu, of the bounds on increments, `[Nu, m]`.
    pub increments: Vec<f64>,
    /// eta, of h and g, `[N - N1 + 1, rows]`.
    pub rows: Vec<f64>,
}

impl Multipliers {
    /// All 0.
    #[must_use]
    pub fn new(dims: OcpDims) -> Self {
        Self {
            dynamics: vec![0.0; dims.all_states()],
            bounds: vec![0.0; dims.unknowns()],
            increments: vec![0.0; dims.all_inputs()],
            rows: vec![0.0; dims.all_rows()],
        }
    }

    /// The parts, in the order of the fields.
    #[must_use]
    #[inline]
    pub fn parts(&self) -> [&[f64]; 4] {
        [&self.dynamics, &self.bounds, &self.increments, &self.rows]
    }

    /// The parts, in the order of the fields.
    #[inline]
    pub fn parts_mut(&mut self) -> [&mut [f64]; 4] {
        [&mut self.dynamics, &mut self.bounds, &mut self.increments, &mut self.rows]
    }

    /// Whether all are finite.
    #[must_use]
    #[inline]
    pub fn is_finite(&self) -> bool {
        self.parts().into_iter().all(all_finite)
    }

    /// Takes the values of `other`, of the same sizes.
    #[inline]
    pub fn copy_from(&mut self, other: &Self) {
        for (to, from) in self.parts_mut().into_iter().zip(other.parts()) {
            to.copy_from_slice(from);
        }
    }

    /// Sets all to 0.
    #[inline]
    pub fn clear(&mut self) {
        self.parts_mut().into_iter().for_each(|part| part.fill(0.0));
    }

    /// Shifts by one step: the multipliers of stage j take the place of stage j-1's, the last stay.
    pub fn shift(&mut self, dims: OcpDims) {
        dims.shift(&mut self.dynamics, 1, dims.nx);
        dims.shift_unknowns(&mut self.bounds);
        dims.shift(&mut self.increments, 0, dims.nu);
        dims.shift(&mut self.rows, dims.n1, dims.rows());
    }
}

/// By what residuals that are proportional to the cost are divided: max(1, mean / 100) of the absolute
/// values of all multipliers, as in IPOPT (Waechter and Biegler, Math. Program. 106 (2006), Eq. 6).
#[must_use]
#[inline]
pub fn residual_scale<'m>(multipliers: impl IntoIterator<Item = &'m [f64]>) -> f64 {
    // Sums side by side, which need not wait for each other.
    let (mut sums, mut count) = ([0.0; 8], 0);
    for part in multipliers {
        for chunk in part.chunks(sums.len()) {
            sums.iter_mut().zip(chunk).for_each(|(sum, multiplier)| *sum += multiplier.abs());
        }
        count += part.len();
    }
    scale_of_sum(sums.iter().sum(), count)
}

/// The same, from the sum of `count` absolute values.
pub(crate) fn scale_of_sum(sum: f64, count: usize) -> f64 {
    const LARGE: f64 = 100.0;
    (sum / count.max(1) as f64 / LARGE).max(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbered(first: f64) -> (OcpDims, Multipliers) {
        let dims = OcpDims { n_controls: 2, n1: 2, inequalities: 1, ..OcpDims::new(2, 1, 3) };
        let mut multipliers = Multipliers::new(dims);
        let mut number = first;
        for mu in multipliers.parts_mut().into_iter().flatten() {
            *mu = number;
            number += 1.0;
        }
        (dims, multipliers)
    }

    #[test]
    fn a_shift_drops_the_first_stage_and_keeps_the_last_twice() {
        let (dims, mut multipliers) = numbered(1.0);
        multipliers.shift(dims);
        assert_eq!(multipliers.dynamics, [3.0, 4.0, 5.0, 6.0, 5.0, 6.0]);
        assert_eq!(multipliers.bounds, [9.0, 10.0, 11.0, 12.0, 11.0, 12.0, 14.0, 14.0]);
        assert_eq!(multipliers.increments, [16.0, 16.0]);
        assert_eq!(multipliers.rows, [18.0, 18.0]);
    }

    #[test]
    fn all_parts_are_copied_cleared_and_looked_at() {
        let (dims, multipliers) = numbered(1.0);
        let mut other = Multipliers::new(dims);
        other.copy_from(&multipliers);
        assert_eq!(other, multipliers);
        other.clear();
        assert_eq!(other, Multipliers::new(dims));
        for part in 0..4 {
            let mut bad = multipliers.clone();
            assert!(bad.is_finite());
            bad.parts_mut()[part][1] = f64::NAN;
            assert!(!bad.is_finite(), "part {part}");
        }
    }
}
