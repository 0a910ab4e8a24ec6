//! The recursion on the chains that a tree ends in, side by side in vectors.

mod factor;
mod solve;

use super::recursion::RowWeights;
use crate::{OcpDims, Qp};
use factor::Factorize;
use pinc_ad::simd::{Isa, Simd, Task};
use solve::{Backward, RollOut};
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
