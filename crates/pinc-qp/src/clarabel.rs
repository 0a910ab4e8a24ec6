//! The general backend: Clarabel's interior-point method.

use super::{FARTHEST, Kind, Limits, Qp, QpSolver, QpStatus, QpStep, QpWork, Row};
use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, ZeroConeT,
};
use std::fmt;

/// A Clarabel solver that is built once and given new numbers for each QP, in the unknowns v = (d,
/// s), where s are the violations of the soft rows:
///
/// ```text
/// min v'H v / 2 + q'v   s.t.   M v + t = r,   t = 0 for dynamics and equalities, t >= 0 for the rest
/// ```
///
/// M has the full blocks of the QP, a line per finite limit, and a line per violation. It is built
/// anew where other rows are soft than before, or where the Hessian has products of states and inputs
/// that it did not have.
pub(crate) struct ClarabelQp {
    layout: Layout,
    solver: DefaultSolver<f64>,
    /// q
    linear: Vec<f64>,
    /// M's values, column by column.
    matrix: Vec<f64>,
    /// r
    right: Vec<f64>,
    work: QpWork,
}

impl fmt::Debug for ClarabelQp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ClarabelQp")
            .field("rows", &self.right.len())
            .field("entries", &self.matrix.len())
            .finish_non_exhaustive()
    }
}

impl QpSolver for ClarabelQp {
    fn solve(
        &mut self,
        qp: &Qp,
        step: &mut QpStep,
        _expired: &mut dyn FnMut() -> bool,
    ) -> QpStatus {
        if !self.layout.suits(qp) {
            *self = Self { work: self.work, ..Self::new(qp) };
        }
        self.update(qp);
        self.solver.solve();
        self.work.factorizations += self.solver.solution.iterations as usize;
        match self.solver.solution.status {
            // "Almost": short of the tolerances below. The caller judges the outcome anyway.
            SolverStatus::Solved | SolverStatus::AlmostSolved => {
                self.read(qp, step);
                QpStatus::Solved
            }
            SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible => {
                self.conflict().map_or(QpStatus::Failed, QpStatus::Infeasible)
            }
            _ => QpStatus::Failed,
        }
    }

    fn take_work(&mut self) -> QpWork {
        std::mem::take(&mut self.work)
    }
}

impl ClarabelQp {
    /// A solver for QPs of the sizes of `qp`, with finite limits and penalties where it has them.
    pub(crate) fn new(qp: &Qp) -> Self {
        let layout = Layout::new(qp);
        let [linear, right] = [vec![0.0; layout.columns], vec![0.0; layout.height()]];
        let mut matrix = layout.pattern();
        layout.entries.iter().zip(&mut matrix.nzval).for_each(|(e, value)| *value = e.value(qp));
        let equalities = layout.dynamics + layout.equalities;
        let cones = [ZeroConeT(equalities), NonnegativeConeT(layout.height() - equalities)];
        let hessian = hessian(qp, layout.columns);
        let solver = DefaultSolver::new(&hessian, &linear, &matrix, &right, &cones, settings())
            .expect("the sizes have just been counted and the settings are constants");
        Self { layout, solver, linear, matrix: matrix.nzval, right, work: QpWork::default() }
    }

    fn update(&mut self, qp: &Qp) {
        let layout = &self.layout;
        for (value, entry) in self.matrix.iter_mut().zip(&layout.entries) {
            *value = entry.value(qp);
        }
        for (right, c) in self.right.iter_mut().zip(&qp.c) {
            *right = -c;
        }
        for (right, line) in self.right[layout.dynamics..].iter_mut().zip(&layout.lines) {
            *right = line.right(qp);
        }
        let unknowns = qp.gradient.len();
        self.linear[..unknowns].copy_from_slice(&qp.gradient);
        for (linear, soft) in self.linear[unknowns..].iter_mut().zip(&layout.soft) {
            *linear = limits(qp, soft.kind).penalty[soft.index];
        }
        let updated = if qp.has_stage_cost() {
            let hessian = hessian(qp, layout.columns).nzval;
            self.solver.update_data(&hessian, &self.linear, &self.matrix, &self.right)
        } else {
            let stays: [f64; 0] = [];
            self.solver.update_data(&stays, &self.linear, &self.matrix, &self.right)
        };
        updated.expect("all lengths are as at construction, and nothing was presolved");
    }

    fn read(&self, qp: &Qp, step: &mut QpStep) {
        let solution = &self.solver.solution;
        step.d.copy_from_slice(&solution.x[..qp.gradient.len()]);
        let multipliers = &mut step.multipliers;
        multipliers.clear();
        let dynamics = self.layout.dynamics;
        multipliers.dynamics.copy_from_slice(&solution.z[..dynamics]);
        for (line, z) in self.layout.lines.iter().zip(&solution.z[dynamics..]) {
            let part = match line.row.kind {
                Kind::Bound => &mut multipliers.bounds,
                Kind::Increment => &mut multipliers.increments,
                Kind::Row => &mut multipliers.rows,
            };
            part[line.row.index] += line.sign() * z;
        }
    }

    /// The row that weighs most in the certificate of infeasibility (Farkas): M'z = 0 and r'z < 0.
    /// Clarabel measures M'z against sizes of r and z that may be large; here no step within
    /// [`FARTHEST`] may make up for what is left of it.
    fn conflict(&self) -> Option<Row> {
        let z = &self.solver.solution.z;
        let mut slope = vec![0.0; self.layout.columns];
        for (entry, value) in self.layout.entries.iter().zip(&self.matrix) {
            slope[entry.column] += value * z[entry.row];
        }
        let remainder: f64 = slope.iter().map(|s| s.abs()).sum();
        let height: f64 = self.right.iter().zip(z).map(|(right, z)| right * z).sum();
        if height + FARTHEST * remainder >= 0.0 {
            return None;
        }
        let weights = &z[self.layout.dynamics..];
        let lines = self.layout.lines.iter().zip(weights);
        let (line, weight) = lines.max_by(|(_, z), (_, w)| z.abs().total_cmp(&w.abs()))?;
        let upper = if line.equality { *weight > 0.0 } else { line.row.upper };
        Some(Row { upper, ..line.row })
    }
}

fn limits(qp: &Qp, kind: Kind) -> &Limits {
    match kind {
        Kind::Bound => &qp.bounds,
        Kind::Increment => &qp.increments,
        Kind::Row => &qp.rows,
    }
}

/// A limit as a line of M.
#[derive(Clone, Copy)]
struct Line {
    row: Row,
    equality: bool,
}

impl Line {
    fn sign(self) -> f64 {
        if self.row.upper { 1.0 } else { -1.0 }
    }

    fn right(self, qp: &Qp) -> f64 {
        let limits = limits(qp, self.row.kind);
        if self.row.upper { limits.high[self.row.index] } else { -limits.low[self.row.index] }
    }
}

/// An entry of M: its place, and what it is.
#[derive(Clone, Copy)]
struct Entry {
    row: usize,
    column: usize,
    /// The factor of `number`.
    factor: f64,
    number: Number,
}

/// A number of the QP, by its index.
#[derive(Clone, Copy)]
enum Number {
    One,
    A(usize),
    B(usize),
    RowsX(usize),
    RowsU(usize),
}

impl Entry {
    fn value(&self, qp: &Qp) -> f64 {
        let number = match self.number {
            Number::One => 1.0,
            Number::A(i) => qp.a[i],
            Number::B(i) => qp.b[i],
            Number::RowsX(i) => qp.rows_x[i],
            Number::RowsU(i) => qp.rows_u[i],
        };
        self.factor * number
    }
}

/// Which line and which column of M is what.
struct Layout {
    /// The first lines are the dynamics.
    dynamics: usize,
    /// Then come the limits; of these the first are equalities.
    lines: Vec<Line>,
    equalities: usize,
    /// The soft rows; in the end there is a line for the violation of each.
    soft: Vec<Row>,
    columns: usize,
    /// Whether H has products of states with the inputs that act there, and that led there.
    products: [bool; 2],
    /// In the order of a matrix stored by columns.
    entries: Vec<Entry>,
}

impl Layout {
    fn new(qp: &Qp) -> Self {
        let mut lines = Vec::new();
        let mut soft = Vec::new();
        for (kind, limits) in qp.limits() {
            for (index, [low, high, penalty]) in limits.iter().enumerate() {
                let equality = low.total_cmp(&high).is_eq() && penalty.is_infinite();
                let line = |upper| Line { row: Row { kind, index, upper }, equality };
                if high.is_finite() {
                    lines.push(line(true));
                }
                if low.is_finite() && !equality {
                    lines.push(line(false));
                }
                if penalty.is_finite() && (low.is_finite() || high.is_finite()) {
                    soft.push(Row { kind, index, upper: true });
                }
            }
        }
        lines.sort_by_key(|line| !line.equality);
        let equalities = lines.iter().filter(|line| line.equality).count();
        let columns = qp.gradient.len() + soft.len();
        let (dynamics, products, entries) = (qp.c.len(), products(qp), Vec::new());
        let mut layout = Self { dynamics, lines, equalities, soft, columns, products, entries };
        layout.add_dynamics(qp);
        layout.add_lines(qp);
        layout.entries.sort_by_key(|entry| (entry.column, entry.row));
        layout
    }

    /// Whether the soft rows of `qp` and the pattern of its Hessian are these.
    fn suits(&self, qp: &Qp) -> bool {
        let mut soft = self.soft.iter();
        let mut same = self.products == products(qp);
        for (kind, limits) in qp.limits() {
            for (index, [low, high, penalty]) in limits.iter().enumerate() {
                if penalty.is_finite() && (low.is_finite() || high.is_finite()) {
                    same &= soft.next().is_some_and(|s| s.kind == kind && s.index == index);
                }
            }
        }
        same && soft.next().is_none()
    }

    fn height(&self) -> usize {
        self.dynamics + self.lines.len() + self.soft.len()
    }

    fn push(&mut self, row: usize, column: usize, factor: f64, number: Number) {
        self.entries.push(Entry { row, column, factor, number });
    }

    /// `A_j dx_j + B_j du_j - dx_{j+1} = -c_j`
    fn add_dynamics(&mut self, qp: &Qp) {
        let dims = qp.dims;
        let (n, m) = (dims.nx, dims.nu);
        for j in 0..dims.horizon {
            for (i, row) in dims.next_state(j).enumerate() {
                self.push(row, row, -1.0, Number::One);
                let state = dims.state(dims.origin(j));
                for (k, column) in state.into_iter().flatten().enumerate() {
                    self.push(row, column, 1.0, Number::A((j * n + i) * n + k));
                }
                for (k, column) in dims.input(dims.input_of(j)).enumerate() {
                    self.push(row, column, 1.0, Number::B((j * n + i) * m + k));
                }
            }
        }
    }

    fn add_lines(&mut self, qp: &Qp) {
        for (i, line) in self.lines.clone().into_iter().enumerate() {
            let row = self.dynamics + i;
            self.add_line(qp, row, line);
            let same = |s: &Row| s.kind == line.row.kind && s.index == line.row.index;
            if let Some(slack) = self.soft.iter().position(same) {
                self.push(row, qp.gradient.len() + slack, -1.0, Number::One);
            }
        }
        for slack in 0..self.soft.len() {
            let row = self.dynamics + self.lines.len() + slack;
            self.push(row, qp.gradient.len() + slack, -1.0, Number::One);
        }
    }

    fn add_line(&mut self, qp: &Qp, row: usize, line: Line) {
        let dims = qp.dims;
        let (n, m) = (dims.nx, dims.nu);
        let (sign, index) = (line.sign(), line.row.index);
        match line.row.kind {
            Kind::Bound => self.push(row, index, sign, Number::One),
            Kind::Increment => {
                let column = dims.all_states() + index;
                self.push(row, column, sign, Number::One);
                if let Some(before) = dims.entry_before(index) {
                    self.push(row, dims.all_states() + before, -sign, Number::One);
                }
            }
            Kind::Row => {
                let (state, input) = dims.row_place(index);
                for (k, column) in dims.state(state).into_iter().flatten().enumerate() {
                    self.push(row, column, sign, Number::RowsX(index * n + k));
                }
                for (k, column) in dims.input(input).enumerate() {
                    self.push(row, column, sign, Number::RowsU(index * m + k));
                }
            }
        }
    }

    /// M, without values.
    fn pattern(&self) -> CscMatrix<f64> {
        let places = self.entries.iter().map(|entry| (entry.row, entry.column, 0.0));
        compressed(self.height(), self.columns, places)
    }
}

/// [`Layout::products`]
fn products(qp: &Qp) -> [bool; 2] {
    [!qp.s.is_empty(), !qp.s_before.is_empty()]
}

/// The upper triangle of H.
fn hessian(qp: &Qp, columns: usize) -> CscMatrix<f64> {
    let dims = qp.dims;
    let (n, m) = (dims.nx, dims.nu);
    let mut entries = Vec::new();
    for j in 1..=dims.horizon {
        let first = dims.next_state(j - 1).start;
        for column in 0..n {
            for row in 0..=column {
                entries.push((first + row, first + column, qp.q(j)[row * n + column]));
            }
        }
    }
    let inputs = dims.all_states();
    for i in 0..dims.n_controls {
        for column in 0..m {
            let to = dims.input(i).start + column;
            for j in (1..=dims.horizon).filter(|&j| qp.cross(j).any(|(input, _)| input == i)) {
                let entry = |k: usize| {
                    let own = qp.cross(j).filter(|(input, _)| *input == i);
                    own.map(|(_, s)| s[column * n + k]).sum::<f64>()
                };
                let rows = dims.next_state(j - 1).enumerate();
                entries.extend(rows.map(|(k, row)| (row, to, entry(k))));
            }
            // Without W only neighbours are coupled.
            let before = dims.input_before(i).filter(|_| qp.w.is_empty());
            let others = before.map_or(0..i * m, |before| before * m..(before + 1) * m);
            for row in others.chain(i * m..=i * m + column) {
                entries.push((inputs + row, to, between_inputs(qp, row, i * m + column)));
            }
        }
    }
    compressed(columns, columns, entries.into_iter())
}

/// The entry of H for two of all inputs, the first not after the second.
fn between_inputs(qp: &Qp, row: usize, column: usize) -> f64 {
    let m = qp.dims.nu;
    let (i, at) = (column / m, row % m * m + column % m);
    let w = qp.w.get(row * qp.dims.all_inputs() + column).copied().unwrap_or(0.0);
    if i == row / m {
        // The input of the stage that leads to node j is the one before the node's.
        let next = qp.dims.stages_from(i).map(|stage| stage + 1);
        let next: f64 = next.filter(|&j| j < qp.dims.n_controls).map(|j| qp.r(j)[at]).sum();
        qp.r(i)[at] + next + qp.t(i).map_or(0.0, |t| t[at]) + w
    } else if qp.dims.input_before(i) == Some(row / m) {
        w - qp.r(i)[at]
    } else {
        w
    }
}

/// A matrix from its entries in the order of columns, and of rows within them.
fn compressed(
    height: usize,
    width: usize,
    entries: impl Iterator<Item = (usize, usize, f64)>,
) -> CscMatrix<f64> {
    let (mut starts, mut rows, mut values) = (vec![0; width + 1], Vec::new(), Vec::new());
    for (row, column, value) in entries {
        starts[column + 1] += 1;
        rows.push(row);
        values.push(value);
    }
    for column in 0..width {
        starts[column + 1] += starts[column];
    }
    CscMatrix::new(height, width, starts, rows, values)
}

/// Chosen so that a solution passes a KKT test of 1e-8 with digits to spare. Measured on closed
/// loops with random references: with the default regularisation of 1e-8, or with equilibration
/// (of which only the first numbers would be seen), 1e-10 is often out of reach.
fn settings() -> DefaultSettings<f64> {
    DefaultSettings {
        verbose: false,
        tol_gap_abs: 1e-10,
        tol_gap_rel: 1e-10,
        tol_feas: 1e-10,
        static_regularization_constant: 1e-11,
        equilibrate_enable: false,
        // Would forbid new data.
        presolve_enable: false,
        max_threads: 1,
        ..DefaultSettings::default()
    }
}
