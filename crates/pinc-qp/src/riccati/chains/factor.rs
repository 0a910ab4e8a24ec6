//! The factors of chains.

use super::super::recursion::{RowWeights, unasked};
use super::{Lanes, gather, low, scatter};
use crate::factor::SMALLEST_PIVOT;
use crate::product::padded;
use crate::{OcpDims, Qp, RowBlock};
use pinc_ad::simd::{Simd, Work};

/// See [`Chains::factor`](super::Chains::factor).
pub(super) struct Factorize<'a, V> {
    pub(super) chains: &'a mut Lanes<V>,
    pub(super) qp: &'a Qp,
    pub(super) weights: &'a RowWeights<'a>,
    pub(super) p: &'a mut [f64],
    pub(super) expired: &'a mut dyn FnMut() -> bool,
}

impl<V: Simd> Work for Factorize<'_, V> {
    type Output = bool;

    #[inline(always)]
    fn run(self) -> bool {
        let Self { chains, qp, weights, p, expired } = self;
        sized!(chains.dims, |n, m| chains.factor_sized(qp, weights, p, (n, m), expired))
    }
}

impl<V: Simd> Lanes<V> {
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
        let unasked = unasked(s);
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
        excess: V,
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
        let excess = self.factor_pivot(qp, weights, level, excess, (n, m));
        self.eliminate(level, (n, m));
        excess
    }

    /// G = L L'
    #[inline(always)]
    fn factor_pivot(
        &mut self,
        qp: &Qp,
        weights: &RowWeights<'_>,
        level: usize,
        mut excess: V,
        (n, m): (usize, usize),
    ) -> V {
        let (zero, at, s) = (self.zero, self.node(level), n + m);
        let merged = &self.p[level * s * s..(level + 1) * s * s];
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
        excess
    }

    /// `L^-1 M_u:`, by which M becomes what is left of it, and K.
    #[inline(always)]
    fn eliminate(&mut self, level: usize, (n, m): (usize, usize)) {
        let s = n + m;
        let merged = &mut self.p[level * s * s..(level + 1) * s * s];
        let pivot = &self.pivot[level * m * m..(level + 1) * m * m];
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
}
