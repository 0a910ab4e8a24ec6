//! The linear system of the optimality conditions, stage by stage.

use pinc_ode::Banded;
use pinc_qp::{OcpDims, Qp};

/// A pivot whose reciprocal is larger, in a matrix with rows and columns of size 1, counts as 0.
const LARGEST_RECIPROCAL: f64 = 1e11;

/// How often rows and columns are brought to size 1.
const EQUILIBRATIONS: usize = 3;

/// Where the parts of a vector of the optimality conditions begin: z, lambda of the dynamics, mu of
/// the bounds, nu of the increments and eta of the rows; and its length.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Places {
    pub(crate) dynamics: usize,
    pub(crate) bounds: usize,
    pub(crate) increments: usize,
    pub(crate) rows: usize,
    pub(crate) length: usize,
}

impl Places {
    pub(crate) fn new(dims: OcpDims) -> Self {
        let dynamics = dims.unknowns();
        let bounds = dynamics + dims.all_states();
        let increments = bounds + dims.unknowns();
        let rows = increments + dims.all_inputs();
        Self { dynamics, bounds, increments, rows, length: rows + dims.all_rows() }
    }
}

/// The matrix of the optimality conditions of a [`Qp`], whose Hessian may be indefinite,
///
/// ```text
/// H dz + A'dlambda = r
/// a_i'dz - delta_i dmu_i = r_i     where delta_i is finite, dmu_i = 0 elsewhere
/// ```
///
/// with the dynamics among the rows, delta = 0. Unknowns are ordered by stages, so that the matrix
/// is a band, as wide as a stage; a held input has a copy at each stage.
#[derive(Debug, Default)]
pub(crate) struct KktSystem {
    band: Banded,
    /// Where each unknown is in the band, if it is there.
    order: Vec<Option<usize>>,
    /// By what rows and columns are multiplied.
    scales: Vec<f64>,
    entries: Vec<(usize, usize, f64)>,
    right: Vec<f64>,
}

impl KktSystem {
    /// Factors the matrix; `compliance` has delta of bounds, increments and rows. Returns whether
    /// the matrix is regular.
    pub(crate) fn factor(&mut self, qp: &Qp, compliance: &[f64]) -> bool {
        let held = Held::new(qp.dims);
        let size = self.order_unknowns(held, compliance);
        self.entries.clear();
        self.add_hessian(qp, held);
        self.add_dynamics(qp, held);
        self.add_limits(qp, held, compliance);
        self.equilibrate(size);
        let width = self.entries.iter().map(|(i, k, _)| i.abs_diff(*k)).max().unwrap_or(0);
        self.band.clear(size, [width, width]);
        for &(row, column, value) in &self.entries {
            self.band.add(row, column, value);
            if row != column {
                self.band.add(column, row, value);
            }
        }
        self.band.factor() && self.band.largest_reciprocal() < LARGEST_RECIPROCAL
    }

    /// Replaces the right-hand side `vector`, laid out as [`Places`], by the solution. The matrix
    /// is symmetric.
    pub(crate) fn solve(&mut self, vector: &mut [f64]) {
        self.right.clear();
        self.right.resize(self.scales.len(), 0.0);
        for (value, place) in vector.iter().zip(&self.order) {
            if let Some(place) = *place {
                self.right[place] = value * self.scales[place];
            }
        }
        self.band.solve(&mut self.right);
        for (value, place) in vector.iter_mut().zip(&self.order) {
            *value = place.map_or(0.0, |place| self.right[place] * self.scales[place]);
        }
    }

    /// Gives each unknown its place, by stages; returns how many there are.
    fn order_unknowns(&mut self, held: Held, compliance: &[f64]) -> usize {
        let (dims, at) = (held.dims, held.at);
        let OcpDims { nx, nu, horizon, n_controls, n1, .. } = dims;
        self.order.clear();
        self.order.resize(held.unknowns(), None);
        let mut next = 0;
        let order = &mut self.order;
        let mut take = |unknowns: std::ops::Range<usize>| {
            for unknown in unknowns {
                let limit = unknown.checked_sub(at.bounds).and_then(|i| compliance.get(i));
                if limit.is_none_or(|delta| delta.is_finite()) {
                    order[unknown] = Some(next);
                    next += 1;
                }
            }
        };
        for j in 0..horizon {
            if j < n_controls {
                let input = dims.input(j);
                let increment = at.increments + j * nu;
                take(input.clone());
                take(increment..increment + nu);
                take(at.bounds + input.start..at.bounds + input.end);
            } else {
                take(held.copy(j).start..held.copy(j).end + nu);
            }
            let state = dims.next_state(j);
            take(at.dynamics + j * nx..at.dynamics + (j + 1) * nx);
            take(state.clone());
            take(at.bounds + state.start..at.bounds + state.end);
            if j + 1 >= n1 {
                let rows = dims.stage_rows(j + 1);
                take(at.rows + rows.start..at.rows + rows.end);
            }
        }
        next
    }

    /// Adds an entry and, if it is not on the diagonal, its mirror image.
    fn entry(&mut self, row: usize, column: usize, value: f64) {
        if let (Some(row), Some(column)) = (self.order[row], self.order[column])
            && value != 0.0
        {
            self.entries.push((row, column, value));
        }
    }

    /// Adds a symmetric block on the diagonal.
    fn diagonal(&mut self, first: usize, block: &[f64], size: usize) {
        for i in 0..size {
            for k in 0..=i {
                self.entry(first + i, first + k, block[i * size + k]);
            }
        }
    }

    /// Adds a block beside the diagonal, times `factor`.
    fn block(&mut self, row: usize, column: usize, block: &[f64], width: usize, factor: f64) {
        for (i, values) in block.chunks_exact(width).enumerate() {
            for (k, value) in values.iter().enumerate() {
                self.entry(row + i, column + k, factor * value);
            }
        }
    }

    fn add_hessian(&mut self, qp: &Qp, held: Held) {
        let dims = qp.dims;
        let OcpDims { nx, nu, .. } = dims;
        for j in 1..=dims.horizon {
            let state = dims.next_state(j - 1).start;
            self.diagonal(state, qp.q(j), nx);
            if let Some(s) = qp.s(j) {
                self.block(held.input_at(j), state, s, nx, 1.0);
            }
            if let Some(s) = qp.s_before(j) {
                self.block(held.input_at(j - 1), state, s, nx, 1.0);
            }
        }
        for i in 0..dims.n_controls {
            let input = dims.input(i).start;
            self.diagonal(input, qp.r(i), nu);
            if let Some(before) = i.checked_sub(1) {
                let before = dims.input(before).start;
                self.diagonal(before, qp.r(i), nu);
                self.block(input, before, qp.r(i), nu, -1.0);
            }
            if let Some(t) = qp.t(i) {
                self.diagonal(input, t, nu);
            }
        }
        if !qp.w.is_empty() {
            self.diagonal(dims.all_states(), &qp.w, dims.all_inputs());
        }
    }

    fn add_dynamics(&mut self, qp: &Qp, held: Held) {
        let dims = qp.dims;
        let OcpDims { nx, nu, n_controls, horizon, .. } = dims;
        for j in 0..horizon {
            let row = held.at.dynamics + j * nx;
            if let Some(state) = dims.state(j) {
                self.block(row, state.start, qp.a(j), nx, 1.0);
            }
            self.block(row, held.input_at(j), qp.b(j), nu, 1.0);
            for i in 0..nx {
                self.entry(row + i, dims.next_state(j).start + i, -1.0);
            }
            if j >= n_controls {
                let copy = held.copy(j);
                for i in 0..nu {
                    self.entry(copy.start + i, copy.end + i, 1.0);
                    self.entry(copy.start + i, held.input_at(j - 1) + i, -1.0);
                }
            }
        }
    }

    fn add_limits(&mut self, qp: &Qp, held: Held, compliance: &[f64]) {
        let (dims, at) = (qp.dims, held.at);
        for v in 0..dims.unknowns() {
            self.entry(at.bounds + v, v, 1.0);
        }
        for v in 0..dims.all_inputs() {
            let input = dims.all_states() + v;
            self.entry(at.increments + v, input, 1.0);
            if v >= dims.nu {
                self.entry(at.increments + v, input - dims.nu, -1.0);
            }
        }
        let stages = if dims.rows() > 0 { dims.constrained() } else { 0..0 };
        for j in stages {
            for (block, stage) in dims.row_blocks(j).into_iter().zip([j, j - 1, j - 1]) {
                let first = at.rows + block.rows.start;
                let [by_x, by_u] = qp.row_jacobians(block.rows);
                if let Some(state) = dims.state(block.state) {
                    self.block(first, state.start, by_x, dims.nx, 1.0);
                }
                self.block(first, held.input_at(stage), by_u, dims.nu, 1.0);
            }
        }
        for (i, delta) in compliance.iter().enumerate() {
            self.entry(at.bounds + i, at.bounds + i, -delta);
        }
    }

    /// Scales rows and columns such that the largest entry of each is about 1.
    fn equilibrate(&mut self, size: usize) {
        self.scales.clear();
        self.scales.resize(size, 1.0);
        for _ in 0..EQUILIBRATIONS {
            self.right.clear();
            self.right.resize(size, 0.0);
            for &(row, column, value) in &self.entries {
                let value = value.abs() * self.scales[row] * self.scales[column];
                self.right[row] = self.right[row].max(value);
                self.right[column] = self.right[column].max(value);
            }
            for (scale, most) in self.scales.iter_mut().zip(&self.right) {
                if *most > 0.0 {
                    *scale /= most.sqrt();
                }
            }
        }
        for (row, column, value) in &mut self.entries {
            *value *= self.scales[*row] * self.scales[*column];
        }
    }
}

/// The unknowns, with copies of the input that is held to the end of the horizon: each copy has a
/// multiplier, for that it is equal to the input of the stage before.
#[derive(Clone, Copy, Debug)]
struct Held {
    dims: OcpDims,
    at: Places,
}

impl Held {
    fn new(dims: OcpDims) -> Self {
        Self { dims, at: Places::new(dims) }
    }

    /// How many unknowns there are with the copies.
    fn unknowns(self) -> usize {
        self.at.length + 2 * (self.dims.horizon - self.dims.n_controls) * self.dims.nu
    }

    /// Where the multipliers of the copy at stage `j` are; the copy comes after them.
    fn copy(self, j: usize) -> std::ops::Range<usize> {
        let first = self.at.length + 2 * (j - self.dims.n_controls) * self.dims.nu;
        first..first + self.dims.nu
    }

    /// Where the input that acts in stage `j` is, or its copy.
    fn input_at(self, j: usize) -> usize {
        let j = j.min(self.dims.horizon - 1);
        if j < self.dims.n_controls { self.dims.input(j).start } else { self.copy(j).end }
    }
}
