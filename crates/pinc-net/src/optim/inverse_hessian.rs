//! A symmetric matrix that is multiplied by a vector and updated by low ranks, as fast as memory
//! allows.

use crate::Workers;
use pinc_ad::simd::{Simd, Task};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::{Scratch, dot, set};

/// Rows that are stored together.
const BLOCK: usize = 8;

/// Rows that go through registers together.
const GROUP: usize = 4;

/// Updates that are held back and then applied in one pass. A pass that only reads the matrix costs
/// half of one that also writes it.
const BATCH: usize = 8;

/// Parts of the matrix that threads take: a fixed number, so that sums do not depend on the
/// threads.
const PARTS: usize = 16;

/// H <- scale H + hh Hy Hy' + hs (Hy s' + s Hy') + ss s s'.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Update {
    pub(super) s: Vec<f64>,
    pub(super) hy: Vec<f64>,
    pub(super) scale: f64,
    pub(super) hh: f64,
    pub(super) hs: f64,
    pub(super) ss: f64,
}

/// A symmetric matrix H, of which only the upper triangle is stored, in blocks of eight rows from
/// the diagonal block to the right; sizes are rounded up to whole blocks. Memory: 4 P^2 bytes for P
/// variables.
///
/// The matrix represented is `scale` times the stored one plus the pending updates.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct InverseHessian {
    variables: usize,
    stored: Vec<f64>,
    scale: f64,
    /// Updates that are held back; their vectors are filled up with zeros to whole blocks.
    pending: Vec<Update>,
    #[serde(skip)]
    buffers: Scratch<Buffers>,
}

/// Memory of a product.
#[derive(Debug, Default)]
struct Buffers {
    x: Vec<f64>,
    partial: Vec<f64>,
    /// Updates for reuse.
    spare: Vec<Update>,
}

impl InverseHessian {
    /// `diagonal` times the identity.
    pub(super) fn identity(variables: usize, diagonal: f64) -> Self {
        let blocks = variables.div_ceil(BLOCK);
        let mut stored = vec![0.0; first_entry(blocks, blocks)];
        for row in 0..variables {
            let (block, i) = (row / BLOCK, row % BLOCK);
            let width = (blocks - block) * BLOCK;
            stored[first_entry(block, blocks) + i * width + i] = diagonal;
        }
        Self { variables, stored, scale: 1.0, pending: Vec::new(), buffers: Scratch::default() }
    }

    /// Whether there is no matrix yet.
    pub(super) fn is_empty(&self) -> bool {
        self.variables == 0
    }

    /// An update to be filled in and given to [`Self::update`]; its vectors have arbitrary content.
    pub(super) fn new_update(&mut self) -> Update {
        self.buffers.0.spare.pop().unwrap_or_default()
    }

    /// Applies an update.
    pub(super) fn update(&mut self, mut update: Update) {
        let padded = self.variables.next_multiple_of(BLOCK);
        update.s.resize(padded, 0.0);
        update.hy.resize(padded, 0.0);
        self.scale *= update.scale;
        for earlier in &mut self.pending {
            earlier.hh *= update.scale;
            earlier.hs *= update.scale;
            earlier.ss *= update.scale;
        }
        self.pending.push(update);
    }

    /// H v, into `result`.
    pub(super) fn product(&mut self, v: &[f64], result: &mut Vec<f64>, workers: &Workers) {
        let Self { variables, stored, scale, pending, buffers: Scratch(buffers) } = self;
        let padded = variables.next_multiple_of(BLOCK);
        set(&mut buffers.x, v.iter().copied());
        buffers.x.resize(padded, 0.0);
        buffers.partial.clear();
        buffers.partial.resize(padded * PARTS, 0.0);
        let full = pending.len() >= BATCH;
        let batch = full.then_some(Batch { scale: *scale, updates: pending });
        let mut parts = parts(stored, &buffers.x, batch, &mut buffers.partial);
        workers.pool.install(|| {
            parts.par_iter_mut().for_each(|part| {
                part.take().into_iter().for_each(|part| workers.isa.dispatch(part));
            });
        });
        if full {
            *scale = 1.0;
            buffers.spare.append(pending);
        }
        set(result, std::iter::repeat_n(0.0, *variables));
        for partial in buffers.partial.chunks_exact(padded) {
            for (sum, part) in result.iter_mut().zip(partial) {
                *sum += part;
            }
        }
        result.iter_mut().for_each(|sum| *sum *= *scale);
        for update in &*pending {
            update.add_product(v, result);
        }
    }
}

/// The parts of a product; the vectors are of whole blocks.
fn parts<'a>(
    stored: &'a mut [f64],
    x: &'a [f64],
    batch: Option<Batch<'a>>,
    partial: &'a mut [f64],
) -> [Option<Part<'a>>; PARTS] {
    let blocks = x.len() / BLOCK;
    let (mut matrices, mut partials) = (stored, partial.chunks_exact_mut(x.len()));
    std::array::from_fn(|i| {
        let (first, end) = (edge(i, blocks), edge(i + 1, blocks));
        let length = first_entry(end, blocks) - first_entry(first, blocks);
        let matrix = matrices.split_off_mut(..length)?;
        Some(Part { matrix, blocks: (first, end), x, batch, partial: partials.next()? })
    })
}

impl Update {
    /// result += (this update without its scale) v
    pub(super) fn add_product(&self, v: &[f64], result: &mut [f64]) {
        let (hy_v, s_v) = (dot(&self.hy, v), dot(&self.s, v));
        let along_hy = self.hh * hy_v + self.hs * s_v;
        let along_s = self.hs * hy_v + self.ss * s_v;
        for ((result, hy), s) in result.iter_mut().zip(&self.hy).zip(&self.s) {
            *result += along_hy * hy + along_s * s;
        }
    }
}

/// Index of the first entry of block row `block`, of `blocks`.
fn first_entry(block: usize, blocks: usize) -> usize {
    // BLOCK rows of (blocks - b) BLOCK entries for each earlier block b.
    BLOCK * BLOCK * (block * blocks - block * block.saturating_sub(1) / 2)
}

/// The block row at which part `part` begins and the one before it ends; parts have about the same
/// number of entries.
fn edge(part: usize, blocks: usize) -> usize {
    let total = first_entry(blocks, blocks);
    (0..=blocks).find(|&b| first_entry(b, blocks) * PARTS >= total * part).unwrap_or(blocks)
}

/// The pending updates, ready to be applied.
#[derive(Clone, Copy)]
struct Batch<'a> {
    scale: f64,
    updates: &'a [Update],
}

/// Some block rows: applies the batch to them, and adds their share of H x to `partial`.
struct Part<'a> {
    matrix: &'a mut [f64],
    blocks: (usize, usize),
    x: &'a [f64],
    batch: Option<Batch<'a>>,
    partial: &'a mut [f64],
}

impl Task for Part<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Simd>(self, zero: V) {
        let mut rest = self.matrix;
        for block in self.blocks.0..self.blocks.1 {
            let first = block * BLOCK;
            let width = self.x.len() - first;
            let (rows, after) = rest.split_at_mut(BLOCK * width);
            rest = after;
            for (group, rows) in rows.chunks_exact_mut(GROUP * width).enumerate() {
                let row = first + group * GROUP;
                if let Some(batch) = self.batch {
                    apply(rows, batch, (row, first), zero);
                }
                multiply(rows, self.x, self.partial, (row, first), zero);
            }
        }
    }
}

/// The lanes of `from`, which holds as many.
#[inline(always)]
fn load<V: Simd>(zero: V, from: &[f64]) -> V {
    zero.generate(|i| from[i])
}

/// A group's rows (the first of them is row `row`, from column `first` on) by the batch of updates.
#[inline(always)]
fn apply<V: Simd>(rows: &mut [f64], batch: Batch<'_>, (row, first): (usize, usize), zero: V) {
    let width = rows.len() / GROUP;
    let mut coefficients = [[[zero; GROUP]; 2]; BATCH];
    for (c, update) in coefficients.iter_mut().zip(batch.updates) {
        let Update { s, hy, hh, hs, ss, .. } = update;
        for r in 0..GROUP {
            let (hy, s) = (hy[row + r], s[row + r]);
            c[0][r] = zero.constant(hh * hy + hs * s);
            c[1][r] = zero.constant(hs * hy + ss * s);
        }
    }
    let scale = zero.constant(batch.scale);
    for j in (0..width).step_by(V::LANES) {
        let mut h: [V; GROUP] =
            std::array::from_fn(|r| load(zero, &rows[r * width + j..][..V::LANES]) * scale);
        for (c, update) in coefficients.iter().zip(batch.updates) {
            for (c, vector) in c.iter().zip([&update.hy, &update.s]) {
                let v = load(zero, &vector[first + j..][..V::LANES]);
                for r in 0..GROUP {
                    h[r] = c[r].mul_add(v, h[r]);
                }
            }
        }
        for r in 0..GROUP {
            h[r].write(&mut rows[r * width + j..][..V::LANES]);
        }
    }
}

/// A group's share of H x: its rows' products, and to the right of the diagonal block the products
/// of the columns that mirror them.
#[inline(always)]
fn multiply<V: Simd>(
    rows: &[f64],
    x: &[f64],
    partial: &mut [f64],
    (row, first): (usize, usize),
    zero: V,
) {
    let width = rows.len() / GROUP;
    let mut sums = [zero; GROUP];
    for j in (0..BLOCK).step_by(V::LANES) {
        let v = load(zero, &x[first + j..][..V::LANES]);
        for r in 0..GROUP {
            sums[r] = load(zero, &rows[r * width + j..][..V::LANES]).mul_add(v, sums[r]);
        }
    }
    let mirrored: [V; GROUP] = std::array::from_fn(|r| zero.constant(x[row + r]));
    for j in (BLOCK..width).step_by(V::LANES) {
        let v = load(zero, &x[first + j..][..V::LANES]);
        let column = &mut partial[first + j..][..V::LANES];
        let mut sum = load(zero, column);
        for r in 0..GROUP {
            let h = load(zero, &rows[r * width + j..][..V::LANES]);
            sums[r] = h.mul_add(v, sums[r]);
            sum = h.mul_add(mirrored[r], sum);
        }
        sum.write(column);
    }
    for (partial, sum) in partial[row..row + GROUP].iter_mut().zip(sums) {
        *partial += sum.sum();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The matrix, dense and without delay.
    struct Dense(Vec<Vec<f64>>);

    impl Dense {
        fn update(&mut self, u: &Update) {
            for (i, row) in self.0.iter_mut().enumerate() {
                for (j, h) in row.iter_mut().enumerate() {
                    *h = u.scale * *h
                        + u.hh * u.hy[i] * u.hy[j]
                        + u.hs * (u.hy[i] * u.s[j] + u.s[i] * u.hy[j])
                        + u.ss * u.s[i] * u.s[j];
                }
            }
        }
    }

    /// Numbers in [-1, 1) that look random.
    fn numbers(n: usize, seed: u32) -> Vec<f64> {
        let unit = |i: u32| f64::from(sobol_burley::sample(7, 0, seed ^ (i * 977)));
        (0..).take(n).map(|i| unit(i) * 2.0 - 1.0).collect()
    }

    #[test]
    fn products_and_updates_match_the_dense_matrix() {
        for n in [1, 3, 8, 13, 40, 101] {
            let workers = Workers::new(2).unwrap();
            let mut matrix = InverseHessian::identity(n, 0.7);
            let mut dense = Dense(
                (0..n).map(|i| (0..n).map(|j| if i == j { 0.7 } else { 0.0 }).collect()).collect(),
            );
            for step in 0..30 {
                let v = numbers(n, step);
                let mut product = Vec::new();
                matrix.product(&v, &mut product, &workers);
                assert_eq!(product.len(), n, "step {step}");
                for (row, got) in dense.0.iter().zip(&product) {
                    // A hundred products of numbers of size 10 at most.
                    assert!((dot(row, &v) - got).abs() < 1e-12, "n = {n}, step {step}");
                }
                let update = Update {
                    s: numbers(n, 100 + step),
                    hy: numbers(n, 200 + step),
                    scale: 0.8,
                    hh: 0.3,
                    hs: -0.2,
                    ss: 0.1,
                };
                dense.update(&update);
                matrix.update(update);
            }
        }
    }

    #[test]
    fn parts_cover_the_matrix() {
        for blocks in [1, 2, 7, 16, 180] {
            let edges = [0, 1, 2, 5, 9, 15, PARTS].map(|part| edge(part, blocks));
            assert_eq!((edges[0], edges[6]), (0, blocks));
            assert!(edges.is_sorted());
        }
    }
}
