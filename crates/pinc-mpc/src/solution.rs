//! A plan and its multipliers.

use crate::shape::Shape;

/// A plan with its multipliers; if it is optimal, a stationary point of the Lagrangian
///
/// ```text
/// L = J + sum_{j=0..N2-1} lambda_j' (f(x_j, u_j) - x_{j+1}) + mu' z + sum_{i=0..Nu-1} nu_i' (u_i - u_{i-1})
///       + sum_{j=N1..N2} eta_j' (h(x_j, u_j), g(x_j, u_j)),            z = (x_1, .., u_0, ..)
/// ```
///
/// in which `x_j` is `x[k+j]` and `u_j` is `u[k+min(j, Nu-1)]`. A positive multiplier belongs to an upper
/// bound, a negative one to a lower bound. Where a soft constraint is violated, its multiplier is
/// the weight of the violation.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    shape: Shape,
    /// z
    pub(crate) z: Vec<f64>,
    pub(crate) multipliers: Multipliers,
}

/// The multipliers of all constraints.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Multipliers {
    /// lambda, of the dynamics, `[N, n]`.
    pub(crate) dynamics: Vec<f64>,
    /// mu, of the bounds, as long as z.
    pub(crate) bounds: Vec<f64>,
    /// nu, of the bounds on increments, `[Nu, m]`.
    pub(crate) increments: Vec<f64>,
    /// eta, of h and g, `[N - N1 + 1, rows]`.
    pub(crate) rows: Vec<f64>,
}

impl Multipliers {
    pub(crate) fn new(shape: Shape) -> Self {
        Self {
            dynamics: vec![0.0; shape.all_states()],
            bounds: vec![0.0; shape.unknowns()],
            increments: vec![0.0; shape.all_inputs()],
            rows: vec![0.0; shape.all_rows()],
        }
    }

    /// The parts, in the order of the fields.
    pub(crate) fn parts(&self) -> [&[f64]; 4] {
        [&self.dynamics, &self.bounds, &self.increments, &self.rows]
    }

    /// The parts, in the order of the fields.
    pub(crate) fn parts_mut(&mut self) -> [&mut [f64]; 4] {
        [&mut self.dynamics, &mut self.bounds, &mut self.increments, &mut self.rows]
    }

    pub(crate) fn copy_from(&mut self, other: &Self) {
        for (to, from) in self.parts_mut().into_iter().zip(other.parts()) {
            to.copy_from_slice(from);
        }
    }

    pub(crate) fn clear(&mut self) {
        self.parts_mut().into_iter().for_each(|part| part.fill(0.0));
    }

    /// Moves on by one step.
    fn shift(&mut self, shape: Shape) {
        drop_first(&mut self.dynamics, shape.states);
        shift_unknowns(&mut self.bounds, shape);
        drop_first(&mut self.increments, shape.inputs);
        drop_first(&mut self.rows, shape.rows());
    }
}

impl Solution {
    pub(crate) fn new(shape: Shape) -> Self {
        Self { shape, z: vec![0.0; shape.unknowns()], multipliers: Multipliers::new(shape) }
    }

    /// The planned states x\[k+1\]..x\[k+N2\], `[N2, n]`.
    #[must_use]
    pub fn states(&self) -> &[f64] {
        &self.z[..self.shape.all_states()]
    }

    /// The planned inputs u\[k\]..u\[k+Nu-1\], `[Nu, m]`.
    #[must_use]
    pub fn inputs(&self) -> &[f64] {
        &self.z[self.shape.all_states()..]
    }

    /// lambda, `[N2, n]`.
    #[must_use]
    pub fn dynamics_multipliers(&self) -> &[f64] {
        &self.multipliers.dynamics
    }

    /// mu of the states, `[N2, n]`.
    #[must_use]
    pub fn state_multipliers(&self) -> &[f64] {
        &self.multipliers.bounds[..self.shape.all_states()]
    }

    /// mu of the inputs, `[Nu, m]`.
    #[must_use]
    pub fn input_multipliers(&self) -> &[f64] {
        &self.multipliers.bounds[self.shape.all_states()..]
    }

    /// nu, `[Nu, m]`.
    #[must_use]
    pub fn increment_multipliers(&self) -> &[f64] {
        &self.multipliers.increments
    }

    /// eta, `[N2 - N1 + 1, rows]`: at each stage those of h, then those of g.
    #[must_use]
    pub fn constraint_multipliers(&self) -> &[f64] {
        &self.multipliers.rows
    }

    /// The input to apply now.
    pub(crate) fn first_input(&self) -> &[f64] {
        &self.z[self.shape.input(0)]
    }

    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.z.copy_from_slice(&other.z);
        self.multipliers.copy_from(&other.multipliers);
    }

    /// Sets all to 0.
    pub(crate) fn clear(&mut self) {
        self.z.fill(0.0);
        self.multipliers.clear();
    }

    /// Moves the plan on by one step: stage j takes the place of stage j-1, the last one stays.
    pub(crate) fn shift(&mut self) {
        shift_unknowns(&mut self.z, self.shape);
        self.multipliers.shift(self.shape);
    }

    /// Plans to stay at `x`; the planned inputs are kept. What is known nothing of, the
    /// multipliers, is 0.
    pub(crate) fn stay_at(&mut self, x: &[f64]) {
        let all_states = self.shape.all_states();
        for state in self.z[..all_states].chunks_exact_mut(x.len()) {
            state.copy_from_slice(x);
        }
        self.multipliers.clear();
    }
}

fn shift_unknowns(vector: &mut [f64], shape: Shape) {
    let (x, u) = vector.split_at_mut(shape.all_states());
    drop_first(x, shape.states);
    drop_first(u, shape.inputs);
}

/// Drops the first `width` numbers and keeps the last ones twice.
fn drop_first(values: &mut [f64], width: usize) {
    if values.len() > width {
        values.copy_within(width.., 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shifting_keeps_the_last_stage() {
        let shape = Shape {
            states: 2,
            inputs: 1,
            stages: 3,
            moves: 1,
            first: 2,
            inequalities: 1,
            equalities: 0,
        };
        let mut solution = Solution::new(shape);
        solution.z = vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
        solution.multipliers.dynamics = vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        solution.multipliers.rows = vec![1.0, 2.0];
        solution.shift();
        assert_eq!(solution.states(), [3.0, 4.0, 5.0, 6.0, 5.0, 6.0]);
        assert_eq!(solution.inputs(), [7.0]);
        assert_eq!(solution.dynamics_multipliers(), [3.0, 4.0, 5.0, 6.0, 5.0, 6.0]);
        assert_eq!(solution.constraint_multipliers(), [2.0, 2.0]);
    }
}
