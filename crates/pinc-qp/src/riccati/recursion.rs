//! The Riccati recursion.

use crate::algebra::{add_product, add_scaled, add_transposed, block, block_mut};
use crate::factor::Cholesky;
use crate::{OcpDims, Qp, RowBlock};
use std::ops::Range;

/// Solves the equality-constrained part of a [`Qp`], with weights D on its rows C d (see
/// [`Rows`](super::rows::Rows)), at a cost linear in the horizon:
///
/// ```text
/// min  d'(H + C'D C)d / 2 + g'd   s.t.   dx_{j+1} = A_j dx_j + B_j du_j + c_j,   dx_0 = 0
/// ```
///
/// The state of the recursion is `s_j = (dx_j, du_{j-1})`, so that weights on increments and held
/// inputs fit: `du_j = du_{j-1} + w_j`, with `w_j` = 0 from j = Nu on. With F = (A B; 0 I), P and p
/// the quadratic and linear part of the cost from stage j + 1 on,
///
/// ```text
/// M = F'P F + weights of du_j and of rows of (dx_j, du_j) + S_j, T_j       m = F'(P c + p) + g of du_j
/// G = R_j + weights of the increment + M_uu                     K = G^-1 M_u:
/// P <- M - M_u:' K + (Q_j + weights of dx_j; 0)                 p <- m - K' m_u + g of dx_j
///        + weights of rows of (dx_j, du_{j-1}) + E_j
/// ```
///
/// Reference: Rao, Wright and Rawlings, "Application of interior-point methods to model predictive
/// control", J. Optim. Theory Appl. 99 (1998). All memory is allocated at construction.
#[derive(Clone, Debug)]
pub(super) struct Riccati {
    dims: OcpDims,
    /// P of `s_1` .. `s_N`, `[N, n + m, n + m]`.
    p: Vec<f64>,
    /// K, `[Nu, n + m, m]`, column by column.
    gain: Vec<f64>,
    /// G
    pivot: Vec<Cholesky>,
    /// p of `s_1` .. `s_N`, `[N, n + m]`.
    linear: Vec<f64>,
    /// `-G^-1 m_u`, `[Nu, m]`.
    forward: Vec<f64>,
    /// P F, then G
    product: Vec<f64>,
    /// M
    merged: Vec<f64>,
    /// m, and the state of the rollout
    vector: Vec<f64>,
    sum: Vec<f64>,
}

/// About how many operations of a factorization there are between two looks at the clock: a few
/// microseconds.
const UNASKED: usize = 8_000;

impl Riccati {
    pub(super) fn new(dims: OcpDims) -> Self {
        let (n, m) = (dims.nx, dims.nu);
        let s = n + m;
        Self {
            dims,
            p: vec![0.0; dims.horizon * s * s],
            gain: vec![0.0; dims.n_controls * s * m],
            pivot: vec![Cholesky::new(m); dims.n_controls],
            linear: vec![0.0; dims.horizon * s],
            forward: vec![0.0; dims.all_inputs()],
            product: vec![0.0; s * s],
            merged: vec![0.0; s * s],
            vector: vec![0.0; s],
            sum: vec![0.0; s],
        }
    }

    /// Factors the matrix with the weights D, in the order of the rows; `false` if it is singular
    /// on the dynamics, or if `expired` says before the end that the time is up.
    pub(super) fn factor(
        &mut self,
        qp: &Qp,
        weights: &[f64],
        expired: &mut dyn FnMut() -> bool,
    ) -> bool {
        sized!(self.dims, |n, m| self.factor_sized(qp, weights, (n, m), expired))
    }

    #[inline(always)]
    fn factor_sized(
        &mut self,
        qp: &Qp,
        weights: &[f64],
        (n, m): (usize, usize),
        expired: &mut dyn FnMut() -> bool,
    ) -> bool {
        let OcpDims { horizon, n_controls, .. } = self.dims;
        let s = n + m;
        let unasked = (UNASKED / (4 * s * s * s)).max(1);
        let by_row = RowWeights::new(self.dims, weights);
        self.merged.fill(0.0);
        by_row.add_block(qp, self.dims.rows_here(horizon), &mut self.merged);
        add_cross(qp.s(horizon), self.dims, &mut self.merged);
        let mut next_look = horizon.checked_sub(unasked);
        for j in (0..horizon).rev() {
            if next_look == Some(j) {
                if expired() {
                    return false;
                }
                next_look = j.checked_sub(unasked);
            }
            // merged: what the stages before have left, in terms of s_{j+1}
            let p = &mut self.p[j * s * s..(j + 1) * s * s];
            p.copy_from_slice(&self.merged);
            let state_weights = &by_row.bounds[self.dims.next_state(j)];
            for (c, q) in block(&qp.q, j, n * n).chunks_exact(n).enumerate() {
                add_scaled(&mut p[c * s..c * s + n], 1.0, q);
                p[c * s + c] += state_weights[c];
            }
            if j + 1 >= self.dims.n1 {
                by_row.add_block(qp, self.dims.rows_at_end(j + 1), p);
            }
            add_cross(qp.s_before(j + 1), self.dims, p);
            symmetrize(p, s);
            let model = (block(&qp.a, j, n * n), block(&qp.b, j, n * m));
            merge(p, model, (n, m), &mut self.product, &mut self.merged);
            if j >= self.dims.n1 {
                by_row.add_block(qp, self.dims.rows_here(j), &mut self.merged);
            }
            if j + 1 >= self.dims.n1 {
                by_row.add_block(qp, self.dims.rows_at_start(j + 1), &mut self.merged);
            }
            if j > 0 {
                add_cross(qp.s(j), self.dims, &mut self.merged);
            }
            if j < n_controls {
                for (k, t) in qp.t(j).into_iter().flat_map(|t| t.chunks_exact(m)).enumerate() {
                    add_scaled(&mut self.merged[(n + k) * s + n..(n + k + 1) * s], 1.0, t);
                }
                for (k, weight) in by_row.bounds[self.dims.input(j)].iter().enumerate() {
                    self.merged[(n + k) * (s + 1)] += weight;
                }
                let r = block(&qp.r, j, m * m);
                if !self.eliminate(j, r, &by_row.increments[j * m..], (n, m)) {
                    return false;
                }
            }
        }
        true
    }

    /// Minimizes over the increment of stage `j`.
    #[inline(always)]
    fn eliminate(&mut self, j: usize, r: &[f64], weights: &[f64], (n, m): (usize, usize)) -> bool {
        let s = n + m;
        let pivot = &mut self.product[..m * m];
        for (k, column) in pivot.chunks_exact_mut(m).enumerate() {
            column.copy_from_slice(&self.merged[(n + k) * s + n..(n + k + 1) * s]);
            add_scaled(column, 1.0, &r[k * m..]);
            column[k] += weights[k];
        }
        if !self.pivot[j].factor_sized(pivot, m) {
            return false;
        }
        let gain = &mut self.gain[j * s * m..(j + 1) * s * m];
        for (gain, column) in gain.chunks_exact_mut(m).zip(self.merged.chunks_exact(s)) {
            gain.copy_from_slice(&column[n..]);
            self.pivot[j].forward_sized(gain, m);
        }
        // M_u:' G^-1 M_u: from the half-solved factors, so that it is symmetric.
        for (c, column) in self.merged.chunks_exact_mut(s).enumerate() {
            for (r, entry) in column.iter_mut().enumerate() {
                for k in 0..m {
                    *entry -= gain[r * m + k] * gain[c * m + k];
                }
            }
        }
        gain.chunks_exact_mut(m).for_each(|gain| self.pivot[j].backward_sized(gain, m));
        true
    }

    /// Solves for the linear term `g`, as long as z, and the offsets `c`, `[N, n]`, with the last
    /// factors: writes d and the multipliers of the dynamics.
    pub(super) fn solve(
        &mut self,
        qp: &Qp,
        g: &[f64],
        c: &[f64],
        d: &mut [f64],
        lambda: &mut [f64],
    ) {
        sized!(self.dims, |n, m| {
            self.backward(qp, g, c, (n, m));
            self.roll_out(qp, c, d, lambda, (n, m));
        });
    }

    #[inline(always)]
    fn backward(&mut self, qp: &Qp, g: &[f64], c: &[f64], (n, m): (usize, usize)) {
        let OcpDims { horizon, n_controls, .. } = self.dims;
        let s = n + m;
        let (by_x, by_u) = g.split_at(self.dims.all_states());
        self.vector.fill(0.0);
        for j in (0..horizon).rev() {
            let (vector, sum) = (&mut self.vector[..s], &mut self.sum[..s]);
            let linear = block_mut(&mut self.linear, j, s);
            linear.copy_from_slice(vector);
            add_scaled(linear, 1.0, block(by_x, j, n));
            sum.copy_from_slice(linear);
            let p = block(&self.p, j, s * s).chunks_exact(s);
            for (c, column) in block(c, j, n).iter().zip(p) {
                add_scaled(sum, *c, column);
            }
            let (x, u) = vector.split_at_mut(n);
            x.fill(0.0);
            u.copy_from_slice(&sum[n..]);
            add_transposed(block(&qp.a, j, n * n), &sum[..n], x);
            add_transposed(block(&qp.b, j, n * m), &sum[..n], u);
            if j < n_controls {
                add_scaled(u, 1.0, block(by_u, j, m));
                let gain = block(&self.gain, j, s * m).chunks_exact(m);
                let forward = block_mut(&mut self.forward, j, m);
                forward.copy_from_slice(u);
                for (entry, gain) in vector.iter_mut().zip(gain) {
                    for (gain, forward) in gain.iter().zip(forward.iter()) {
                        *entry -= gain * forward;
                    }
                }
                self.pivot[j].forward_sized(forward, m);
                self.pivot[j].backward_sized(forward, m);
            }
        }
    }

    #[inline(always)]
    fn roll_out(
        &mut self,
        qp: &Qp,
        c: &[f64],
        d: &mut [f64],
        lambda: &mut [f64],
        (n, m): (usize, usize),
    ) {
        let OcpDims { horizon, n_controls, .. } = self.dims;
        let s = n + m;
        let (states, inputs) = d.split_at_mut(self.dims.all_states());
        // s_j = (dx_j, du_{j-1})
        self.vector.fill(0.0);
        for j in 0..horizon {
            let (vector, sum) = (&mut self.vector[..s], &mut self.sum[..s]);
            if j < n_controls {
                sum.copy_from_slice(vector);
                let u = &mut vector[n..];
                add_scaled(u, -1.0, block(&self.forward, j, m));
                let gain = block(&self.gain, j, s * m).chunks_exact(m);
                for (entry, gain) in sum.iter().zip(gain) {
                    add_scaled(u, -*entry, gain);
                }
                block_mut(inputs, j, m).copy_from_slice(u);
            }
            let (x, u) = vector.split_at_mut(n);
            let next = &mut sum[..n];
            next.copy_from_slice(block(c, j, n));
            add_product(block(&qp.a, j, n * n), x, next);
            add_product(block(&qp.b, j, n * m), u, next);
            x.copy_from_slice(next);
            block_mut(states, j, n).copy_from_slice(x);

            let lambda = block_mut(lambda, j, n);
            lambda.copy_from_slice(&block(&self.linear, j, s)[..n]);
            let p = block(&self.p, j, s * s).chunks_exact(s);
            for (entry, column) in vector.iter().zip(p) {
                add_scaled(lambda, *entry, column);
            }
        }
    }
}

/// Makes a matrix that is symmetric up to rounding symmetric. Over the stages the gains contain
/// what rounding does to its symmetric part; an antisymmetric part would grow as the plant does
/// without control, `A' P A`.
#[inline(always)]
fn symmetrize(matrix: &mut [f64], size: usize) {
    for c in 1..size {
        for r in 0..c {
            let mean = 0.5 * (matrix[c * size + r] + matrix[r * size + c]);
            matrix[c * size + r] = mean;
            matrix[r * size + c] = mean;
        }
    }
}

/// Adds `S_j` or `E_j` to the matrix of `dx_j` and its input.
fn add_cross(s: Option<&[f64]>, dims: OcpDims, matrix: &mut [f64]) {
    let OcpDims { nx: n, nu: m, .. } = dims;
    let width = n + m;
    for (k, row) in s.into_iter().flat_map(|s| s.chunks_exact(n)).enumerate() {
        for (i, entry) in row.iter().enumerate() {
            matrix[i * width + n + k] += entry;
            matrix[(n + k) * width + i] += entry;
        }
    }
}

/// D by its parts.
struct RowWeights<'a> {
    bounds: &'a [f64],
    increments: &'a [f64],
    general: &'a [f64],
}

impl<'a> RowWeights<'a> {
    fn new(dims: OcpDims, weights: &'a [f64]) -> Self {
        let (bounds, rest) = weights.split_at(dims.unknowns());
        let (increments, general) = rest.split_at(dims.all_inputs());
        Self { bounds, increments, general }
    }

    /// Adds the weights of some rows to the matrix of their state and input.
    #[inline(always)]
    fn add_block(&self, qp: &Qp, block: RowBlock, matrix: &mut [f64]) {
        if !block.rows.is_empty() {
            self.add_rows(qp, block.rows, matrix);
        }
    }

    fn add_rows(&self, qp: &Qp, rows: Range<usize>, matrix: &mut [f64]) {
        let (n, m) = (qp.dims.nx, qp.dims.nu);
        let s = n + m;
        let [by_x, by_u] = qp.row_jacobians(rows.clone());
        let jacobians = by_x.chunks_exact(n).zip(by_u.chunks_exact(m));
        for (weight, (by_x, by_u)) in self.general[rows].iter().zip(jacobians) {
            let normal = |i: usize| if i < n { by_x[i] } else { by_u[i - n] };
            for c in 0..s {
                let factor = weight * normal(c);
                for r in 0..s {
                    matrix[c * s + r] += factor * normal(r);
                }
            }
        }
    }
}

/// Writes F'P F, with the product P F in between; all column by column.
#[inline(always)]
fn merge(
    p: &[f64],
    (a, b): (&[f64], &[f64]),
    (n, m): (usize, usize),
    product: &mut [f64],
    merged: &mut [f64],
) {
    let s = n + m;
    for (c, column) in product.chunks_exact_mut(s).take(s).enumerate() {
        if c < n {
            column.fill(0.0);
        } else {
            column.copy_from_slice(block(p, c, s));
        }
        for (k, p) in p.chunks_exact(s).take(n).enumerate() {
            let entry = if c < n { a[k * n + c] } else { b[k * m + c - n] };
            add_scaled(column, entry, p);
        }
    }
    let columns = merged.chunks_exact_mut(s).zip(product.chunks_exact(s)).take(s);
    for (column, product) in columns {
        let (x, u) = column.split_at_mut(n);
        x.fill(0.0);
        u.copy_from_slice(&product[n..]);
        add_transposed(a, &product[..n], x);
        add_transposed(b, &product[..n], u);
    }
}
