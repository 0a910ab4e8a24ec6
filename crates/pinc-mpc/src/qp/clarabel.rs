//! The general backend: Clarabel's interior-point method.

use super::{Qp, QpStatus};
use crate::Bounds;
use crate::cost::Cost;
use crate::solution::Solution;
use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettings, DefaultSolver, IPSolver, NonnegativeConeT, SolverStatus, ZeroConeT,
};
use std::fmt;

/// A Clarabel solver that is built once and given new numbers for each QP:
///
/// ```text
/// min d'H d / 2 + g'd   s.t.   M d + s = r,   s = 0 for the dynamics, s >= 0 for the bounds
/// ```
///
/// M has the full blocks `A_j` and `B_j`, and a row per finite bound.
pub(crate) struct ClarabelQp {
    solver: DefaultSolver<f64>,
    rows: BoundRows,
    /// M's values, column by column.
    matrix: Vec<f64>,
    /// Where in `matrix` each entry of `A_1`, `A_2`, .. is. (`A_0` acts on `dx_0` = 0.)
    a_at: Vec<usize>,
    /// Where in `matrix` each entry of `B_0`, `B_1`, .. is.
    b_at: Vec<usize>,
    /// r
    right: Vec<f64>,
}

impl fmt::Debug for ClarabelQp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ClarabelQp")
            .field("rows", &self.right.len())
            .field("entries", &self.matrix.len())
            .finish_non_exhaustive()
    }
}

impl ClarabelQp {
    /// A solver for QPs of the shape of `qp` with the cost's Hessian; of the bounds on the unknowns
    /// it matters here which are finite.
    pub(crate) fn new(qp: &Qp, cost: &Cost, bounds: &Bounds) -> Self {
        let dynamics = qp.c.len();
        let rows = BoundRows::new(dynamics, bounds);
        let (matrix, a_at, b_at) = constraints(qp, &rows);
        let right = vec![0.0; rows.end];
        let cones = [ZeroConeT(dynamics), NonnegativeConeT(right.len() - dynamics)];
        let hessian = hessian(cost, qp.gradient.len());
        let solver =
            DefaultSolver::new(&hessian, &qp.gradient, &matrix, &right, &cones, settings())
                .expect("the sizes have just been counted and the settings are constants");
        Self { solver, rows, matrix: matrix.nzval, a_at, b_at, right }
    }

    /// Solves `qp`: adds the step to the point `at` and puts the QP's multipliers there. Leaves it
    /// alone unless the status is [`QpStatus::Solved`].
    pub(crate) fn solve(&mut self, qp: &Qp, at: &mut Solution) -> QpStatus {
        self.update(qp);
        self.solver.solve();
        match self.solver.solution.status {
            // "Almost": short of the tolerances below. The caller judges the outcome anyway.
            SolverStatus::Solved | SolverStatus::AlmostSolved => {
                self.apply(at);
                QpStatus::Solved
            }
            SolverStatus::PrimalInfeasible | SolverStatus::AlmostPrimalInfeasible => {
                QpStatus::Infeasible
            }
            _ => QpStatus::Failed,
        }
    }

    fn update(&mut self, qp: &Qp) {
        let first = qp.a.len() - self.a_at.len();
        for (&at, &a) in self.a_at.iter().zip(&qp.a[first..]) {
            self.matrix[at] = a;
        }
        for (&at, &b) in self.b_at.iter().zip(&qp.b) {
            self.matrix[at] = b;
        }
        for (right, c) in self.right.iter_mut().zip(&qp.c) {
            *right = -c;
        }
        for v in 0..qp.gradient.len() {
            if let Some(row) = self.rows.low[v] {
                self.right[row] = -qp.room.low[v];
            }
            if let Some(row) = self.rows.high[v] {
                self.right[row] = qp.room.high[v];
            }
        }
        let hessian_stays: [f64; 0] = [];
        self.solver
            .update_data(&hessian_stays, &qp.gradient, &self.matrix, &self.right)
            .expect("all lengths are as at construction, and nothing was presolved");
    }

    fn apply(&self, at: &mut Solution) {
        let solution = &self.solver.solution;
        for (z, d) in at.z.iter_mut().zip(&solution.x) {
            *z += d;
        }
        let dynamics = at.lambda.len();
        at.lambda.copy_from_slice(&solution.z[..dynamics]);
        let multiplier = |row: Option<usize>| row.map_or(0.0, |row| solution.z[row]);
        for (v, mu) in at.mu.iter_mut().enumerate() {
            *mu = multiplier(self.rows.high[v]) - multiplier(self.rows.low[v]);
        }
    }
}

/// The rows of M that are bounds: `-d_v <= -low_v` and `d_v <= high_v`, where these are finite.
struct BoundRows {
    low: Vec<Option<usize>>,
    high: Vec<Option<usize>>,
    /// The number of all rows.
    end: usize,
}

impl BoundRows {
    /// The rows after the first `dynamics`.
    fn new(dynamics: usize, bounds: &Bounds) -> Self {
        let mut end = dynamics;
        let mut number = |side: &[f64]| -> Vec<Option<usize>> {
            let rows = side.iter().map(|bound| {
                bound.is_finite().then(|| {
                    end += 1;
                    end - 1
                })
            });
            rows.collect()
        };
        let (low, high) = (number(&bounds.low), number(&bounds.high));
        Self { low, high, end }
    }
}

/// M without the values of A and B, and where these go: [`ClarabelQp::a_at`], [`ClarabelQp::b_at`].
fn constraints(qp: &Qp, rows: &BoundRows) -> (CscMatrix<f64>, Vec<usize>, Vec<usize>) {
    let shape = qp.shape;
    let (n, m) = (shape.states, shape.inputs);
    let mut matrix = Columns::default();
    let mut a_at = vec![0; qp.a.len() - n * n];
    let mut b_at = vec![0; qp.b.len()];
    for j in 0..shape.stages {
        for column in 0..n {
            let v = shape.next_state(j).start + column;
            matrix.push(v, -1.0);
            if j + 1 < shape.stages {
                for (i, row) in shape.next_state(j + 1).enumerate() {
                    a_at[(j * n + i) * n + column] = matrix.push(row, 0.0);
                }
            }
            matrix.finish_with_bounds(v, rows);
        }
    }
    for input in 0..shape.moves {
        for column in 0..m {
            for j in (0..shape.stages).filter(|&j| shape.acting(j) == input) {
                for (i, row) in shape.next_state(j).enumerate() {
                    b_at[(j * n + i) * m + column] = matrix.push(row, 0.0);
                }
            }
            matrix.finish_with_bounds(shape.input(input).start + column, rows);
        }
    }
    (matrix.build(rows.end), a_at, b_at)
}

/// The upper triangle of H.
fn hessian(cost: &Cost, unknowns: usize) -> CscMatrix<f64> {
    let mut matrix = Columns::default();
    for v in 0..unknowns {
        if let Some((row, value)) = cost.coupling(v) {
            matrix.push(row, value);
        }
        matrix.push(v, cost.curvature(v));
        matrix.finish();
    }
    matrix.build(unknowns)
}

/// A sparse matrix in the making, column by column.
#[derive(Default)]
struct Columns {
    ends: Vec<usize>,
    rows: Vec<usize>,
    values: Vec<f64>,
}

impl Columns {
    /// Adds an entry to the column, further down than the last, and says where its value is.
    fn push(&mut self, row: usize, value: f64) -> usize {
        self.rows.push(row);
        self.values.push(value);
        self.values.len() - 1
    }

    /// Ends the column.
    fn finish(&mut self) {
        self.ends.push(self.rows.len());
    }

    /// Ends the column of unknown `v` with its bounds.
    fn finish_with_bounds(&mut self, v: usize, rows: &BoundRows) {
        for (row, value) in [(rows.low[v], -1.0), (rows.high[v], 1.0)] {
            if let Some(row) = row {
                self.push(row, value);
            }
        }
        self.finish();
    }

    fn build(self, rows: usize) -> CscMatrix<f64> {
        let starts = [vec![0], self.ends].concat();
        CscMatrix::new(rows, starts.len() - 1, starts, self.rows, self.values)
    }
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
