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

    /// Moves on by one step: those of stage j take the place of stage j-1's, the last stay.
    pub fn shift(&mut self, dims: OcpDims) {
        drop_first(&mut self.dynamics, dims.nx);
        shift_unknowns(&mut self.bounds, dims);
        drop_first(&mut self.increments, dims.nu);
        drop_first(&mut self.rows, dims.rows());
    }
}

fn shift_unknowns(vector: &mut [f64], dims: OcpDims) {
    let (x, u) = vector.split_at_mut(dims.all_states());
    drop_first(x, dims.nx);
    drop_first(u, dims.nu);
}

/// Drops the first `width` numbers and keeps the last ones twice.
fn drop_first(values: &mut [f64], width: usize) {
    if values.len() > width {
        values.copy_within(width.., 0);
    }
}
