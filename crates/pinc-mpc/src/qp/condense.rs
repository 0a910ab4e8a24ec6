//! Condensing: the QP in the inputs alone.

use super::algebra::{add_product, add_scaled, add_transposed, dot};
use super::dense::{ActiveSet, DenseQp, DenseStatus};
use super::{Kind, Qp, QpSolver, QpStatus, QpStep, Row};
use crate::shape::Shape;

/// Solves a [`Qp`] by eliminating its states and giving what is left, a small dense program in the inputs, to the
/// active-set method.
///
/// With `v = (du_0, .., du_{Nu-1})` the dynamics are `dx_j = G_j v + e_j`. H and the gradient in v come from products
/// backwards over the horizon, column by column of G, at a cost quadratic in the horizon (Andersson, Frasch, Vukov
/// and Diehl, "A condensing algorithm for nonlinear MPC with a quadratic runtime in horizon length", 2013):
///
/// ```text
/// G_{j+1} = A_j G_j + B_j                W_j = Q_j G_j + A_j' W_{j+1},    H_{j,:} = B_j' W_{j+1} + R terms
/// e_{j+1} = A_j e_j + c_j                p_j = g_j + Q_j e_j + A_j' p_{j+1},    g_{u_j} + B_j' p_{j+1}
/// ```
///
/// Only finite limits become rows. All memory is allocated at construction.
#[derive(Debug)]
pub(super) struct CondensedQp {
    dense: DenseQp,
    solver: ActiveSet,
    /// What each row of C is, the inputs' bounds apart.
    sources: Vec<(Kind, usize)>,
    /// How many of these are bounds of states: the first ones.
    state_rows: usize,
    /// A column of `G_1` .. `G_N`, `[N, n]`, then `e_1` .. `e_N`.
    response: Vec<f64>,
    offset: Vec<f64>,
    work: Vec<f64>,
    adjoint: Vec<f64>,
}

impl CondensedQp {
    /// A solver for QPs of the shape of `qp`; of its limits it matters here which are finite.
    pub(super) fn new(qp: &Qp) -> Self {
        let shape = qp.shape;
        let mut sources = Vec::new();
        for (kind, limits) in qp.limits() {
            for (i, [low, high, _]) in limits.iter().enumerate() {
                let input = kind == Kind::Bound && i >= shape.all_states();
                if !input && (low.is_finite() || high.is_finite()) {
                    sources.push((kind, i));
                }
            }
        }
        let state_rows = sources.iter().filter(|(kind, _)| *kind == Kind::Bound).count();
        let (unknowns, n) = (shape.all_inputs(), shape.states);
        let mut dense = DenseQp::new(unknowns, sources.len());
        for (row, &(kind, i)) in sources.iter().enumerate() {
            // These rows of C stay.
            if kind == Kind::Increment {
                dense.matrix[i * sources.len() + row] = 1.0;
                if let Some(before) = i.checked_sub(shape.inputs) {
                    dense.matrix[before * sources.len() + row] = -1.0;
                }
            }
        }
        Self {
            solver: ActiveSet::new(unknowns, sources.len()),
            dense,
            sources,
            state_rows,
            response: vec![0.0; shape.all_states()],
            offset: vec![0.0; shape.all_states()],
            work: vec![0.0; n],
            adjoint: vec![0.0; n],
        }
    }

    /// How many rows joined or left the working set in the last solution.
    #[cfg(test)]
    pub(super) fn changes(&self) -> usize {
        self.solver.changes()
    }

    fn condense(&mut self, qp: &Qp) {
        self.condense_offset(qp);
        self.condense_gradient(qp);
        for column in 0..qp.shape.all_inputs() {
            self.respond(qp, column);
            self.condense_hessian(qp, column);
            self.condense_rows(qp, column);
        }
        self.add_increments(qp);
        self.limit(qp);
    }

    /// e
    fn condense_offset(&mut self, qp: &Qp) {
        let n = qp.shape.states;
        self.offset.copy_from_slice(&qp.c);
        for j in 1..qp.shape.stages {
            let (before, now) = self.offset[(j - 1) * n..(j + 1) * n].split_at_mut(n);
            add_product(qp.a(j), before, now);
        }
    }

    fn condense_gradient(&mut self, qp: &Qp) {
        let shape = qp.shape;
        let inputs = &qp.gradient[shape.all_states()..];
        self.dense.gradient.copy_from_slice(inputs);
        for j in (0..shape.stages).rev() {
            let state = shape.next_state(j);
            self.step_back(qp, j);
            add_scaled(&mut self.work, 1.0, &qp.gradient[state.clone()]);
            add_product(qp.q(j + 1), &self.offset[state], &mut self.work);
            let first = shape.acting(j) * shape.inputs;
            let gradient = &mut self.dense.gradient[first..first + shape.inputs];
            add_transposed(qp.b(j), &self.work, gradient);
        }
    }

    /// `work` <- A_{j+1}' `work`; 0 at the end.
    fn step_back(&mut self, qp: &Qp, j: usize) {
        self.adjoint.fill(0.0);
        if j + 1 < qp.shape.stages {
            add_transposed(qp.a(j + 1), &self.work, &mut self.adjoint);
        }
        std::mem::swap(&mut self.work, &mut self.adjoint);
    }

    /// A column of G, from the stage on at which its input begins to act.
    fn respond(&mut self, qp: &Qp, column: usize) {
        let Shape { states: n, inputs: m, stages, .. } = qp.shape;
        let (input, k) = (column / m, column % m);
        for j in input..stages {
            let (before, now) = self.response[..(j + 1) * n].split_at_mut(j * n);
            if qp.shape.acting(j) == input {
                for (now, b) in now.iter_mut().zip(qp.b(j).chunks_exact(m)) {
                    *now = b[k];
                }
            } else {
                now.fill(0.0);
            }
            if j > input {
                add_product(qp.a(j), &before[(j - 1) * n..], now);
            }
        }
    }

    /// The column of H, on and below the diagonal.
    fn condense_hessian(&mut self, qp: &Qp, column: usize) {
        let shape = qp.shape;
        let (m, unknowns) = (shape.inputs, shape.all_inputs());
        let hessian = &mut self.dense.hessian[column * unknowns..(column + 1) * unknowns];
        hessian.fill(0.0);
        for j in (column / m..shape.stages).rev() {
            self.adjoint.fill(0.0);
            if j + 1 < shape.stages {
                add_transposed(qp.a(j + 1), &self.work, &mut self.adjoint);
            }
            add_product(qp.q(j + 1), &self.response[shape.next_state(j)], &mut self.adjoint);
            std::mem::swap(&mut self.work, &mut self.adjoint);
            let first = shape.acting(j) * m;
            add_transposed(qp.b(j), &self.work, &mut hessian[first..first + m]);
        }
    }

    /// The column of C.
    fn condense_rows(&mut self, qp: &Qp, column: usize) {
        let shape = qp.shape;
        let (n, m) = (shape.states, shape.inputs);
        let (input, k) = (column / m, column % m);
        let begin = input * n;
        let rows = self.sources.len();
        let matrix = &mut self.dense.matrix[column * rows..(column + 1) * rows];
        let (bounds, others) = self.sources.split_at(self.state_rows);
        for (entry, &(_, v)) in matrix.iter_mut().zip(bounds) {
            *entry = if v < begin { 0.0 } else { self.response[v] };
        }
        for (entry, &(kind, row)) in matrix[self.state_rows..].iter_mut().zip(others) {
            if kind == Kind::Row {
                let j = shape.first + row / shape.rows();
                let by_x = &qp.rows_x[row * n..(row + 1) * n];
                *entry = if shape.acting(j) == input { qp.rows_u[row * m + k] } else { 0.0 };
                if j > input {
                    *entry += dot(by_x, &self.response[shape.next_state(j - 1)]);
                }
            }
        }
    }

    /// The increments' weights, on and below the diagonal of H.
    fn add_increments(&mut self, qp: &Qp) {
        let Shape { inputs: m, moves, .. } = qp.shape;
        let unknowns = qp.shape.all_inputs();
        for i in 0..moves {
            for (k, r) in qp.r(i).chunks_exact(m).enumerate() {
                let column = &mut self.dense.hessian[(i * m + k) * unknowns..];
                add_scaled(&mut column[i * m..(i + 1) * m], 1.0, r);
                if i > 0 {
                    let before = &mut self.dense.hessian[((i - 1) * m + k) * unknowns..];
                    add_scaled(&mut before[(i - 1) * m..i * m], 1.0, r);
                    add_scaled(&mut before[i * m..(i + 1) * m], -1.0, r);
                }
            }
        }
    }

    /// The limits: those of v, and those of the rows less what they are at v = 0.
    fn limit(&mut self, qp: &Qp) {
        let shape = qp.shape;
        let (n, unknowns) = (shape.states, shape.all_inputs());
        let DenseQp { low, high, cap, .. } = &mut self.dense;
        let inputs = qp.bounds.iter().skip(shape.all_states());
        for (v, limits) in inputs.enumerate() {
            [low[v], high[v], cap[v]] = limits;
        }
        for (i, &(kind, index)) in self.sources.iter().enumerate() {
            let (limits, at) = match kind {
                Kind::Bound => (&qp.bounds, self.offset[index]),
                Kind::Increment => (&qp.increments, 0.0),
                Kind::Row => {
                    let j = shape.first + index / shape.rows();
                    let state = &self.offset[shape.next_state(j - 1)];
                    (&qp.rows, dot(&qp.rows_x[index * n..(index + 1) * n], state))
                }
            };
            let row = unknowns + i;
            (low[row], high[row]) = (limits.low[index] - at, limits.high[index] - at);
            cap[row] = limits.cap[index];
        }
    }

    fn guess(&mut self, qp: &Qp, step: &QpStep) {
        let inputs = &step.multipliers.bounds[qp.shape.all_states()..];
        let (bounds, rows) = self.solver.guess().split_at_mut(inputs.len());
        bounds.copy_from_slice(inputs);
        for (mu, &(kind, i)) in rows.iter_mut().zip(&self.sources) {
            *mu = match kind {
                Kind::Bound => step.multipliers.bounds[i],
                Kind::Increment => step.multipliers.increments[i],
                Kind::Row => step.multipliers.rows[i],
            };
        }
    }

    fn expand(&mut self, qp: &Qp, step: &mut QpStep) {
        let shape = qp.shape;
        let n = shape.states;
        let QpStep { d, multipliers } = step;
        d[shape.all_states()..].copy_from_slice(self.solver.x());
        let (states, inputs) = d.split_at_mut(shape.all_states());
        states.copy_from_slice(&qp.c);
        for j in 0..shape.stages {
            let (before, now) = states[..(j + 1) * n].split_at_mut(j * n);
            if j > 0 {
                add_product(qp.a(j), &before[(j - 1) * n..], now);
            }
            let first = shape.acting(j) * shape.inputs;
            add_product(qp.b(j), &inputs[first..first + shape.inputs], now);
        }

        let (bounds, rows) = self.solver.multipliers().split_at(inputs.len());
        multipliers.bounds[..shape.all_states()].fill(0.0);
        multipliers.bounds[shape.all_states()..].copy_from_slice(bounds);
        multipliers.increments.fill(0.0);
        multipliers.rows.fill(0.0);
        for (&mu, &(kind, i)) in rows.iter().zip(&self.sources) {
            match kind {
                Kind::Bound => multipliers.bounds[i] = mu,
                Kind::Increment => multipliers.increments[i] = mu,
                Kind::Row => multipliers.rows[i] = mu,
            }
        }
        self.expand_dynamics(qp, step);
    }

    /// The multipliers of the dynamics, from the last one back: dL/dx = 0.
    fn expand_dynamics(&mut self, qp: &Qp, step: &mut QpStep) {
        let shape = qp.shape;
        let QpStep { d, multipliers } = step;
        for j in (0..shape.stages).rev() {
            let state = shape.next_state(j);
            let (lambda, next) = multipliers.dynamics[state.start..].split_at_mut(shape.states);
            lambda.copy_from_slice(&qp.gradient[state.clone()]);
            add_scaled(lambda, 1.0, &multipliers.bounds[state.clone()]);
            add_product(qp.q(j + 1), &d[state], lambda);
            if j + 1 < shape.stages {
                add_transposed(qp.a(j + 1), &next[..shape.states], lambda);
            }
            if shape.rows() > 0 && shape.constrained().contains(&(j + 1)) {
                let eta = &multipliers.rows[shape.stage_rows(j + 1)];
                add_transposed(qp.rows_x(j + 1), eta, lambda);
            }
        }
    }

    /// Where a row of the dense program comes from.
    fn source(&self, qp: &Qp, row: usize) -> Row {
        let unknowns = qp.shape.all_inputs();
        let (kind, index) = match row.checked_sub(unknowns) {
            Some(i) => self.sources[i],
            None => (Kind::Bound, qp.shape.all_states() + row),
        };
        Row { kind, index, upper: self.solver.multipliers()[row] > 0.0 }
    }
}

impl QpSolver for CondensedQp {
    fn solve(&mut self, qp: &Qp, step: &mut QpStep) -> QpStatus {
        self.condense(qp);
        self.guess(qp, step);
        match self.solver.solve(&self.dense) {
            DenseStatus::Solved => {
                self.expand(qp, step);
                QpStatus::Solved
            }
            DenseStatus::Infeasible(row) => QpStatus::Infeasible(self.source(qp, row)),
            DenseStatus::Failed => QpStatus::Failed,
        }
    }
}
