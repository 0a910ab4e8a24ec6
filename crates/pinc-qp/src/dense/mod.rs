//! Small dense quadratic programs.

mod active_set;
mod proximal;
#[cfg(test)]
mod tests;

pub(super) use active_set::{ActiveSet, DenseStatus};

use super::algebra::{add_scaled, dot};

/// A strictly convex quadratic program in x, of n unknowns and r rows:
///
/// ```text
/// min  x'H x / 2 + g'x + sum_i cap_i violation_i
/// s.t. low <= (x, C x) <= high        row i with a finite cap_i may be violated
/// ```
///
/// A row is soft by an exact penalty: its multiplier cannot exceed `cap_i`, and where it would have
/// to, the row is violated and its multiplier is `cap_i`. With an infinite penalty the row is hard.
#[derive(Clone, Debug)]
pub(super) struct DenseQp {
    /// n
    pub(super) unknowns: usize,
    /// r
    pub(super) rows: usize,
    /// H, `[n, n]`; only the lower triangle, column by column, is read.
    pub(super) hessian: Vec<f64>,
    /// g, `n`.
    pub(super) gradient: Vec<f64>,
    /// C, column by column, `[n, r]`.
    pub(super) matrix: Vec<f64>,
    /// Lower bounds, finite or minus infinity, `n + r`: of the unknowns, then of the rows of C.
    pub(super) low: Vec<f64>,
    /// Upper bounds, finite or infinity, `n + r`. Equal bounds are an equality.
    pub(super) high: Vec<f64>,
    /// Largest absolute multipliers, positive, `n + r`.
    pub(super) penalty: Vec<f64>,
}

impl DenseQp {
    pub(super) fn new(unknowns: usize, rows: usize) -> Self {
        Self {
            unknowns,
            rows,
            hessian: vec![0.0; unknowns * unknowns],
            gradient: vec![0.0; unknowns],
            matrix: vec![0.0; unknowns * rows],
            low: vec![f64::NEG_INFINITY; unknowns + rows],
            high: vec![f64::INFINITY; unknowns + rows],
            penalty: vec![f64::INFINITY; unknowns + rows],
        }
    }

    /// Writes the normal of constraint `i`: a unit vector or a row of C.
    fn normal(&self, i: usize, normal: &mut [f64]) {
        if let Some(row) = i.checked_sub(self.unknowns) {
            let entries = self.matrix[row..].iter().step_by(self.rows);
            normal.iter_mut().zip(entries).for_each(|(normal, entry)| *normal = *entry);
        } else {
            normal.fill(0.0);
            normal[i] = 1.0;
        }
    }

    /// Writes g + H x.
    fn slope(&self, x: &[f64], slope: &mut [f64]) {
        slope.copy_from_slice(&self.gradient);
        for (c, column) in self.hessian.chunks_exact(self.unknowns).enumerate() {
            add_scaled(&mut slope[c..], x[c], &column[c..]);
            slope[c] += dot(&column[c + 1..], &x[c + 1..]);
        }
    }

    /// Writes (x, C x).
    fn values(&self, x: &[f64], values: &mut [f64]) {
        let (unknowns, rows) = values.split_at_mut(self.unknowns);
        unknowns.copy_from_slice(x);
        rows.fill(0.0);
        if self.rows > 0 {
            for (&x, column) in x.iter().zip(self.matrix.chunks_exact(self.rows)) {
                add_scaled(rows, x, column);
            }
        }
    }
}
