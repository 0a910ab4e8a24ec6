//! Condensing: the QP in the inputs alone.

mod panels;

use super::algebra::{add_product, add_scaled, add_transposed, block, block_mut};
use super::dense::{ActiveSet, DenseQp, DenseStatus};
use super::{Kind, Limits, Qp, QpMethod, QpSolver, QpStatus, QpStep, QpWork, Row};
use crate::{OcpDims, RowBlock};
use panels::Panels;
use pinc_ad::simd::{Simd, Task};

/// Solves a [`Qp`] by eliminating its states and giving what is left, a small dense program in the
/// inputs, to the active-set method.
///
/// With `v = (du_0, .., du_{Nu-1})` the dynamics are `dx_j = G_j v + e_j`. H and the gradient in v
/// come from products backwards over the horizon, at a cost quadratic in the horizon (Andersson,
/// Frasch, Vukov and Diehl, "A condensing algorithm for nonlinear MPC with a quadratic runtime in
/// horizon length", 2013):
///
/// ```text
/// G_{j+1} = A_j G_j + B_j                W_j = Q_j G_j + A_j' W_{j+1},    H_{j,:} = B_j' W_{j+1} + R terms
/// e_{j+1} = A_j e_j + c_j                p_j = g_j + Q_j e_j + A_j' p_{j+1},    g_{u_j} + B_j' p_{j+1}
/// ```
///
/// A program with S adds `S_j'` to `W_j`, `S_j G_j` to H, and `S_j e_j` to the gradient; one with E
/// the same for the inputs before.
///
/// Only finite limits become rows. All memory is allocated at construction.
#[derive(Debug)]
pub(super) struct CondensedQp {
    /// The factor by which states may grow over the horizon.
    most_growth: f64,
    dense: DenseQp,
    solver: ActiveSet,
    rows: DenseRows,
    panels: Panels,
}

/// What the rows of C are: their places in the QP's limits, the kinds one after the other.
#[derive(Debug)]
struct DenseRows {
    states: Vec<usize>,
    increments: Vec<usize>,
    general: Vec<usize>,
    /// j of the state and i of the input of each of these.
    places: Vec<(usize, usize)>,
}

impl DenseRows {
    fn new(qp: &Qp) -> Self {
        let finite = |limits: &Limits, end: usize| {
            let limited = limits.iter().enumerate().take(end);
            let limited = limited.filter(|(_, [low, high, _])| low.is_finite() || high.is_finite());
            limited.map(|(i, _)| i).collect()
        };
        let general = finite(&qp.rows, usize::MAX);
        Self {
            states: finite(&qp.bounds, qp.dims.all_states()),
            increments: finite(&qp.increments, usize::MAX),
            places: general.iter().map(|&row| qp.dims.row_place(row)).collect(),
            general,
        }
    }

    fn len(&self) -> usize {
        self.states.len() + self.increments.len() + self.general.len()
    }

    /// Splits a list of C's rows by their kinds.
    fn split<'a>(&self, list: &'a mut [f64]) -> [&'a mut [f64]; 3] {
        let (states, rest) = list.split_at_mut(self.states.len());
        let (increments, general) = rest.split_at_mut(self.increments.len());
        [states, increments, general]
    }

    /// Where row `i` of C comes from.
    fn source(&self, i: usize) -> (Kind, usize) {
        let parts = [
            (Kind::Bound, &self.states),
            (Kind::Increment, &self.increments),
            (Kind::Row, &self.general),
        ];
        let all = parts.into_iter().flat_map(|(kind, part)| part.iter().map(move |&at| (kind, at)));
        all.into_iter().nth(i).expect("a row of C")
    }
}

impl CondensedQp {
    /// A solver for QPs of the sizes of `qp`; of its limits it matters here which are finite.
    pub(super) fn new(qp: &Qp) -> Self {
        let dims = qp.dims;
        let rows = DenseRows::new(qp);
        let (unknowns, height) = (dims.all_inputs(), rows.len());
        let mut dense = DenseQp::new(unknowns, height);
        // These rows of C stay.
        for (row, &i) in rows.increments.iter().enumerate() {
            let row = row + rows.states.len();
            dense.matrix[i * height + row] = 1.0;
            if let Some(before) = i.checked_sub(dims.nu) {
                dense.matrix[before * height + row] = -1.0;
            }
        }
        let (solver, panels) = (ActiveSet::new(unknowns, height), Panels::new(dims));
        Self { most_growth: f64::INFINITY, solver, dense, rows, panels }
    }

    /// Makes it fail on programs whose states grow by more than [`QpMethod::MOST_GROWTH`].
    pub(super) fn for_stable_plants(self) -> Self {
        Self { most_growth: QpMethod::MOST_GROWTH, ..self }
    }

    /// How many rows joined or left the working set in the last solution.
    #[cfg(test)]
    pub(super) fn changes(&self) -> usize {
        self.solver.changes()
    }

    /// Whether it came to the end before `expired` said that the time is up.
    fn condense(&mut self, qp: &Qp, expired: &mut dyn FnMut() -> bool) -> bool {
        if !self.panels.condense(qp, &mut self.dense, expired) {
            return false;
        }
        self.condense_rows(qp);
        sized!(qp.dims, |_n, m| self.add_increments(qp, m));
        self.limit(qp);
        true
    }

    /// C, and the values of its rows at v = 0 in `low`.
    fn condense_rows(&mut self, qp: &Qp) {
        let OcpDims { nx: n, nu: m, .. } = qp.dims;
        let (unknowns, height) = (qp.dims.all_inputs(), self.rows.len());
        let offsets = &mut self.dense.low[unknowns..];
        for (at, &v) in self.rows.states.iter().enumerate() {
            let row = self.panels.row(v / n, v % n);
            offsets[at] = row[0];
            // Inputs that act later have 0 from the beginning.
            let acting = (qp.dims.acting(v / n) + 1) * m;
            let column = self.dense.matrix[at..].iter_mut().step_by(height);
            column.zip(&row[1..=acting]).for_each(|(entry, g)| *entry = *g);
        }
        let (bounded, first) = (self.rows.states.len(), height - self.rows.general.len());
        offsets[bounded..first].fill(0.0);
        let rows = self.rows.general.iter().zip(&self.rows.places).enumerate();
        for (at, (&row, &(state, input))) in rows {
            let at = first + at;
            offsets[at] = 0.0;
            let entries = self.dense.matrix[at..].iter_mut().step_by(height);
            entries.for_each(|entry| *entry = 0.0);
            if let Some(j) = state.checked_sub(1) {
                let acting = (qp.dims.acting(j) + 1) * m;
                for (by_x, x) in block(&qp.rows_x, row, n).iter().zip(self.panels.state(j)) {
                    offsets[at] += by_x * x[0];
                    let entries = self.dense.matrix[at..].iter_mut().step_by(height);
                    entries.zip(&x[1..=acting]).for_each(|(entry, g)| *entry += by_x * g);
                }
            }
            for (k, by_u) in block(&qp.rows_u, row, m).iter().enumerate() {
                self.dense.matrix[(input * m + k) * height + at] += by_u;
            }
        }
    }

    /// The weights of increments and inputs, on and below the diagonal of H.
    #[inline(always)]
    fn add_increments(&mut self, qp: &Qp, m: usize) {
        let unknowns = qp.dims.all_inputs();
        for i in 0..qp.dims.n_controls {
            for (k, r) in block(&qp.r, i, m * m).chunks_exact(m).enumerate() {
                let column = block_mut(&mut self.dense.hessian, i * m + k, unknowns);
                add_scaled(block_mut(column, i, m), 1.0, r);
                if i > 0 {
                    let before = block_mut(&mut self.dense.hessian, (i - 1) * m + k, unknowns);
                    add_scaled(block_mut(before, i - 1, m), 1.0, r);
                    add_scaled(block_mut(before, i, m), -1.0, r);
                }
            }
        }
        for (i, t) in qp.t.chunks_exact(m * m).enumerate() {
            for (k, t) in t.chunks_exact(m).enumerate() {
                let column = block_mut(&mut self.dense.hessian, i * m + k, unknowns);
                add_scaled(block_mut(column, i, m), 1.0, t);
            }
        }
        add_scaled(&mut self.dense.hessian, 1.0, &qp.w);
    }

    /// The limits of v, and the limits of the rows less the rows' values at v = 0, which are in
    /// `low`.
    fn limit(&mut self, qp: &Qp) {
        let (unknowns, first) = (qp.dims.all_inputs(), qp.dims.all_states());
        let DenseQp { low, high, penalty, .. } = &mut self.dense;
        low[..unknowns].copy_from_slice(&qp.bounds.low[first..]);
        high[..unknowns].copy_from_slice(&qp.bounds.high[first..]);
        penalty[..unknowns].copy_from_slice(&qp.bounds.penalty[first..]);
        let [low, high, penalty] = [low, high, penalty].map(|list| &mut list[unknowns..]);
        let mut at = 0;
        for (limits, places) in [
            (&qp.bounds, &self.rows.states),
            (&qp.increments, &self.rows.increments),
            (&qp.rows, &self.rows.general),
        ] {
            let end = at + places.len();
            let sides = low[at..end].iter_mut().zip(&mut high[at..end]);
            for (((low, high), penalty), &i) in sides.zip(&mut penalty[at..end]).zip(places) {
                let offset = *low;
                (*low, *high) = (limits.low[i] - offset, limits.high[i] - offset);
                *penalty = limits.penalty[i];
            }
            at = end;
        }
    }

    /// Hands the multipliers of `step` to the solver.
    fn guess(&mut self, qp: &Qp, step: &QpStep) {
        let multipliers = &step.multipliers;
        let (states, inputs) = multipliers.bounds.split_at(qp.dims.all_states());
        let (bounds, rows) = self.solver.guess().split_at_mut(inputs.len());
        bounds.copy_from_slice(inputs);
        let [on_states, on_increments, on_general] = self.rows.split(rows);
        for (to, from, places) in [
            (on_states, states, &self.rows.states),
            (on_increments, &multipliers.increments, &self.rows.increments),
            (on_general, &multipliers.rows, &self.rows.general),
        ] {
            to.iter_mut().zip(places).for_each(|(to, &at)| *to = from[at]);
        }
    }

    /// Writes states, inputs and multipliers.
    fn expand(&mut self, qp: &Qp, step: &mut QpStep) {
        self.read_multipliers(qp, step);
        step.d[qp.dims.all_states()..].copy_from_slice(self.solver.x());
        self.panels.isa().dispatch(Expand { qp, step });
    }

    fn read_multipliers(&mut self, qp: &Qp, step: &mut QpStep) {
        let multipliers = &mut step.multipliers;
        let (states, inputs) = multipliers.bounds.split_at_mut(qp.dims.all_states());
        let (bounds, mut rows) = self.solver.multipliers().split_at(inputs.len());
        inputs.copy_from_slice(bounds);
        for (to, places) in [
            (states, &self.rows.states),
            (&mut multipliers.increments[..], &self.rows.increments),
            (&mut multipliers.rows[..], &self.rows.general),
        ] {
            to.fill(0.0);
            let (from, rest) = rows.split_at(places.len());
            from.iter().zip(places).for_each(|(from, &at)| to[at] = *from);
            rows = rest;
        }
    }

    /// Where a row of the dense program comes from.
    fn source(&self, qp: &Qp, row: usize) -> Row {
        let (kind, index) = match row.checked_sub(qp.dims.all_inputs()) {
            Some(i) => self.rows.source(i),
            None => (Kind::Bound, qp.dims.all_states() + row),
        };
        Row { kind, index, upper: self.solver.multipliers()[row] > 0.0 }
    }
}

/// See [`CondensedQp::expand`].
struct Expand<'a> {
    qp: &'a Qp,
    step: &'a mut QpStep,
}

impl Task for Expand<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Simd>(self, _: V) {
        let Self { qp, step } = self;
        sized!(qp.dims, |n, m| expand_sized(qp, step, n, m));
    }
}

/// The states that the inputs lead to, and the multipliers of the dynamics, from the last one back:
/// dL/dx = 0.
#[inline(always)]
fn expand_sized(qp: &Qp, step: &mut QpStep, n: usize, m: usize) {
    let dims = qp.dims;
    let (states, inputs) = step.d.split_at_mut(dims.all_states());
    states.copy_from_slice(&qp.c);
    for j in 0..dims.horizon {
        let input = block(inputs, dims.acting(j), m);
        add_product(block(&qp.b, j, n * m), input, block_mut(states, j, n));
        if j > 0 {
            let (before, now) = neighbours(states, j, n);
            add_product(block(&qp.a, j, n * n), before, now);
        }
    }
    let multipliers = &mut step.multipliers;
    let dynamics = &mut multipliers.dynamics;
    for j in (0..dims.horizon).rev() {
        let lambda = block_mut(dynamics, j, n);
        lambda.copy_from_slice(block(&qp.gradient, j, n));
        add_scaled(lambda, 1.0, block(&multipliers.bounds, j, n));
        add_product(block(&qp.q, j, n * n), block(states, j, n), lambda);
        for (input, s) in qp.cross(j + 1) {
            add_transposed(s, block(inputs, input, m), lambda);
        }
        if dims.rows() > 0 {
            for RowBlock { rows, .. } in rows_of_state(dims, j + 1) {
                let [by_x, _] = qp.row_jacobians(rows.clone());
                add_transposed(by_x, &multipliers.rows[rows], lambda);
            }
        }
        if j + 1 < dims.horizon {
            let (lambda, next) = neighbours(dynamics, j + 1, n);
            add_transposed(block(&qp.a, j + 1, n * n), next, lambda);
        }
    }
}

/// The rows that the state `x_j` is in, where there are rows.
#[inline(always)]
fn rows_of_state(dims: OcpDims, j: usize) -> impl Iterator<Item = RowBlock> {
    let here = (j >= dims.n1).then(|| [dims.rows_here(j), dims.rows_at_end(j)]);
    let starts = dims.feedthrough > 0 && dims.constrained().contains(&(j + 1));
    here.into_iter().flatten().chain(starts.then(|| dims.rows_at_start(j + 1)))
}

/// The time was up before there was a step.
#[cold]
fn nothing_yet(step: &mut QpStep) -> QpStatus {
    step.d.fill(0.0);
    QpStatus::Expired
}

/// Blocks `j - 1` and `j` of blocks of `size` numbers.
#[inline(always)]
fn neighbours(blocks: &mut [f64], j: usize, size: usize) -> (&mut [f64], &mut [f64]) {
    blocks[(j - 1) * size..(j + 1) * size].split_at_mut(size)
}

impl QpSolver for CondensedQp {
    fn solve(&mut self, qp: &Qp, step: &mut QpStep, expired: &mut dyn FnMut() -> bool) -> QpStatus {
        if !self.condense(qp, expired) {
            return nothing_yet(step);
        }
        if self.most_growth < f64::INFINITY && self.panels.growth(qp.dims) > self.most_growth {
            return QpStatus::Failed;
        }
        self.guess(qp, step);
        match self.solver.solve(&self.dense, expired) {
            DenseStatus::Solved => {
                self.expand(qp, step);
                QpStatus::Solved
            }
            DenseStatus::Infeasible(row) => QpStatus::Infeasible(self.source(qp, row)),
            DenseStatus::Failed => QpStatus::Failed,
            DenseStatus::ExpiredAtStart => nothing_yet(step),
            DenseStatus::Expired => {
                self.expand(qp, step);
                QpStatus::Expired
            }
        }
    }

    fn take_work(&mut self) -> QpWork {
        std::mem::take(&mut self.solver.work)
    }
}
