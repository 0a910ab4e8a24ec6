//! The recursion on the chains that a tree ends in, side by side in vectors.

use super::recursion::RowWeights;
use crate::factor::SMALLEST_PIVOT;
use crate::product::padded;
use crate::{OcpDims, Qp, RowBlock};
use pinc_ad::simd::{Isa, Simd, Task, Work};
use std::fmt::Debug;

/// The most states and inputs of a stage whose matrices are kept in vectors; of larger ones the
/// products are faster one after the other.
const MOST: usize = 12;

/// Some chains of a tree, from the nodes after its last branching on: see [`Riccati`], whose formulas
/// these are. Each number is a vector, with one chain in each lane.
///
/// [`Riccati`]: super::recursion::Riccati
pub(super) trait Chains: Debug + Send {
    /// Factors, down to the cost of the first nodes, which is written into their `p`, in padded
    /// rows; `false` if the matrix is singular, or if `expired` says that the time is up.
    fn factor(
        &mut self,
        qp: &Qp,
        weights: &RowWeights<'_>,
        p: &mut [f64],
        expired: &mut dyn FnMut() -> bool,
    ) -> bool;

    /// Writes the linear part of the cost of the first nodes.
    fn backward(&mut self, g: &[f64], c: &[f64], linear: &mut [f64]);

    /// Goes on from the states of the first nodes and the inputs before them.
    fn roll_out(&mut self, c: &[f64], d: &mut [f64], lambda: &mut [f64]);
}

/// The chains of a tree, in groups that fill vectors, as far as they do; and how many these are.
pub(super) fn groups(dims: OcpDims, isa: Isa) -> (Vec<Box<dyn Chains>>, usize) {
    let (mut groups, mut first, tree) = (Vec::new(), 0, dims.tree);
    let vectors = isa != Isa::Portable && dims.nx + dims.nu <= MOST;
    for narrower in [Isa::Avx512, Isa::Avx2].into_iter().filter(|_| vectors && !tree.is_chain()) {
        let lanes = narrower.lanes();
        while lanes <= isa.lanes() && first + lanes <= tree.scenarios() {
            groups.push(narrower.dispatch_vectors(Build { dims, first }));
            first += lanes;
        }
    }
    (groups, first)
}

struct Build {
    dims: OcpDims,
    first: usize,
}

impl Task for Build {
    type Output = Box<dyn Chains>;

    fn run<V: Simd>(self, zero: V) -> Box<dyn Chains> {
        let Self { dims, first } = self;
        let OcpDims { nx: n, nu: m, tree, .. } = dims;
        let (s, first) = (n + m, tree.first_chain_node() + first);
        let levels = (dims.horizon + 1 - tree.first_chain_node()) / tree.scenarios();
        let zeros = |width: usize| vec![zero; levels * width];
        Box::new(Lanes {
            dims,
            zero,
            first,
            levels,
            p: zeros(s * s),
            gain: zeros(m * s),
            pivot: zeros(m * m),
            model: zeros(n * s),
            linear: zeros(s),
            forward: zeros(m),
            product: vec![zero; s * s],
            vector: vec![zero; s],
        })
    }
}

/// Chains in the lanes of vectors `V`. Level 0 has the first nodes.
#[derive(Debug)]
struct Lanes<V> {
    dims: OcpDims,
    zero: V,
    /// The first node of the first chain; the others follow.
    first: usize,
    levels: usize,
    /// The lower triangles of P, or M, `[levels, s, s]` with s = n + m.
    p: Vec<V>,
    /// K, `[levels, m, s]`.
    gain: Vec<V>,
    /// L of G = L L', with the inverse of its diagonal, `[levels, m, m]`.
    pivot: Vec<V>,
    /// (A B) of the stage that leads to a level, `[levels, n, s]`.
    model: Vec<V>,
    /// p, `[levels, s]`.
    linear: Vec<V>,
    /// `G^-1 m_u`, `[levels, m]`.
    forward: Vec<V>,
    /// P F, or `L^-1 M_u:`, and a row.
    product: Vec<V>,
    vector: Vec<V>,
}

/// Number `e` of the blocks of `width` numbers of as many nodes as there are lanes, from `first` on.
#[inline(always)]
fn gather<V: Simd>(zero: V, from: &[f64], first: usize, width: usize, e: usize) -> V {
    let from = &from[first * width..(first + V::LANES) * width];
    zero.generate(|lane| from[lane * width + e])
}

/// Writes it there.
#[inline(always)]
fn scatter<V: Simd>(vector: V, to: &mut [f64], first: usize, width: usize, e: usize) {
    let mut lanes = [0.0; 8];
    vector.write(&mut lanes);
    let to = &mut to[first * width..(first + V::LANES) * width];
    for (lane, value) in lanes.iter().enumerate().take(V::LANES) {
        to[lane * width + e] = *value;
    }
}

impl<V: Simd> Lanes<V> {
    /// The node of the first chain at a level.
    #[inline(always)]
    fn node(&self, level: usize) -> usize {
        self.first + level * self.dims.tree.scenarios()
    }

    #[inline(always)]
    fn factor_sized(
        &mut self,
        qp: &Qp,
        weights: &RowWeights<'_>,
        p: &mut [f64],
        (n, m): (usize, usize),
        expired: &mut dyn FnMut() -> bool,
    ) -> bool {
        let (zero, s, stride) = (self.zero, n + m, padded(n + m));
        let unasked = super::recursion::unasked(s);
        let mut excess = zero.constant(f64::NEG_INFINITY);
        self.p[(self.levels - 1) * s * s..].fill(zero);
        for level in (0..self.levels).rev() {
            if level % unasked == 0 && level > 0 && expired() {
                return false;
            }
            excess = self.minimize(qp, weights, level, excess, (n, m));
            self.add_state_cost(qp, weights, level, (n, m));
            if level > 0 {
                self.hand_on(qp, level, (n, m));
            }
        }
        for r in 0..s {
            for c in 0..s {
                scatter(self.p[low(r, c, s)], p, self.first, s * stride, r * stride + c);
            }
        }
        // What is not a number is seen at the root.
        excess.all_nonpositive()
    }

    /// Completes M of the nodes of a level and minimizes over their increments. What counts as 0 of a
    /// pivot is at most by `excess` above one; gives the new largest.
    #[inline(always)]
    fn minimize(
        &mut self,
        qp: &Qp,
        weights: &RowWeights<'_>,
        level: usize,
        mut excess: V,
        (n, m): (usize, usize),
    ) -> V {
        let (zero, dims, node, s) = (self.zero, self.dims, self.node(level), n + m);
        if node >= dims.n1 {
            self.add_rows(qp, weights, level, dims.rows_here(node));
        }
        let next = node + dims.tree.scenarios();
        if level + 1 < self.levels && next >= dims.n1 {
            self.add_rows(qp, weights, level, dims.rows_at_start(next));
        }
        self.add_cross(&qp.s, level, (n, m));
        if node >= dims.n_controls {
            return excess;
        }
        let merged = &mut self.p[level * s * s..(level + 1) * s * s];
        let (bounds, at) = (&weights.bounds[dims.all_states()..], node);
        for k in 0..m {
            let diagonal = &mut merged[(n + k) * (s + 1)];
            *diagonal = *diagonal + gather(zero, bounds, at, m, k);
            for c in (0..=k).filter(|_| !qp.t.is_empty()) {
                let entry = &mut merged[(n + k) * s + n + c];
                *entry = *entry + gather(zero, &qp.t, at, m * m, k * m + c);
            }
        }
        // G = L L'
        let pivot = &mut self.pivot[level * m * m..(level + 1) * m * m];
        for r in 0..m {
            for c in 0..=r {
                let mut entry =
                    merged[(n + r) * s + n + c] + gather(zero, &qp.r, at, m * m, r * m + c);
                if r == c {
                    entry = entry + gather(zero, weights.increments, at, m, r);
                }
                let whole = entry;
                for k in 0..c {
                    entry = pivot[r * m + k].neg_mul_add(pivot[c * m + k], entry);
                }
                if r == c {
                    excess = excess.max(whole * SMALLEST_PIVOT - entry);
                    pivot[r * m + r] = zero.constant(1.0) / entry.sqrt();
                } else {
                    pivot[r * m + c] = entry * pivot[c * m + c];
                }
            }
        }
        // L^-1 M_u:, then K
        let half = &mut self.product[..m * s];
        for r in 0..m {
            for e in 0..s {
                let mut entry = merged[low(n + r, e, s)];
                for c in 0..r {
                    entry = pivot[r * m + c].neg_mul_add(half[c * s + e], entry);
                }
                half[r * s + e] = entry * pivot[r * m + r];
            }
        }
        for r in 0..s {
            for c in 0..=r {
                for k in 0..m {
                    let entry = &mut merged[r * s + c];
                    *entry = half[k * s + r].neg_mul_add(half[k * s + c], *entry);
                }
            }
        }
        let gain = &mut self.gain[level * m * s..(level + 1) * m * s];
        for r in (0..m).rev() {
            for e in 0..s {
                let mut entry = half[r * s + e];
                for c in r + 1..m {
                    entry = pivot[c * m + r].neg_mul_add(gain[c * s + e], entry);
                }
                gain[r * s + e] = entry * pivot[r * m + r];
            }
        }
        excess
    }

    /// Adds the cost of the states of a level.
    #[inline(always)]
    fn add_state_cost(
        &mut self,
        qp: &Qp,
        weights: &RowWeights<'_>,
        level: usize,
        (n, m): (usize, usize),
    ) {
        let (zero, dims, node, s) = (self.zero, self.dims, self.node(level), n + m);
        let p = &mut self.p[level * s * s..(level + 1) * s * s];
        for r in 0..n {
            for c in 0..=r {
                p[r * s + c] = p[r * s + c] + gather(zero, &qp.q, node - 1, n * n, r * n + c);
            }
            let weight = gather(zero, weights.bounds, node - 1, n, r);
            p[r * s + r] = p[r * s + r] + weight;
        }
        if node >= dims.n1 {
            self.add_rows(qp, weights, level, dims.rows_at_end(node));
        }
        self.add_cross(&qp.s_before, level, (n, m));
    }

    /// Adds `S_j` or `E_j`, if there are any.
    #[inline(always)]
    fn add_cross(&mut self, cross: &[f64], level: usize, (n, m): (usize, usize)) {
        let (zero, node, s) = (self.zero, self.node(level), n + m);
        for k in (0..m).filter(|_| !cross.is_empty()) {
            for i in 0..n {
                let entry = &mut self.p[(level * s + n + k) * s + i];
                *entry = *entry + gather(zero, cross, node - 1, m * n, k * n + i);
            }
        }
    }

    /// Adds the weights of the rows that the first chain has at `of`.
    #[inline(always)]
    fn add_rows(&mut self, qp: &Qp, weights: &RowWeights<'_>, level: usize, of: RowBlock) {
        if !of.rows.is_empty() {
            self.add_some_rows(qp, weights, level, of);
        }
    }

    fn add_some_rows(&mut self, qp: &Qp, weights: &RowWeights<'_>, level: usize, of: RowBlock) {
        let OcpDims { nx: n, nu: m, .. } = self.dims;
        let (zero, s, all) = (self.zero, n + m, self.dims.rows());
        for row in of.rows {
            let weight = zero.generate(|lane| weights.general[row + lane * all]);
            for (e, entry) in self.vector.iter_mut().enumerate() {
                *entry = zero.generate(|lane| match e.checked_sub(n) {
                    None => qp.rows_x[(row + lane * all) * n + e],
                    Some(input) => qp.rows_u[(row + lane * all) * m + input],
                });
            }
            for r in 0..s {
                let factor = weight * self.vector[r];
                for c in 0..=r {
                    let entry = &mut self.p[(level * s + r) * s + c];
                    *entry = factor.mul_add(self.vector[c], *entry);
                }
            }
        }
    }

    /// Writes F'P F of a level to the level before.
    #[inline(always)]
    fn hand_on(&mut self, qp: &Qp, level: usize, (n, m): (usize, usize)) {
        let (zero, s, stage) = (self.zero, n + m, self.node(level) - 1);
        let f = &mut self.model[level * n * s..(level + 1) * n * s];
        for (k, row) in f.chunks_exact_mut(s).enumerate() {
            let (a, b) = row.split_at_mut(n);
            for (c, entry) in a.iter_mut().enumerate() {
                *entry = gather(zero, &qp.a, stage, n * n, k * n + c);
            }
            for (c, entry) in b.iter_mut().enumerate() {
                *entry = gather(zero, &qp.b, stage, n * m, k * m + c);
            }
        }
        let (before, p) = self.p.split_at_mut(level * s * s);
        let product = &mut self.product;
        for r in 0..s {
            let last = if r < n { s } else { r + 1 };
            for c in 0..last {
                let mut sum = if c < n { zero } else { p[low(r, c, s)] };
                for k in 0..n {
                    sum = p[low(r, k, s)].mul_add(f[k * s + c], sum);
                }
                product[r * s + c] = sum;
            }
        }
        let target = &mut before[(level - 1) * s * s..];
        for r in 0..s {
            for c in 0..=r {
                let mut sum = if r < n { zero } else { product[r * s + c] };
                for k in 0..n {
                    sum = f[k * s + r].mul_add(product[k * s + c], sum);
                }
                target[r * s + c] = sum;
            }
        }
    }

    #[inline(always)]
    fn backward_sized(&mut self, g: &[f64], c: &[f64], linear: &mut [f64], (n, m): (usize, usize)) {
        let (zero, dims, s) = (self.zero, self.dims, n + m);
        let (by_x, by_u) = g.split_at(dims.all_states());
        self.linear[(self.levels - 1) * s..].fill(zero);
        for level in (0..self.levels).rev() {
            let node = self.node(level);
            let (before, here) = self.linear.split_at_mut(level * s);
            let here = &mut here[..s];
            if node < dims.n_controls {
                let forward = &mut self.forward[level * m..(level + 1) * m];
                for k in 0..m {
                    here[n + k] = here[n + k] + gather(zero, by_u, node, m, k);
                    forward[k] = here[n + k];
                }
                let gain = &self.gain[level * m * s..(level + 1) * m * s];
                for k in 0..m {
                    for e in 0..s {
                        here[e] = forward[k].neg_mul_add(gain[k * s + e], here[e]);
                    }
                }
                let pivot = &self.pivot[level * m * m..(level + 1) * m * m];
                for r in 0..m {
                    for k in 0..r {
                        forward[r] = pivot[r * m + k].neg_mul_add(forward[k], forward[r]);
                    }
                    forward[r] = forward[r] * pivot[r * m + r];
                }
                for r in (0..m).rev() {
                    for k in r + 1..m {
                        forward[r] = pivot[k * m + r].neg_mul_add(forward[k], forward[r]);
                    }
                    forward[r] = forward[r] * pivot[r * m + r];
                }
            }
            for (e, entry) in here[..n].iter_mut().enumerate() {
                *entry = *entry + gather(zero, by_x, node - 1, n, e);
            }
            if level == 0 {
                break;
            }
            // P c + p, then F' of it
            let p = &self.p[level * s * s..(level + 1) * s * s];
            let sum = &mut self.vector[..s];
            sum.copy_from_slice(here);
            for k in 0..n {
                let offset = gather(zero, c, node - 1, n, k);
                for (e, sum) in sum.iter_mut().enumerate() {
                    *sum = p[low(e, k, s)].mul_add(offset, *sum);
                }
            }
            let f = &self.model[level * n * s..(level + 1) * n * s];
            let target = &mut before[(level - 1) * s..];
            for e in 0..s {
                let mut value = if e < n { zero } else { sum[e] };
                for k in 0..n {
                    value = f[k * s + e].mul_add(sum[k], value);
                }
                target[e] = value;
            }
        }
        for e in 0..s {
            scatter(self.linear[e], linear, self.first, s, e);
        }
    }

    #[inline(always)]
    fn roll_out_sized(
        &mut self,
        c: &[f64],
        d: &mut [f64],
        lambda: &mut [f64],
        (n, m): (usize, usize),
    ) {
        let (zero, dims, s) = (self.zero, self.dims, n + m);
        let (states, inputs) = d.split_at_mut(dims.all_states());
        // s_j = (dx_j, du_{j-1})
        let (now, later) = self.product.split_at_mut(s);
        for (e, now) in now[..n].iter_mut().enumerate() {
            *now = gather(zero, states, self.first - 1, n, e);
        }
        for k in 0..m {
            let before = |lane: usize| inputs[dims.input_of(self.first - 1 + lane) * m + k];
            now[n + k] = zero.generate(before);
        }
        for level in 0..self.levels {
            let node = self.first + level * dims.tree.scenarios();
            if level > 0 {
                let f = &self.model[level * n * s..(level + 1) * n * s];
                for r in 0..n {
                    let mut value = gather(zero, c, node - 1, n, r);
                    for e in 0..s {
                        value = f[r * s + e].mul_add(now[e], value);
                    }
                    later[r] = value;
                    scatter(value, states, node - 1, n, r);
                }
                now[..n].copy_from_slice(&later[..n]);
            }
            let p = &self.p[level * s * s..(level + 1) * s * s];
            for r in 0..n {
                let mut value = self.linear[level * s + r];
                for e in 0..s {
                    value = p[low(r, e, s)].mul_add(now[e], value);
                }
                scatter(value, lambda, node - 1, n, r);
            }
            if node < dims.n_controls {
                let gain = &self.gain[level * m * s..(level + 1) * m * s];
                for k in 0..m {
                    let mut value = now[n + k] - self.forward[level * m + k];
                    for e in 0..s {
                        value = gain[k * s + e].neg_mul_add(now[e], value);
                    }
                    later[k] = value;
                    scatter(value, inputs, node, m, k);
                }
                now[n..s].copy_from_slice(&later[..m]);
            }
        }
    }
}

/// The place of an entry of a symmetric matrix whose lower triangle is kept, in rows of `s`.
#[inline(always)]
fn low(r: usize, c: usize, s: usize) -> usize {
    r.max(c) * s + r.min(c)
}

impl<V: Simd> Chains for Lanes<V> {
    fn factor(
        &mut self,
        qp: &Qp,
        weights: &RowWeights<'_>,
        p: &mut [f64],
        expired: &mut dyn FnMut() -> bool,
    ) -> bool {
        self.zero.vectorize(Factorize { chains: self, qp, weights, p, expired })
    }

    fn backward(&mut self, g: &[f64], c: &[f64], linear: &mut [f64]) {
        self.zero.vectorize(Backward { chains: self, g, c, linear });
    }

    fn roll_out(&mut self, c: &[f64], d: &mut [f64], lambda: &mut [f64]) {
        self.zero.vectorize(RollOut { chains: self, c, d, lambda });
    }
}

struct Factorize<'a, V> {
    chains: &'a mut Lanes<V>,
    qp: &'a Qp,
    weights: &'a RowWeights<'a>,
    p: &'a mut [f64],
    expired: &'a mut dyn FnMut() -> bool,
}

impl<V: Simd> Work for Factorize<'_, V> {
    type Output = bool;

    #[inline(always)]
    fn run(self) -> bool {
        let Self { chains, qp, weights, p, expired } = self;
        sized!(chains.dims, |n, m| chains.factor_sized(qp, weights, p, (n, m), expired))
    }
}

struct Backward<'a, V> {
    chains: &'a mut Lanes<V>,
    g: &'a [f64],
    c: &'a [f64],
    linear: &'a mut [f64],
}

impl<V: Simd> Work for Backward<'_, V> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { chains, g, c, linear } = self;
        sized!(chains.dims, |n, m| chains.backward_sized(g, c, linear, (n, m)));
    }
}

struct RollOut<'a, V> {
    chains: &'a mut Lanes<V>,
    c: &'a [f64],
    d: &'a mut [f64],
    lambda: &'a mut [f64],
}

impl<V: Simd> Work for RollOut<'_, V> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { chains, c, d, lambda } = self;
        sized!(chains.dims, |n, m| chains.roll_out_sized(c, d, lambda, (n, m)));
    }
}
