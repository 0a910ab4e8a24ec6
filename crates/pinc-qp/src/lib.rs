#![doc = include_str!("../README.md")]
//! # Tour
//!
//! - [`Qp`]: the program, stage by stage, with its [`OcpDims`] and [`Limits`]; [`QpStep`] its
//!   solution with the [`Multipliers`].
//! - [`QpSolver`]: a method; [`ChosenQp`] the one that [`QpMethod`] names, which says in what units
//!   a program may be.
//! - [`Convexifier`]: makes a program convex where it is not; [`Elastic`]: its hard limits soft for a while.

#![forbid(unsafe_code)]

/// Runs code with the numbers of states n and inputs m of a plant. For (2, 1) and (4, 2), the sizes
/// of small plants, these are constants, and the loops over them, which the code must have inlined,
/// are unrolled. The code stands three times in the program.
macro_rules! sized {
    ($dims:expr, |$n:ident, $m:ident| $run:expr) => {
        match ($dims.nx, $dims.nu) {
            (2, 1) => {
                let ($n, $m) = (2, 1);
                $run
            }
            (4, 2) => {
                let ($n, $m) = (4, 2);
                $run
            }
            ($n, $m) => $run,
        }
    };
}

mod algebra;
mod anderson;
mod choice;
#[cfg(feature = "clarabel")]
mod clarabel;
mod condense;
mod convexify;
mod dense;
mod elastic;
mod factor;
mod multipliers;
mod ocp_dims;
mod product;
mod riccati;
#[cfg(test)]
mod tests;
mod tree;
mod work;

pub use algebra::{all_finite, largest, symmetrize};
pub use anderson::Anderson;
pub use choice::{ChosenQp, QpError, QpMethod};
pub use convexify::{Convexifier, Convexity};
pub use elastic::Elastic;
pub use multipliers::{Multipliers, residual_scale};
pub use ocp_dims::{OcpDims, RowBlock};
pub use riccati::Barrier;
pub use tree::Tree;
pub use work::QpWork;

#[cfg(feature = "clarabel")]
use clarabel::ClarabelQp;
use condense::CondensedQp;
use riccati::RiccatiQp;

use algebra::{add_scaled, add_transposed, block, block_mut};
use std::fmt::Debug;
use std::ops::Range;

/// Steps that are longer than this are not considered when rows are proved to contradict each other.
const FARTHEST: f64 = 1e5;

/// The control problem linearized at a point z, in the unknown step `d = (dx_1, .., du_0, ..)`:
///
/// ```text
/// min  g'd + sum_{j=1..N} dx_j' Q_j dx_j / 2 + sum_{i<Nu} (du_i - du_{i-1})' R_i (du_i - du_{i-1}) / 2
///      + sum_{j=1..N} (du_j' S_j dx_j + du_{j-1}' E_j dx_j)
///      + sum_{i<Nu} du_i' T_i du_i / 2 + du' W du / 2
///      + sum_i penalty_i violation_i
/// s.t. dx_{j+1} = A_j dx_j + B_j du_j + c_j,    dx_0 = 0, du_{-1} = 0     j = 0..N-1
///      d                    within bounds
///      du_i - du_{i-1}      within increments                            i = 0..Nu-1
///      C_j dx_j + D_j du_j  within rows                                  j = N1..N
/// ```
///
/// with, for outputs that depend on the input, further rows at both ends of each interval, of
/// (`dx_j`, `du_{j-1}`) and of (`dx_{j-1}`, `du_{j-1}`): see [`OcpDims::row_blocks`].
///
/// On a [`Tree`] that branches, the index before j or i is the one of the node before (see
/// [`OcpDims`]): `dx_{j+1} = A_j dx_o + B_j du_o + c_j` with the node o that stage j leads from.
///
/// Throughout `du_j` = `du_{Nu-1}` for j >= Nu, `c_j = f(x_j, u_j) - x_{j+1}`, and du all inputs as one
/// vector.
///
/// R and W are the same in all QPs, and so is Q in all QPs without S. The Hessian as a whole must be
/// positive semidefinite on the dynamics.
#[derive(Clone, Debug)]
pub struct Qp {
    /// The sizes.
    pub dims: OcpDims,
    /// `Q_1`, `Q_2`, ..: `[N, n, n]`, symmetric and positive semidefinite.
    pub q: Vec<f64>,
    /// `R_0`, `R_1`, .., of the increments: `[Nu, m, m]`, of the same kind.
    pub r: Vec<f64>,
    /// `S_1`, `S_2`, .., of products of inputs and states: `[N, m, n]`. Empty: there are none, Q is
    /// the same in all QPs, and `t` is empty too.
    pub s: Vec<f64>,
    /// `E_1`, `E_2`, .., of products of states and the inputs of the intervals that lead there:
    /// `[N, m, n]`; or empty, always with an empty `s`.
    pub s_before: Vec<f64>,
    /// `T_0`, `T_1`, .., of the inputs themselves: `[Nu, m, m]`, symmetric; or empty with `s`.
    pub t: Vec<f64>,
    /// W, of all inputs: `[Nu m, Nu m]`, symmetric and positive semidefinite; or empty. The
    /// stage-wise method cannot solve programs that have it.
    pub w: Vec<f64>,
    /// `A_j`, `[N, n, n]`.
    pub a: Vec<f64>,
    /// `B_j`, `[N, n, m]`.
    pub b: Vec<f64>,
    /// `c_j`, `[N, n]`.
    pub c: Vec<f64>,
    /// `C_j` and the like of all rows, `[N - N1 + 1, rows, n]`. Of rows at the measured state they
    /// say what a plant measured elsewhere changes; no method reads them.
    pub rows_x: Vec<f64>,
    /// `D_j` and the like, `[N - N1 + 1, rows, m]`.
    pub rows_u: Vec<f64>,
    /// g, as long as z.
    pub gradient: Vec<f64>,
    /// As long as z.
    pub bounds: Limits,
    /// `[Nu, m]`
    pub increments: Limits,
    /// `[N - N1 + 1, rows]`: inequalities without lower limit, equalities, then rows with any
    /// limits.
    pub rows: Limits,
    /// D, `[n]`: where the Hessian must be shifted to be convex, each Q gets delta D and each T
    /// delta I.
    pub shift_weights: Vec<f64>,
}

/// How many rows are looked at together.
const CHUNK: usize = 16;

/// Limits on the rows of one kind of constraint. Which of `low` and `high` are finite is the same
/// in all QPs; `penalty` may change.
#[derive(Clone, Debug)]
pub struct Limits {
    /// Finite or minus infinity.
    pub low: Vec<f64>,
    /// Finite or infinity. Where it is `low`, the row is an equality.
    pub high: Vec<f64>,
    /// The largest absolute value of the multiplier, positive. Infinite: the row is hard. Finite:
    /// the row may be violated at a cost of `penalty` per unit, and its multiplier is then
    /// `penalty` (exact penalty).
    pub penalty: Vec<f64>,
}

impl Limits {
    /// No limits on `rows` hard rows.
    #[must_use]
    #[inline]
    pub fn none(rows: usize) -> Self {
        Self {
            low: vec![f64::NEG_INFINITY; rows],
            high: vec![f64::INFINITY; rows],
            penalty: vec![f64::INFINITY; rows],
        }
    }

    /// Low, high and penalty of each row.
    #[inline]
    pub fn iter(&self) -> impl Iterator<Item = [f64; 3]> {
        self.low
            .iter()
            .zip(&self.high)
            .zip(&self.penalty)
            .map(|((&low, &high), &penalty)| [low, high, penalty])
    }

    /// Tells `found` the rows, in their order, for which `is` holds: of low, high and the row's number in
    /// `list`. Rows are passed over in vectors where it holds for none, so it should hold for few.
    #[inline(always)]
    pub fn find(
        &self,
        list: &[f64],
        is: impl Fn(f64, f64, f64) -> bool,
        mut found: impl FnMut(usize, [f64; 3]),
    ) {
        let sides = self.low.chunks(CHUNK).zip(self.high.chunks(CHUNK));
        for (chunk, ((low, high), list)) in sides.zip(list.chunks(CHUNK)).enumerate() {
            let rows = low.iter().zip(high).zip(list);
            if rows.fold(false, |any, ((&low, &high), &value)| any | is(low, high, value)) {
                for (i, ((&low, &high), &value)) in low.iter().zip(high).zip(list).enumerate() {
                    if is(low, high, value) {
                        found(chunk * CHUNK + i, [low, high, value]);
                    }
                }
            }
        }
    }
}

/// The solution of a [`Qp`].
#[derive(Clone, Debug)]
pub struct QpStep {
    /// d
    pub d: Vec<f64>,
    /// Positive at upper limits, negative at lower ones.
    pub multipliers: Multipliers,
}

impl QpStep {
    /// All 0.
    #[must_use]
    pub fn new(dims: OcpDims) -> Self {
        Self { d: vec![0.0; dims.unknowns()], multipliers: Multipliers::new(dims) }
    }

    /// Whether all numbers are finite.
    #[must_use]
    #[inline]
    pub fn is_finite(&self) -> bool {
        all_finite(&self.d) && self.multipliers.is_finite()
    }
}

/// How the solution of a [`Qp`] ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum QpStatus {
    /// The step is the solution.
    Solved,
    /// There is no feasible step; this row is part of the conflict.
    Infeasible(Row),
    /// The method found no solution: a number is not finite, or rounding won.
    Failed,
    /// The time was up before there was a solution: the step is on the way there, with some limits
    /// not met yet, or 0; its multipliers are the guess to go on from.
    Expired,
}

/// A row of a [`Qp`]'s limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Row {
    /// Which kind of limit.
    pub kind: Kind,
    /// Its place in the limits of its kind.
    pub index: usize,
    /// Whether it is the upper limit that matters.
    pub upper: bool,
}

/// The kinds of rows with limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// On an unknown.
    Bound,
    /// On an increment of the inputs.
    Increment,
    /// On a row of h or g.
    Row,
}

/// A method that solves the QPs of one control problem.
pub trait QpSolver: Debug + Send {
    /// Solves `qp`. On entry the multipliers in `step` are a guess, by which a solver may know
    /// which constraints are likely to be active; on exit, if the status is [`QpStatus::Solved`],
    /// `step` is the solution. Otherwise it means nothing, except when the time is up.
    ///
    /// `expired` says whether the time is up; it is asked now and then while the method works. The
    /// status is then [`QpStatus::Expired`].
    fn solve(&mut self, qp: &Qp, step: &mut QpStep, expired: &mut dyn FnMut() -> bool) -> QpStatus;

    /// The work since this was last asked.
    fn take_work(&mut self) -> QpWork;
}

impl Qp {
    /// A program without limits, in which all numbers outside the Hessian are 0.
    #[must_use]
    pub fn new(dims: OcpDims, q: Vec<f64>, r: Vec<f64>) -> Self {
        let OcpDims { nx, nu, horizon, .. } = dims;
        Self {
            dims,
            q,
            r,
            s: Vec::new(),
            s_before: Vec::new(),
            t: Vec::new(),
            w: Vec::new(),
            a: vec![0.0; horizon * nx * nx],
            b: vec![0.0; horizon * nx * nu],
            c: vec![0.0; horizon * nx],
            rows_x: vec![0.0; dims.all_rows() * nx],
            rows_u: vec![0.0; dims.all_rows() * nu],
            gradient: vec![0.0; dims.unknowns()],
            bounds: Limits::none(dims.unknowns()),
            increments: Limits::none(dims.all_inputs()),
            rows: Limits::none(dims.all_rows()),
            shift_weights: vec![1.0; nx],
        }
    }

    /// Adds S and T, all 0 at first; from then on Q, S and T may change from QP to QP.
    #[must_use]
    #[inline]
    pub fn with_stage_cost(mut self) -> Self {
        let OcpDims { nx, nu, horizon, n_controls, .. } = self.dims;
        self.s = vec![0.0; horizon * nu * nx];
        self.t = vec![0.0; n_controls * nu * nu];
        self
    }

    /// Adds S, T and E, all 0 at first.
    #[must_use]
    #[inline]
    pub fn with_end_cost(self) -> Self {
        let mut qp = self.with_stage_cost();
        qp.s_before = vec![0.0; qp.s.len()];
        qp
    }

    /// Copies all numbers of a program of the same problem; S, E and T that it does not have become 0.
    pub fn copy_from(&mut self, other: &Self) {
        let Self { q, r, s, s_before, t, w, a, b, c, rows_x, rows_u, gradient, .. } = self;
        for (to, from) in [
            (q, &other.q),
            (r, &other.r),
            (s, &other.s),
            (s_before, &other.s_before),
            (t, &other.t),
            (w, &other.w),
            (a, &other.a),
            (b, &other.b),
            (c, &other.c),
            (rows_x, &other.rows_x),
            (rows_u, &other.rows_u),
            (gradient, &other.gradient),
        ] {
            match from.is_empty() {
                true => to.fill(0.0),
                false => to.copy_from_slice(from),
            }
        }
        let Self { bounds, increments, rows, .. } = self;
        for (to, from) in
            [(bounds, &other.bounds), (increments, &other.increments), (rows, &other.rows)]
        {
            to.low.copy_from_slice(&from.low);
            to.high.copy_from_slice(&from.high);
            to.penalty.copy_from_slice(&from.penalty);
        }
    }

    /// Whether Q, S, E and T may change from QP to QP.
    #[must_use]
    #[inline]
    pub fn has_stage_cost(&self) -> bool {
        !self.s.is_empty()
    }

    /// `A_j`, `[n, n]`.
    #[must_use]
    #[inline]
    pub fn a(&self, j: usize) -> &[f64] {
        block(&self.a, j, self.dims.nx * self.dims.nx)
    }

    /// `B_j`, `[n, m]`.
    #[must_use]
    #[inline]
    pub fn b(&self, j: usize) -> &[f64] {
        block(&self.b, j, self.dims.nx * self.dims.nu)
    }

    /// `Q_j` of the state `x_j`, j = 1..N, `[n, n]`.
    #[must_use]
    #[inline]
    pub fn q(&self, j: usize) -> &[f64] {
        block(&self.q, j - 1, self.dims.nx * self.dims.nx)
    }

    /// `S_j` and `E_j`, `[m, n]`, of products of `x_j`, j = 1..N, with an input, as far as there are
    /// any, each with the index of its input.
    #[inline(always)]
    pub fn cross(&self, j: usize) -> impl Iterator<Item = (usize, &[f64])> {
        let here = self.s(j).map(|s| (self.dims.acting(j), s));
        here.into_iter().chain(self.s_before(j).map(|s| (self.dims.input_of(j - 1), s)))
    }

    /// `S_j` of `x_j` and the input that acts there, j = 1..N, `[m, n]`, if there is one.
    #[must_use]
    #[inline]
    pub fn s(&self, j: usize) -> Option<&[f64]> {
        let width = self.dims.nu * self.dims.nx;
        self.s.get((j - 1) * width..j * width)
    }

    /// `E_j` of `x_j` and the input of the interval that leads there, j = 1..N, `[m, n]`, if there
    /// is one.
    #[must_use]
    #[inline]
    pub fn s_before(&self, j: usize) -> Option<&[f64]> {
        let width = self.dims.nu * self.dims.nx;
        self.s_before.get((j - 1) * width..j * width)
    }

    /// `T_i`, `[m, m]`, if there is one.
    #[must_use]
    #[inline]
    pub fn t(&self, i: usize) -> Option<&[f64]> {
        let width = self.dims.nu * self.dims.nu;
        self.t.get(i * width..(i + 1) * width)
    }

    /// `R_i`, `[m, m]`.
    #[must_use]
    #[inline]
    pub fn r(&self, i: usize) -> &[f64] {
        block(&self.r, i, self.dims.nu * self.dims.nu)
    }

    /// The Jacobians of some rows, by their states, `[rows, n]`, and by their inputs, `[rows, m]`.
    #[must_use]
    #[inline]
    pub fn row_jacobians(&self, rows: Range<usize>) -> [&[f64]; 2] {
        let OcpDims { nx, nu, .. } = self.dims;
        let Range { start, end } = rows;
        [&self.rows_x[start * nx..end * nx], &self.rows_u[start * nu..end * nu]]
    }

    /// Writes the gradient of the Lagrangian at d = 0 into `gradient`, as long as z,
    ///
    /// ```text
    /// g + mu - lambda_j + A_j' lambda_{j+1}, ..    plus terms of the increments and rows
    /// ```
    ///
    /// the slope of the problem that was linearized, with these multipliers.
    pub fn lagrangian_gradient(&self, multipliers: &Multipliers, gradient: &mut [f64]) {
        let dims = self.dims;
        for ((sum, g), mu) in gradient.iter_mut().zip(&self.gradient).zip(&multipliers.bounds) {
            *sum = g + mu;
        }
        let (states, inputs) = gradient.split_at_mut(dims.all_states());
        let sums = [&mut *states, &mut *inputs];
        sized!(dims, |n, m| self.add_dynamics(&multipliers.dynamics, sums, n, m));
        for (i, nu) in multipliers.increments.chunks_exact(dims.nu).enumerate() {
            add_scaled(block_mut(inputs, i, dims.nu), 1.0, nu);
            if let Some(before) = dims.input_before(i) {
                add_scaled(block_mut(inputs, before, dims.nu), -1.0, nu);
            }
        }
        for j in dims.stages_with_rows() {
            for RowBlock { rows, state, input } in dims.row_blocks(j) {
                let eta = &multipliers.rows[rows.clone()];
                let [by_x, by_u] = self.row_jacobians(rows);
                if let Some(state) = dims.state(state) {
                    add_transposed(by_x, eta, &mut gradient[state]);
                }
                add_transposed(by_u, eta, &mut gradient[dims.input(input)]);
            }
        }
    }

    /// The part of the dynamics in [`Qp::lagrangian_gradient`]. With constants for `n` and `m` it
    /// is unrolled.
    #[inline(always)]
    fn add_dynamics(&self, lambda: &[f64], [states, inputs]: [&mut [f64]; 2], n: usize, m: usize) {
        for j in 0..self.dims.horizon {
            let lambda = block(lambda, j, n);
            for (sum, lambda) in block_mut(states, j, n).iter_mut().zip(lambda) {
                *sum -= lambda;
            }
            let origin = self.dims.origin(j);
            if let Some(before) = origin.checked_sub(1) {
                add_transposed(block(&self.a, j, n * n), lambda, block_mut(states, before, n));
            }
            let input = block_mut(inputs, self.dims.acting(origin), m);
            add_transposed(block(&self.b, j, n * m), lambda, input);
        }
    }

    /// The limits with their kind.
    #[must_use]
    #[inline]
    pub fn limits(&self) -> [(Kind, &Limits); 3] {
        [(Kind::Bound, &self.bounds), (Kind::Increment, &self.increments), (Kind::Row, &self.rows)]
    }
}
