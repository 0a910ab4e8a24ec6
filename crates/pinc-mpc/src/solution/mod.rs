//! A plan and its multipliers.

#[cfg(test)]
mod tests;

use pinc_qp::{Multipliers, OcpDims, all_finite};

/// A plan with its multipliers; if it is optimal, a stationary point of the Lagrangian
///
/// ```text
/// L = J + sum_{j=0..N2-1} lambda_j' (f(x_j, u_j) - x_{j+1}) + mu' z + sum_{i=0..Nu-1} nu_i' (u_i - u_{i-1})
///       + sum_{j=N1..N2} eta_j' (h(x_j, u_j), g(x_j, u_j), y_j),       z = (x_1, .., u_0, ..)
/// ```
///
/// in which `x_j` is `x[k+j]`, `u_j` is `u[k+min(j, Nu-1)]`, and `y_j` are the bounded outputs: those
/// without feedthrough, at `x_j`; those with it, at `(x_j, u_{j-1})`; and the latter again, at
/// `(x_{j-1}, u_{j-1})`. A positive multiplier belongs to an
/// upper bound, a negative one to a lower bound. Where a soft constraint is violated, its
/// multiplier is the weight of the violation.
#[derive(Clone, Debug, PartialEq)]
pub struct Solution {
    dims: OcpDims,
    /// All unknowns: states, then inputs.
    pub z: Vec<f64>,
    /// The multipliers of all rows.
    pub multipliers: Multipliers,
}

impl Solution {
    /// Creates a plan in which all numbers are 0.
    #[must_use]
    pub fn new(dims: OcpDims) -> Self {
        Self { dims, z: vec![0.0; dims.unknowns()], multipliers: Multipliers::new(dims) }
    }

    /// The planned states x\[k+1\]..x\[k+N2\], `[N2, n]`. In a plan for
    /// [`Scenarios`](crate::Scenarios) stages are nodes, numbered as in a [`Tree`](crate::Tree).
    #[must_use]
    pub fn states(&self) -> &[f64] {
        &self.z[..self.dims.all_states()]
    }

    /// The planned inputs u\[k\]..u\[k+Nu-1\], `[Nu, m]`.
    #[must_use]
    pub fn inputs(&self) -> &[f64] {
        &self.z[self.dims.all_states()..]
    }

    /// lambda, `[N2, n]`.
    #[must_use]
    pub fn dynamics_multipliers(&self) -> &[f64] {
        &self.multipliers.dynamics
    }

    /// mu of the states, `[N2, n]`.
    #[must_use]
    pub fn state_multipliers(&self) -> &[f64] {
        &self.multipliers.bounds[..self.dims.all_states()]
    }

    /// mu of the inputs, `[Nu, m]`.
    #[must_use]
    pub fn input_multipliers(&self) -> &[f64] {
        &self.multipliers.bounds[self.dims.all_states()..]
    }

    /// nu, `[Nu, m]`.
    #[must_use]
    pub fn increment_multipliers(&self) -> &[f64] {
        &self.multipliers.increments
    }

    /// eta, `[N2 - N1 + 1, rows]`: at each stage the multipliers of h, of g, and of the bounded
    /// outputs as in L.
    #[must_use]
    pub fn constraint_multipliers(&self) -> &[f64] {
        &self.multipliers.rows
    }

    /// The input to apply now.
    pub(crate) fn first_input(&self) -> &[f64] {
        &self.z[self.dims.input(0)]
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

    /// Moves the plan on by one step: stage j takes the place of stage j-1, the last one stays, or is
    /// the first one if the plan `is_orbit`.
    pub(crate) fn shift(&mut self, is_orbit: bool) {
        if is_orbit && self.dims.n_controls == self.dims.horizon {
            return self.rotate();
        }
        self.dims.shift_unknowns(&mut self.z);
        self.multipliers.shift(self.dims);
    }

    /// Makes the first stage the last one. The multiplier that closes the orbit is that of the dynamics
    /// there, as no cost is at the end alone.
    fn rotate(&mut self) {
        let OcpDims { nx, nu, .. } = self.dims;
        let rows = self.dims.rows();
        let Multipliers { dynamics, bounds, increments, rows: by_row } = &mut self.multipliers;
        let first = bounds.len() - increments.len();
        for list in [&mut self.z[..], &mut bounds[..]] {
            let (states, inputs) = list.split_at_mut(first);
            states.rotate_left(nx);
            inputs.rotate_left(nu);
        }
        dynamics.rotate_left(nx);
        increments.rotate_left(nu);
        let rows = rows.min(by_row.len());
        by_row.rotate_left(rows);
        let [before, last] = [2, 1].map(|back| first.saturating_sub(back * nx));
        bounds[before..last].fill(0.0);
        bounds[last..first].copy_from_slice(&dynamics[last..]);
    }

    /// Takes the plan `from`, shifted by the first stage's length, on stages of different lengths of which the
    /// first is the shortest; `times`, `[N + 1]`, belong to `x_0` .. `x_N`. States are interpolated linearly,
    /// inputs held as planned; a stage takes the multipliers of the stage that covers its beginning.
    #[inline(never)]
    pub(crate) fn resample(&mut self, from: &Self, times: &[f64]) {
        let (dims, length) = (self.dims, times[1]);
        // The stage of `from` at a time, and which part of it is over. The end belongs to the last.
        let locate = |time: f64| {
            let slack = 1e-9 * length;
            let stage = times.iter().rposition(|&begin| begin <= time + slack).unwrap_or(0);
            let stage = stage.min(dims.horizon - 1);
            let part = (time - times[stage]) / (times[stage + 1] - times[stage]);
            (stage, if part < 1e-9 { 0.0 } else { part.min(1.0) })
        };
        for j in 0..dims.horizon {
            let (stage, part) = locate(times[j + 1] + length);
            // x_stage and x_{stage+1}; the former is predicted too, being later than the first stage.
            let after = from.z[dims.next_state(stage)].iter();
            let before = from.z[dims.next_state(stage.max(1) - 1)].iter();
            let to = &mut self.z[dims.next_state(j)];
            for ((to, before), after) in to.iter_mut().zip(before).zip(after) {
                *to = before + part * (after - before);
            }
            let (source, _) = locate(times[j] + length);
            if j < dims.n_controls {
                let input = dims.input(dims.acting(source));
                self.z[dims.input(j)].copy_from_slice(&from.z[input]);
            }
            self.take_multipliers(&from.multipliers, j, source);
        }
    }

    /// Takes the multipliers of stage `source` for stage `j`.
    fn take_multipliers(&mut self, from: &Multipliers, j: usize, source: usize) {
        let (dims, to) = (self.dims, &mut self.multipliers);
        let [state, other] = [j, source].map(|stage| dims.next_state(stage));
        to.dynamics[state.clone()].copy_from_slice(&from.dynamics[other.clone()]);
        to.bounds[state].copy_from_slice(&from.bounds[other]);
        if j < dims.n_controls {
            let acting = dims.acting(source);
            to.bounds[dims.input(j)].copy_from_slice(&from.bounds[dims.input(acting)]);
            let [increment, other] = [j, acting].map(|i| i * dims.nu..(i + 1) * dims.nu);
            to.increments[increment].copy_from_slice(&from.increments[other]);
        }
        if j + 1 >= dims.n1 && dims.rows() > 0 {
            let other = dims.stage_rows((source + 1).max(dims.n1));
            to.rows[dims.stage_rows(j + 1)].copy_from_slice(&from.rows[other]);
        }
    }

    /// Whether all numbers are finite.
    pub(crate) fn is_finite(&self) -> bool {
        all_finite(&self.z) && self.multipliers.is_finite()
    }

    /// Plans to hold the input `u`.
    pub(crate) fn hold(&mut self, u: &[f64]) {
        for input in self.z[self.dims.all_states()..].chunks_exact_mut(u.len()) {
            input.copy_from_slice(u);
        }
    }

    /// Plans to stay at `x` with the planned inputs as they are; all multipliers are 0.
    pub(crate) fn stay_at(&mut self, x: &[f64]) {
        let all_states = self.dims.all_states();
        for state in self.z[..all_states].chunks_exact_mut(x.len()) {
            state.copy_from_slice(x);
        }
        self.multipliers.clear();
    }
}
