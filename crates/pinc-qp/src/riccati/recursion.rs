//! The Riccati recursion.

use super::chains::{Chains, groups};
use crate::algebra::{add_product, add_scaled, add_transposed, block, block_mut, dot, symmetrize};
use crate::factor::Cholesky;
use crate::product::{Factor, To, multiply, padded};
use crate::{OcpDims, Qp, RowBlock};
use pinc_ad::simd::{Isa, Simd, Task};
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
/// On a tree M and m of a node are sums over the stages that leave it, each with its own F, P, c
/// and p. A node adds its part to the node before, which is factored when its last child has done
/// so: at a cost linear in the number of nodes. After the last branching most of the paths are in
/// [`Chains`], side by side.
///
/// Reference: Rao, Wright and Rawlings, "Application of interior-point methods to model predictive
/// control", J. Optim. Theory Appl. 99 (1998). All memory is allocated at construction.
#[derive(Debug)]
pub(super) struct Riccati {
    dims: OcpDims,
    isa: Isa,
    chains: Vec<Box<dyn Chains>>,
    /// How many paths are in chains.
    chained: usize,
    /// P of `s_0` .. `s_N` in padded rows, `[N + 1, n + m, stride]`; of a node that has not been
    /// reached, the M of its children so far.
    p: Vec<f64>,
    /// K in padded rows, `[Nu, m, stride]`.
    gain: Vec<f64>,
    /// G
    pivot: Vec<Cholesky>,
    /// p of `s_0` .. `s_N`, `[N + 1, n + m]`, likewise.
    linear: Vec<f64>,
    /// `-G^-1 m_u`, `[Nu, m]`.
    forward: Vec<f64>,
    /// F of a stage and of the one before, and P F, in padded rows: `[2, n + m, stride]` and
    /// `[n + m, stride]`.
    models: Vec<f64>,
    /// The stage whose F there is.
    read: Option<usize>,
    product: Vec<f64>,
    /// `-L^-1 M_u:` with G = L L', `[m, stride]`.
    half: Vec<f64>,
    /// G
    weight: Vec<f64>,
    /// What a stage adds to m, and the state of the rollout.
    vector: Vec<f64>,
    sum: Vec<f64>,
}

/// About how many operations of a factorization there are between two looks at the clock: a few
/// microseconds.
const UNASKED: usize = 8_000;

/// How many stages of a state of the recursion of `s` numbers that is.
pub(super) fn unasked(s: usize) -> usize {
    (UNASKED / (4 * s * s * s)).max(1)
}

impl Riccati {
    pub(super) fn new(dims: OcpDims) -> Self {
        let (n, m) = (dims.nx, dims.nu);
        let s = n + m;
        let stride = padded(s);
        let isa = Isa::detect();
        let (chains, chained) = groups(dims, isa);
        Self {
            dims,
            isa,
            chains,
            chained,
            read: None,
            p: vec![0.0; (dims.horizon + 1) * s * stride],
            gain: vec![0.0; dims.n_controls * m * stride],
            pivot: vec![Cholesky::new(m); dims.n_controls],
            linear: vec![0.0; (dims.horizon + 1) * s],
            forward: vec![0.0; dims.all_inputs()],
            models: models((n, m), stride),
            product: vec![0.0; s * stride],
            half: vec![0.0; m * stride],
            weight: vec![0.0; m * m],
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
        self.isa.dispatch(Factorize { riccati: self, qp, weights, expired })
    }

    #[inline(always)]
    fn factor_sized<V: Simd>(
        &mut self,
        zero: V,
        qp: &Qp,
        weights: &[f64],
        (n, m): (usize, usize),
        expired: &mut dyn FnMut() -> bool,
    ) -> bool {
        let OcpDims { horizon, n1, .. } = self.dims;
        let (s, stride) = (n + m, padded(n + m));
        let unasked = unasked(s);
        let by_row = RowWeights::new(self.dims, weights);
        for chains in &mut self.chains {
            if !chains.factor(qp, &by_row, &mut self.p, expired) {
                return false;
            }
        }
        self.read = None;
        let mut next_look = horizon.checked_sub(unasked);
        for j in (0..=horizon).rev() {
            if next_look == Some(j) {
                if expired() {
                    return false;
                }
                next_look = j.checked_sub(unasked);
            }
            match self.place(j) {
                Place::Alone if !self.minimize(zero, qp, &by_row, j, (n, m)) => return false,
                Place::Alone => {}
                Place::FirstInChain => {
                    self.hand_on(zero, qp, j - 1, (n, m));
                    continue;
                }
                Place::InChain => continue,
            }
            let Some(stage) = j.checked_sub(1) else { break };
            let p = block_mut(&mut self.p, j, s * stride);
            let state_weights = &by_row.bounds[self.dims.next_state(stage)];
            for (c, q) in block(&qp.q, stage, n * n).chunks_exact(n).enumerate() {
                add_scaled(&mut p[c * stride..c * stride + n], 1.0, q);
                p[c * stride + c] += state_weights[c];
            }
            if j >= n1 {
                by_row.add_block(qp, self.dims.rows_at_end(j), p);
            }
            add_cross(qp.s_before(j), self.dims, p);
            // Over the stages the gains contain what rounding does to the symmetric part; an
            // antisymmetric part would grow as the plant does without control, A' P A.
            symmetrize(p, s, stride);
            self.hand_on(zero, qp, stage, (n, m));
        }
        true
    }

    /// Where node `j` is solved.
    #[inline(always)]
    fn place(&self, j: usize) -> Place {
        if self.chained == 0 {
            return Place::Alone;
        }
        let tree = self.dims.tree;
        match j.checked_sub(tree.first_chain_node()) {
            Some(path) if path < self.chained => Place::FirstInChain,
            Some(path) if path % tree.scenarios() < self.chained => Place::InChain,
            _ => Place::Alone,
        }
    }

    /// Writes A and B of a stage into F.
    #[inline(always)]
    fn read_model(&mut self, qp: &Qp, stage: usize, (n, m): (usize, usize)) {
        let (s, stride) = (n + m, padded(n + m));
        let rows = block(&qp.a, stage, n * n).chunks_exact(n);
        let rows = rows.zip(block(&qp.b, stage, n * m).chunks_exact(m));
        let f = block_mut(&mut self.models, stage % 2, s * stride);
        for (row, (a, b)) in f.chunks_exact_mut(stride).zip(rows) {
            row[..n].copy_from_slice(a);
            row[n..s].copy_from_slice(b);
        }
    }

    /// Adds the cost of a stage with all that follows, F'P F, to the M of the node that it leads
    /// from.
    #[inline(always)]
    fn hand_on<V: Simd>(&mut self, zero: V, qp: &Qp, stage: usize, (n, m): (usize, usize)) {
        if self.read != Some(stage) {
            self.read_model(qp, stage, (n, m));
        }
        // A vector that is read soon after its numbers were written one by one has to wait.
        self.read = stage.checked_sub(1);
        if let Some(next) = self.read {
            self.read_model(qp, next, (n, m));
        }
        let (s, stride) = (n + m, padded(n + m));
        let origin = self.dims.origin(stage);
        let (before, p) = self.p.split_at_mut((stage + 1) * s * stride);
        let (p, target) = (&p[..s * stride], block_mut(before, origin, s * stride));
        let f = block(&self.models, stage % 2, s * stride);
        let p = Factor { matrix: p, by_row: stride, by_column: 1 };
        multiply(zero, To::Set, p, [s, s], f, &mut self.product, [stride, s]);
        let transposed = Factor { matrix: f, by_row: 1, by_column: stride };
        // The first in the order of the recursion sets M.
        let first = stage + 1 == self.dims.stages_from(origin).end;
        let action = if first { To::Set } else { To::Add };
        multiply(zero, action, transposed, [s, s], &self.product, target, [stride, s]);
    }

    /// Completes M of node `j` in its place, and minimizes over the increment if the node has an
    /// input of its own; `false` if there is no minimum.
    #[inline(always)]
    fn minimize<V: Simd>(
        &mut self,
        zero: V,
        qp: &Qp,
        by_row: &RowWeights<'_>,
        j: usize,
        (n, m): (usize, usize),
    ) -> bool {
        let dims = self.dims;
        let (s, stride) = (n + m, padded(n + m));
        let stages = dims.stages_from(j);
        let merged = block_mut(&mut self.p, j, s * stride);
        if stages.is_empty() {
            merged.fill(0.0);
        }
        if j >= dims.n1 {
            by_row.add_block(qp, dims.rows_here(j), merged);
        }
        for stage in stages {
            if stage + 1 >= dims.n1 {
                by_row.add_block(qp, dims.rows_at_start(stage + 1), merged);
            }
        }
        if j > 0 {
            add_cross(qp.s(j), dims, merged);
        }
        if j >= dims.n_controls {
            return true;
        }
        for (k, t) in qp.t(j).into_iter().flat_map(|t| t.chunks_exact(m)).enumerate() {
            add_scaled(&mut merged[(n + k) * stride + n..(n + k) * stride + s], 1.0, t);
        }
        for (k, weight) in by_row.bounds[dims.input(j)].iter().enumerate() {
            // Most are 0, and a vector that is read soon after one of its numbers was written waits.
            if *weight != 0.0 {
                merged[(n + k) * (stride + 1)] += weight;
            }
        }
        self.eliminate(zero, j, block(&qp.r, j, m * m), &by_row.increments[j * m..], (n, m))
    }

    /// Minimizes over the increment of node `j`.
    #[inline(always)]
    fn eliminate<V: Simd>(
        &mut self,
        zero: V,
        j: usize,
        r: &[f64],
        weights: &[f64],
        (n, m): (usize, usize),
    ) -> bool {
        let (s, stride) = (n + m, padded(n + m));
        let merged = block_mut(&mut self.p, j, s * stride);
        let pivot = &mut self.weight[..m * m];
        for (k, column) in pivot.chunks_exact_mut(m).enumerate() {
            column.copy_from_slice(&merged[(n + k) * stride + n..(n + k) * stride + s]);
            add_scaled(column, 1.0, &r[k * m..]);
            column[k] += weights[k];
        }
        if !self.pivot[j].factor_sized(pivot, m) {
            return false;
        }
        let gain = block_mut(&mut self.gain, j, m * stride);
        gain.copy_from_slice(&merged[n * stride..]);
        self.pivot[j].forward_rows(zero, gain, [m, stride]);
        // M_u:' G^-1 M_u: from the half-solved rows, so that it is symmetric.
        let half = &mut self.half[..m * stride];
        negate(zero, gain, half);
        let half = Factor { matrix: half, by_row: 1, by_column: stride };
        multiply(zero, To::Add, half, [s, m], gain, merged, [stride, s]);
        self.pivot[j].backward_rows(zero, gain, [m, stride]);
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
        self.isa.dispatch(Solve { riccati: self, qp, g, c, d, lambda });
    }

    #[inline(always)]
    fn backward(&mut self, qp: &Qp, g: &[f64], c: &[f64], (n, m): (usize, usize)) {
        let dims = self.dims;
        let (s, stride) = (n + m, padded(n + m));
        let (by_x, by_u) = g.split_at(dims.all_states());
        for chains in &mut self.chains {
            chains.backward(g, c, &mut self.linear);
        }
        for j in (0..=dims.horizon).rev() {
            let place = self.place(j);
            let (before, linear) = self.linear.split_at_mut(j * s);
            let linear = &mut linear[..s];
            if place == Place::InChain {
                continue;
            }
            if place == Place::Alone && dims.stages_from(j).is_empty() {
                linear.fill(0.0);
            }
            if place == Place::Alone && j < dims.n_controls {
                add_scaled(&mut linear[n..], 1.0, block(by_u, j, m));
                let gain = block(&self.gain, j, m * stride).chunks_exact(stride);
                let forward = block_mut(&mut self.forward, j, m);
                forward.copy_from_slice(&linear[n..]);
                for (gain, forward) in gain.zip(forward.iter()) {
                    add_scaled(linear, -forward, gain);
                }
                self.pivot[j].forward_sized(forward, m);
                self.pivot[j].backward_sized(forward, m);
            }
            let Some(stage) = j.checked_sub(1) else { break };
            if place == Place::Alone {
                add_scaled(linear, 1.0, block(by_x, stage, n));
            }
            let sum = &mut self.sum[..s];
            sum.copy_from_slice(linear);
            let p = block(&self.p, j, s * stride).chunks_exact(stride);
            for (c, column) in block(c, stage, n).iter().zip(p) {
                add_scaled(sum, *c, column);
            }
            let origin = dims.origin(stage);
            let target = block_mut(before, origin, s);
            let first = stage + 1 == dims.stages_from(origin).end;
            let part = if first { &mut *target } else { &mut self.vector[..s] };
            let (x, u) = part.split_at_mut(n);
            x.fill(0.0);
            u.copy_from_slice(&sum[n..]);
            add_transposed(block(&qp.a, stage, n * n), &sum[..n], x);
            add_transposed(block(&qp.b, stage, n * m), &sum[..n], u);
            if !first {
                add_scaled(target, 1.0, &self.vector);
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
        let dims = self.dims;
        let (s, stride) = (n + m, padded(n + m));
        let (states, inputs) = d.split_at_mut(dims.all_states());
        for j in 0..=dims.horizon {
            let place = self.place(j);
            if place == Place::InChain {
                continue;
            }
            // s_j = (dx_j, du_{j-1})
            let vector = &mut self.vector[..s];
            if let Some(stage) = j.checked_sub(1) {
                let (origin, acting) = (dims.origin(stage), dims.input_of(stage));
                let (x, u) = vector.split_at_mut(n);
                u.copy_from_slice(block(inputs, acting, m));
                x.copy_from_slice(block(c, stage, n));
                if let Some(before) = origin.checked_sub(1) {
                    add_product(block(&qp.a, stage, n * n), block(states, before, n), x);
                }
                add_product(block(&qp.b, stage, n * m), u, x);
                block_mut(states, stage, n).copy_from_slice(x);
                if place == Place::FirstInChain {
                    continue;
                }

                let lambda = block_mut(lambda, stage, n);
                lambda.copy_from_slice(&block(&self.linear, j, s)[..n]);
                let p = block(&self.p, j, s * stride).chunks_exact(stride);
                for (entry, column) in vector.iter().zip(p) {
                    add_scaled(lambda, *entry, column);
                }
            } else {
                vector.fill(0.0);
            }
            if j < dims.n_controls {
                let u = block_mut(inputs, j, m);
                u.copy_from_slice(&vector[n..]);
                add_scaled(u, -1.0, block(&self.forward, j, m));
                let gain = block(&self.gain, j, m * stride).chunks_exact(stride);
                for (u, gain) in u.iter_mut().zip(gain) {
                    *u -= dot(&gain[..s], vector);
                }
            }
        }
        for chains in &mut self.chains {
            chains.roll_out(c, d, lambda);
        }
    }
}

/// Where a node is solved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    /// In the recursion over the nodes.
    Alone,
    /// In [`Chains`], whose cost the recursion takes over.
    FirstInChain,
    InChain,
}

/// F of two stages without A and B: (0 0; 0 I), in rows of `stride` numbers.
fn models((n, m): (usize, usize), stride: usize) -> Vec<f64> {
    let mut models = vec![0.0; 2 * (n + m) * stride];
    for f in models.chunks_exact_mut((n + m) * stride) {
        (n..n + m).for_each(|i| f[i * stride + i] = 1.0);
    }
    models
}

/// See [`Riccati::factor`].
struct Factorize<'a> {
    riccati: &'a mut Riccati,
    qp: &'a Qp,
    weights: &'a [f64],
    expired: &'a mut dyn FnMut() -> bool,
}

impl Task for Factorize<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<V: Simd>(self, zero: V) -> bool {
        let Self { riccati, qp, weights, expired } = self;
        sized!(riccati.dims, |n, m| riccati.factor_sized(zero, qp, weights, (n, m), expired))
    }
}

/// See [`Riccati::solve`]. The loops are vectorized by the compiler.
struct Solve<'a> {
    riccati: &'a mut Riccati,
    qp: &'a Qp,
    g: &'a [f64],
    c: &'a [f64],
    d: &'a mut [f64],
    lambda: &'a mut [f64],
}

impl Task for Solve<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Simd>(self, _: V) {
        let Self { riccati, qp, g, c, d, lambda } = self;
        sized!(riccati.dims, |n, m| {
            riccati.backward(qp, g, c, (n, m));
            riccati.roll_out(qp, c, d, lambda, (n, m));
        });
    }
}

/// to = -from, of padded rows.
#[inline(always)]
fn negate<V: Simd>(zero: V, from: &[f64], to: &mut [f64]) {
    let to = to.chunks_exact_mut(V::LANES);
    for (from, to) in from.chunks_exact(V::LANES).zip(to) {
        (zero - zero.load(from)).write(to);
    }
}

/// Adds `S_j` or `E_j` to the matrix of `dx_j` and its input.
fn add_cross(s: Option<&[f64]>, dims: OcpDims, matrix: &mut [f64]) {
    let OcpDims { nx: n, nu: m, .. } = dims;
    let width = padded(n + m);
    for (k, row) in s.into_iter().flat_map(|s| s.chunks_exact(n)).enumerate() {
        for (i, entry) in row.iter().enumerate() {
            matrix[i * width + n + k] += entry;
            matrix[(n + k) * width + i] += entry;
        }
    }
}

/// D by its parts.
pub(super) struct RowWeights<'a> {
    pub(super) bounds: &'a [f64],
    pub(super) increments: &'a [f64],
    pub(super) general: &'a [f64],
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
        let [by_x, by_u] = qp.row_jacobians(rows.clone());
        let jacobians = by_x.chunks_exact(n).zip(by_u.chunks_exact(m));
        for (weight, (by_x, by_u)) in self.general[rows].iter().zip(jacobians) {
            let normal = by_x.iter().chain(by_u);
            for (column, entry) in matrix.chunks_exact_mut(padded(n + m)).zip(normal) {
                let (x, u) = column.split_at_mut(n);
                add_scaled(x, weight * entry, by_x);
                add_scaled(u, weight * entry, by_u);
            }
        }
    }
}
