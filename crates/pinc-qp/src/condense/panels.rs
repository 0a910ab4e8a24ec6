//! The recursions of condensing, with the columns of G in the lanes of vectors.

use crate::algebra::block;
use crate::dense::DenseQp;
use crate::product::{Factor, ROWS, To, multiply, padded};
use crate::{OcpDims, Qp};
use pinc_ad::simd::{Isa, Simd, Task};

/// About how many operations there are between two looks at the clock, counted column by column, as
/// in exported C: a few microseconds.
const UNASKED: usize = 20_000;

/// `x_{j+1} = e_{j+1} + G_{j+1} v` for all stages, and what H and the gradient are made from.
///
/// A *panel* is a matrix, row by row, whose column 0 belongs to the constant 1 and whose column
/// 1 + i to the i-th of the inputs' numbers v. Its rows are padded with zeros. The columns of inputs
/// that do not act yet are 0 or, in the adjoints and in H, not computed.
#[derive(Debug)]
pub(super) struct Panels {
    isa: Isa,
    /// The length of a panel's rows.
    stride: usize,
    /// `(e_{j+1}, G_{j+1})` for j = 0..N, `[N, n, stride]`.
    states: Vec<f64>,
    /// `(p, W)` at a stage, and at the one after, `[n, stride]` each.
    adjoints: [Vec<f64>; 2],
    /// The gradient and the lower triangle of H, `[Nu m, stride]`.
    inputs: Vec<f64>,
    /// How many looks at the clock there are.
    looks: usize,
}

impl Panels {
    pub(super) fn new(dims: OcpDims) -> Self {
        let OcpDims { nx: n, nu: m, horizon, .. } = dims;
        let stride = padded(1 + dims.all_inputs());
        Self {
            isa: Isa::detect(),
            stride,
            states: vec![0.0; horizon * n * stride],
            adjoints: [vec![0.0; n * stride], vec![0.0; n * stride]],
            inputs: vec![0.0; dims.all_inputs() * stride],
            looks: (dims.n_controls - 1) / (UNASKED / (4 * m * horizon * n * (n + m))).max(1),
        }
    }

    /// The instruction set.
    pub(super) fn isa(&self) -> Isa {
        self.isa
    }

    /// e and G of the state that stage `j` leads to, row by row.
    pub(super) fn state(&self, j: usize) -> impl ExactSizeIterator<Item = &[f64]> {
        let n = self.adjoints[0].len() / self.stride;
        block(&self.states, j, n * self.stride).chunks_exact(self.stride)
    }

    /// One row of this: entry i of the state.
    pub(super) fn row(&self, j: usize, i: usize) -> &[f64] {
        let n = self.adjoints[0].len() / self.stride;
        block(&self.states, j * n + i, self.stride)
    }

    /// Returns the ratio of what the first inputs and what the last n inputs do to the last state, for the
    /// entry of the state in which it is largest. The last n inputs reach all of a controllable state.
    pub(super) fn growth(&self, dims: OcpDims) -> f64 {
        let size = |g: &[f64]| g.iter().fold(0.0, |most: f64, g| most.max(g.abs()));
        let late = 1 + dims.n_controls.saturating_sub(dims.nx) * dims.nu;
        let rows = self.state(dims.horizon - 1);
        let sizes = rows.map(|row| (size(&row[1..late]), size(&row[late..])));
        let reached = sizes.filter(|(_, late)| *late > 0.0);
        reached.map(|(early, late)| early / late).fold(0.0, f64::max)
    }

    /// Writes H, on and below the diagonal, and the gradient. Whether it came to the end before
    /// `expired` said that the time is up.
    pub(super) fn condense(
        &mut self,
        qp: &Qp,
        dense: &mut DenseQp,
        expired: &mut dyn FnMut() -> bool,
    ) -> bool {
        if !self.isa.dispatch(Condense { panels: self, qp, expired }) {
            return false;
        }
        let unknowns = qp.dims.all_inputs();
        let by_u = &qp.gradient[qp.dims.all_states()..];
        for (i, row) in self.inputs.chunks_exact(self.stride).enumerate() {
            dense.gradient[i] = by_u[i] + row[0];
            for (k, &entry) in row[1..i + 2].iter().enumerate() {
                dense.hessian[k * unknowns + i] = entry;
            }
        }
        true
    }
}

/// See [`Panels::condense`].
struct Condense<'a> {
    panels: &'a mut Panels,
    qp: &'a Qp,
    expired: &'a mut dyn FnMut() -> bool,
}

impl Task for Condense<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<V: Simd>(self, zero: V) -> bool {
        let Self { panels, qp, expired } = self;
        sized!(qp.dims, |n, m| {
            panels.drive(qp, n, m);
            let horizon = qp.dims.horizon;
            for j in 0..horizon {
                panels.respond(zero, qp, (n, m), j);
                if panels.looks_after(j, horizon) && expired() {
                    return false;
                }
            }
            panels.inputs.fill(0.0);
            for j in (0..horizon).rev() {
                panels.return_to(zero, qp, (n, m), j);
                if panels.looks_after(2 * horizon - 1 - j, horizon) && expired() {
                    return false;
                }
            }
            true
        })
    }
}

impl Panels {
    /// Whether to look at the clock after this one of the 2 N stages of both recursions: the looks
    /// are spread over them.
    #[inline(always)]
    fn looks_after(&self, stage: usize, horizon: usize) -> bool {
        self.looks > 0
            && (stage + 1) * self.looks / (2 * horizon) > stage * self.looks / (2 * horizon)
    }

    /// The width of the panels at stage `j`, whose state depends on the inputs up to the one that
    /// acts there.
    #[inline(always)]
    fn width(qp: &Qp, j: usize, m: usize) -> usize {
        1 + (qp.dims.acting(j) + 1) * m
    }

    /// The part of e and G that does not come from the state before: c and B.
    #[inline(always)]
    fn drive(&mut self, qp: &Qp, n: usize, m: usize) {
        self.states.fill(0.0);
        for j in 0..qp.dims.horizon {
            let first = 1 + qp.dims.acting(j) * m;
            let rows = self.states[j * n * self.stride..].chunks_exact_mut(self.stride);
            let drives = block(&qp.c, j, n).iter().zip(block(&qp.b, j, n * m).chunks_exact(m));
            for (row, (c, b)) in rows.zip(drives) {
                row[0] = *c;
                row[first..first + m].copy_from_slice(b);
            }
        }
    }

    /// `e_{j+1} += A_j e_j` and `G_{j+1} += A_j G_j`.
    #[inline(always)]
    fn respond<V: Simd>(&mut self, zero: V, qp: &Qp, (n, m): (usize, usize), j: usize) {
        if j > 0 {
            let (before, now) = self.states.split_at_mut(j * n * self.stride);
            let before = &before[(j - 1) * n * self.stride..];
            let a = Factor { matrix: block(&qp.a, j, n * n), by_row: n, by_column: 1 };
            let width = Self::width(qp, j - 1, m);
            multiply(zero, To::Add, a, [n, n], before, now, [self.stride, width]);
        }
    }

    /// The adjoint at the state that stage `j` leads to, and the rows of H of the input of the
    /// stage:
    ///
    /// ```text
    /// W_j = Q_j G_j + A_j' W_{j+1},    H_{j,:} += B_j' W_j
    /// p_j = g_j + Q_j e_j + A_j' p_{j+1},    g_{u_j} += B_j' p_j
    /// ```
    #[inline(always)]
    fn return_to<V: Simd>(&mut self, zero: V, qp: &Qp, (n, m): (usize, usize), j: usize) {
        let (stride, width) = (self.stride, Self::width(qp, j, m));
        let sizes = [stride, width];
        let [w, next] = &mut self.adjoints;
        std::mem::swap(w, next);
        for (row, g) in w.chunks_exact_mut(stride).zip(block(&qp.gradient, j, n)) {
            row[..(width + V::LANES).next_multiple_of(V::LANES).min(stride)].fill(0.0);
            row[0] = *g;
        }
        if j + 1 < qp.dims.horizon {
            let a = Factor { matrix: block(&qp.a, j + 1, n * n), by_row: 1, by_column: n };
            multiply(zero, To::Add, a, [n, n], next, w, sizes);
        }
        let state = block(&self.states, j, n * stride);
        // Most states have no weight of their own.
        let q = block(&qp.q, j, n * n);
        for (i, q) in q.chunks(ROWS * n).enumerate() {
            if !all_zero(q) {
                let rows = &mut w[i * ROWS * stride..];
                let q = Factor { matrix: q, by_row: n, by_column: 1 };
                multiply(zero, To::Add, q, [q.matrix.len() / n, n], state, rows, sizes);
            }
        }
        for (input, s) in qp.cross(j + 1) {
            let rows = &mut self.inputs[input * m * stride..];
            let factor = Factor { matrix: s, by_row: n, by_column: 1 };
            multiply(zero, To::Add, factor, [m, n], state, rows, sizes);
            if input <= qp.dims.acting(j) {
                for (k, s) in s.chunks_exact(n).enumerate() {
                    for (row, s) in w.chunks_exact_mut(stride).zip(s) {
                        row[1 + input * m + k] += s;
                    }
                }
            }
        }
        let b = Factor { matrix: block(&qp.b, j, n * m), by_row: 1, by_column: m };
        let rows = &mut self.inputs[qp.dims.acting(j) * m * stride..];
        multiply(zero, To::Add, b, [m, n], w, rows, sizes);
    }
}

/// Whether there are only zeros. All are looked at, in vectors.
#[inline(always)]
fn all_zero(values: &[f64]) -> bool {
    let mut bits = 0;
    for value in values {
        bits |= value.to_bits();
    }
    bits == 0
}
