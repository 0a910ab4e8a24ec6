//! One pass through a net, values and tangents together.

use super::layout::{Block, FoldedLayer, Layout};
use pinc_ad::simd::{Simd, Task, tanh_all};

/// `f64`s in a cache line: a vector that lies across two costs twice.
const LINE: usize = 8;

/// A column of values, then columns of tangents: the input and the output of a layer.
#[derive(Clone, Debug)]
pub(super) struct Columns {
    /// From one column to the next.
    stride: usize,
    from: Vec<f64>,
    to: Vec<f64>,
}

impl Columns {
    /// Room for `count` columns of up to `longest` numbers.
    pub(super) fn new(longest: usize, count: usize) -> Self {
        let stride = longest.next_multiple_of(LINE);
        let room = vec![0.0; count * stride + LINE];
        Self { stride, from: room.clone(), to: room }
    }

    /// The input of the first layer is (x, u). Its tangents are unit vectors and are not stored.
    pub(super) fn start(&mut self, x: &[f64], u: &[f64]) {
        let input = aligned(&mut self.from);
        input[..x.len()].copy_from_slice(x);
        input[x.len()..x.len() + u.len()].copy_from_slice(u);
    }

    /// The values.
    pub(super) fn value(&self) -> &[f64] {
        &self.from[start(&self.from)..]
    }

    /// Tangent `j`.
    pub(super) fn tangent(&self, j: usize) -> &[f64] {
        &self.value()[(1 + j) * self.stride..]
    }
}

/// Where the first full cache line of `room` begins.
fn start(room: &[f64]) -> usize {
    room.as_ptr().align_offset(LINE * size_of::<f64>()).min(LINE)
}

fn aligned(room: &mut [f64]) -> &mut [f64] {
    let start = start(room);
    &mut room[start..]
}

/// A pass from the input in `columns` to the output there, with this many tangents.
pub(super) struct Step<'a> {
    pub(super) layout: &'a Layout,
    pub(super) columns: &'a mut Columns,
    pub(super) tangents: usize,
}

impl Task for Step<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Simd>(self, zero: V) {
        let Self { layout: Layout { layers, .. }, columns, tangents } = self;
        let last = layers.len() - 1;
        for (l, layer) in layers.iter().enumerate() {
            let (from, to) = (&*aligned(&mut columns.from), aligned(&mut columns.to));
            let mut pass = Pass { zero, layer, stride: columns.stride, from, to, tangents };
            let place = Place { first: l == 0, last: l == last };
            for block in &layer.blocks {
                match block.rows {
                    1 => pass.block::<1, 4>(block, place),
                    2 => pass.block::<2, 2>(block, place),
                    _ => pass.block::<3, 1>(block, place),
                }
            }
            std::mem::swap(&mut columns.from, &mut columns.to);
        }
    }
}

/// Where a layer is.
#[derive(Clone, Copy)]
struct Place {
    first: bool,
    last: bool,
}

/// A layer at work.
struct Pass<'a, V> {
    zero: V,
    layer: &'a FoldedLayer,
    stride: usize,
    from: &'a [f64],
    to: &'a mut [f64],
    tangents: usize,
}

impl<V: Simd> Pass<'_, V> {
    /// `R` vectors of neurons: a = tanh z of the values, a' = (1 - a^2) z' of the tangents. The tangents'
    /// products do not wait for tanh, which takes as long as they do: the processor works on both.
    /// `K` sums are kept for every one that is wanted, so that additions need not wait either.
    #[inline(always)]
    fn block<const R: usize, const K: usize>(&mut self, block: &Block, place: Place) {
        let zero = self.zero;
        let [product] = self.product::<R, 1, 4>(block, 0);
        let mut a = rows::<V, R>(zero, &block.bias);
        for (a, product) in a.iter_mut().zip(product) {
            *a = *a + product;
        }
        let mut slope = [zero.constant(1.0); R];
        if !place.last {
            tanh_all(&mut a);
            for (slope, a) in slope.iter_mut().zip(a) {
                *slope = a.neg_mul_add(a, *slope);
            }
        }
        self.store(block, 0, a);
        if place.first {
            // The tangents of the input are unit vectors, which pick a column of the weights.
            for j in 0..self.tangents {
                let w = rows::<V, R>(zero, &block.weights[j * R * V::LANES..]);
                self.store(block, 1 + j, times(slope, w));
            }
            return;
        }
        let groups = self.tangents.div_ceil(3);
        let mut column = 1;
        for group in 0..groups {
            match (self.tangents + group) / groups {
                1 => self.tangents::<R, 1, K>(block, column, slope),
                2 => self.tangents::<R, 2, K>(block, column, slope),
                _ => self.tangents::<R, 3, K>(block, column, slope),
            }
            column += (self.tangents + group) / groups;
        }
    }

    /// `C` columns of tangents from `column`.
    #[inline(always)]
    fn tangents<const R: usize, const C: usize, const K: usize>(
        &mut self,
        block: &Block,
        column: usize,
        slope: [V; R],
    ) {
        let product = self.product::<R, C, K>(block, column);
        for (c, product) in product.into_iter().enumerate() {
            self.store(block, column + c, times(slope, product));
        }
    }

    /// The weights times `C` columns from `column`, in `K` sums each.
    #[inline(always)]
    fn product<const R: usize, const C: usize, const K: usize>(
        &self,
        block: &Block,
        column: usize,
    ) -> [[V; R]; C] {
        let zero = self.zero;
        let inputs = self.layer.inputs;
        let mut columns: [&[f64]; C] = [&[]; C];
        for (c, column) in (column..).zip(&mut columns) {
            *column = &self.from[c * self.stride..][..inputs];
        }
        let mut sums = [[[zero; R]; C]; K];
        let full = inputs / K;
        let mut chunks: [&[[f64; K]]; C] = [&[]; C];
        for (chunks, column) in chunks.iter_mut().zip(columns) {
            *chunks = &column.as_chunks().0[..full];
        }
        let mut weights = block.weights.chunks_exact(K * R * V::LANES);
        for (i, weights) in weights.by_ref().take(full).enumerate() {
            for k in 0..K {
                let w = rows(zero, &weights[k * R * V::LANES..]);
                for c in 0..C {
                    multiply_add(&mut sums[k][c], w, chunks[c][i][k]);
                }
            }
        }
        let rest = weights.remainder().chunks_exact(R * V::LANES);
        for (j, weights) in (full * K..inputs).zip(rest) {
            let w = rows(zero, weights);
            for c in 0..C {
                multiply_add(&mut sums[0][c], w, columns[c][j]);
            }
        }
        let mut total = sums[0];
        for sum in sums.iter().skip(1) {
            for c in 0..C {
                for r in 0..R {
                    total[c][r] = total[c][r] + sum[c][r];
                }
            }
        }
        total
    }

    #[inline(always)]
    fn store<const R: usize>(&mut self, block: &Block, column: usize, vectors: [V; R]) {
        let to = &mut self.to[column * self.stride + block.first..][..R * V::LANES];
        for (vector, to) in vectors.into_iter().zip(to.chunks_exact_mut(V::LANES)) {
            vector.write(to);
        }
    }
}

/// sum += w a
#[inline(always)]
fn multiply_add<V: Simd, const R: usize>(sum: &mut [V; R], w: [V; R], a: f64) {
    let a = w[0].constant(a);
    for (sum, w) in sum.iter_mut().zip(w) {
        *sum = w.mul_add(a, *sum);
    }
}

#[inline(always)]
fn times<V: Simd, const R: usize>(mut a: [V; R], b: [V; R]) -> [V; R] {
    for (a, b) in a.iter_mut().zip(b) {
        *a = *a * b;
    }
    a
}

/// The first `R` vectors of `from`.
#[inline(always)]
fn rows<V: Simd, const R: usize>(zero: V, from: &[f64]) -> [V; R] {
    let mut rows = [zero; R];
    for (row, from) in rows.iter_mut().zip(from.chunks_exact(V::LANES)) {
        *row = zero.load(from);
    }
    rows
}
