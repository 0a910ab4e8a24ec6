//! The unknowns of the control problem and their multipliers.

use crate::{Bounds, NmpcProblem};
use pinc_ode::Dims;
use std::ops::Range;

/// The sizes of a control problem, and where its parts lie in flat vectors.
///
/// The unknowns are `z = (x_1, .., x_N, u_0, .., u_{Nu-1})`, with `x_j` short for `x[k+j]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Shape {
    /// n
    pub(crate) states: usize,
    /// m
    pub(crate) inputs: usize,
    /// N = N2
    pub(crate) stages: usize,
    /// Nu
    pub(crate) moves: usize,
}

impl Shape {
    pub(crate) fn new(problem: &NmpcProblem, dims: Dims) -> Self {
        Self {
            states: dims.states,
            inputs: dims.inputs,
            stages: problem.last,
            moves: problem.control,
        }
    }

    /// How many numbers `x_1..x_N` are.
    pub(crate) fn all_states(self) -> usize {
        self.stages * self.states
    }

    /// How many unknowns there are.
    pub(crate) fn unknowns(self) -> usize {
        self.all_states() + self.moves * self.inputs
    }

    /// Where x_{j+1} is, the state that stage `j` leads to, in z. Also: where the rows of its
    /// dynamics are.
    pub(crate) fn next_state(self, j: usize) -> Range<usize> {
        j * self.states..(j + 1) * self.states
    }

    /// Where `x_j` is in z; `None` for the measured `x_0`.
    pub(crate) fn state(self, j: usize) -> Option<Range<usize>> {
        j.checked_sub(1).map(|j| self.next_state(j))
    }

    /// Where `u_i` is in z.
    pub(crate) fn input(self, i: usize) -> Range<usize> {
        let first = self.all_states() + i * self.inputs;
        first..first + self.inputs
    }

    /// The index of the input that acts in stage `j`: the last is held.
    pub(crate) fn acting(self, j: usize) -> usize {
        j.min(self.moves - 1)
    }

    /// `bounds` on a state and on an input, for all of z.
    pub(crate) fn repeat(self, states: &Bounds, inputs: &Bounds) -> Bounds {
        let side = |x: &[f64], u: &[f64]| [x.repeat(self.stages), u.repeat(self.moves)].concat();
        Bounds { low: side(&states.low, &inputs.low), high: side(&states.high, &inputs.high) }
    }
}

/// A plan with its multipliers; if it is optimal, a stationary point of the Lagrangian
///
/// ```text
/// L = J + sum_{j=0..N2-1} lambda_j' (f(x_j, u_j) - x_{j+1}) + mu' z,    z = (x_1, .., u_0, ..)
/// ```
///
/// in which `x_j` is `x[k+j]` and `u_j` is `u[k+min(j, Nu-1)]`. A multiplier `mu_i > 0` belongs to the upper
/// bound of `z_i`, `mu_i < 0` to the lower one.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    shape: Shape,
    /// z
    pub(crate) z: Vec<f64>,
    /// lambda
    pub(crate) lambda: Vec<f64>,
    /// mu
    pub(crate) mu: Vec<f64>,
}

impl Solution {
    pub(crate) fn new(shape: Shape) -> Self {
        Self {
            shape,
            z: vec![0.0; shape.unknowns()],
            lambda: vec![0.0; shape.all_states()],
            mu: vec![0.0; shape.unknowns()],
        }
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
        &self.lambda
    }

    /// mu of the states, `[N2, n]`.
    #[must_use]
    pub fn state_multipliers(&self) -> &[f64] {
        &self.mu[..self.shape.all_states()]
    }

    /// mu of the inputs, `[Nu, m]`.
    #[must_use]
    pub fn input_multipliers(&self) -> &[f64] {
        &self.mu[self.shape.all_states()..]
    }

    /// The input to apply now.
    pub(crate) fn first_input(&self) -> &[f64] {
        &self.z[self.shape.input(0)]
    }

    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.z.copy_from_slice(&other.z);
        self.lambda.copy_from_slice(&other.lambda);
        self.mu.copy_from_slice(&other.mu);
    }

    /// Moves the plan on by one step: stage j takes the place of stage j-1, the last one stays.
    pub(crate) fn shift(&mut self) {
        let all_states = self.shape.all_states();
        drop_first(&mut self.lambda, self.shape.states);
        for vector in [&mut self.z, &mut self.mu] {
            let (x, u) = vector.split_at_mut(all_states);
            drop_first(x, self.shape.states);
            drop_first(u, self.shape.inputs);
        }
    }

    /// Plans to stay at `x`; the planned inputs are kept. What is known nothing of, the
    /// multipliers, is 0.
    pub(crate) fn stay_at(&mut self, x: &[f64]) {
        let all_states = self.shape.all_states();
        for state in self.z[..all_states].chunks_exact_mut(x.len()) {
            state.copy_from_slice(x);
        }
        self.lambda.fill(0.0);
        self.mu.fill(0.0);
    }
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
        let shape = Shape { states: 2, inputs: 1, stages: 3, moves: 1 };
        let mut solution = Solution::new(shape);
        solution.z = vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
        solution.lambda = vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0];
        solution.shift();
        assert_eq!(solution.states(), [3.0, 4.0, 5.0, 6.0, 5.0, 6.0]);
        assert_eq!(solution.inputs(), [7.0]);
        assert_eq!(solution.dynamics_multipliers(), [3.0, 4.0, 5.0, 6.0, 5.0, 6.0]);
    }
}
