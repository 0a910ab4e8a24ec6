//! One pass through a net, values and tangents together.

use super::layout::{FoldedLayer, Layout, RowBlock};
use pinc_ad::simd::{Simd, Task, tanh_all};

/// `f64`s in a cache line: loading a vector that lies across two takes twice as long.
pub(super) const LINE: usize = 8;

/// Maximum number of points that go through a net side by side: while one waits for its tanh, the
/// other's sums continue.
pub(super) const SIDE_BY_SIDE: usize = 2;

/// The input and the output of a layer, for each point a column of values and then columns of
/// tangents.
#[derive(Clone, Debug)]
pub(super) struct Columns {
    /// From one column to the next.
    stride: usize,
    /// Number of tangents of each point.
    tangents: usize,
    from: Vec<f64>,
    to: Vec<f64>,
}

impl Columns {
    /// Memory for up to [`SIDE_BY_SIDE`] points with up to `tangents` tangents each, in columns of
    /// up to `longest` numbers.
    pub(super) fn new(longest: usize, tangents: usize) -> Self {
        let stride = longest.next_multiple_of(LINE);
        let room = vec![0.0; SIDE_BY_SIDE * (1 + tangents) * stride + LINE];
        Self { stride, tangents, from: room.clone(), to: room }
    }

    /// Sets the number of tangents of each point.
    pub(super) fn set_tangents(&mut self, tangents: usize) {
        self.tangents = tangents;
    }

    /// The input of the first layer is (x, u, p). Its tangents are unit vectors and are not stored.
    pub(super) fn start(&mut self, point: usize, numbers: [&[f64]; 3]) {
        let first = point * (1 + self.tangents) * self.stride;
        let mut input = &mut aligned(&mut self.from)[first..];
        for part in numbers {
            let (to, rest) = input.split_at_mut(part.len());
            to.copy_from_slice(part);
            input = rest;
        }
    }

    /// The values at `point`.
    pub(super) fn value(&self, point: usize) -> &[f64] {
        &self.from[start(&self.from) + point * (1 + self.tangents) * self.stride..]
    }

    /// Tangent `j` at `point`.
    pub(super) fn tangent(&self, point: usize, j: usize) -> &[f64] {
        &self.value(point)[(1 + j) * self.stride..]
    }
}

/// Where the first full cache line of `room` begins.
pub(super) fn start(room: &[f64]) -> usize {
    room.as_ptr().align_offset(LINE * size_of::<f64>()).min(LINE)
}

fn aligned(room: &mut [f64]) -> &mut [f64] {
    let start = start(room);
    &mut room[start..]
}

/// A pass of `P` points from the input in `columns` to the output there.
pub(super) struct Step<'a, const P: usize> {
    pub(super) layout: &'a Layout,
    pub(super) columns: &'a mut Columns,
}

impl<const P: usize> Task for Step<'_, P> {
    type Output = ();

    #[inline(always)]
    fn run<V: Simd>(self, zero: V) {
        let Self { layout: Layout { layers, .. }, columns } = self;
        let last = layers.len() - 1;
        for (l, layer) in layers.iter().enumerate() {
            let (from, to) = (&*aligned(&mut columns.from), aligned(&mut columns.to));
            let (stride, tangents) = (columns.stride, columns.tangents);
            let mut pass = LayerPass { zero, layer, stride, from, to, tangents };
            let place = Place { first: l == 0, last: l == last };
            for block in &layer.blocks {
                match block.rows {
                    1 => pass.block::<P, 1, 4>(block, place),
                    2 => pass.block::<P, 2, 2>(block, place),
                    _ => pass.block::<P, 3, 1>(block, place),
                }
            }
            std::mem::swap(&mut columns.from, &mut columns.to);
        }
    }
}

/// The place of a layer in the net.
#[derive(Clone, Copy)]
struct Place {
    first: bool,
    last: bool,
}

/// The evaluation of one layer.
struct LayerPass<'a, V> {
    zero: V,
    layer: &'a FoldedLayer,
    stride: usize,
    from: &'a [f64],
    to: &'a mut [f64],
    tangents: usize,
}

impl<V: Simd> LayerPass<'_, V> {
    /// `R` vectors of neurons: a = tanh z of the values, a' = (1 - a^2) z' of the tangents. The
    /// tangents' products do not wait for tanh, which takes as long as they do: the processor works
    /// on both. Each sum is kept as `K` partial sums, so that additions need not wait
    /// either.
    #[inline(always)]
    fn block<const P: usize, const R: usize, const K: usize>(
        &mut self,
        block: &RowBlock,
        place: Place,
    ) {
        let zero = self.zero;
        let mut values = match P {
            1 => self.product::<R, P, 4>(block, 0, 1),
            _ => self.product::<R, P, 2>(block, 0, 1 + self.tangents),
        };
        let bias = rows::<V, R>(zero, &block.bias);
        let mut slopes = [[zero.constant(1.0); R]; P];
        for (a, slope) in values.iter_mut().zip(&mut slopes) {
            for (a, bias) in a.iter_mut().zip(bias) {
                *a = *a + bias;
            }
            if !place.last {
                tanh_all(a);
                for (slope, a) in slope.iter_mut().zip(a) {
                    *slope = a.neg_mul_add(*a, *slope);
                }
            }
        }
        for (point, (a, slope)) in values.into_iter().zip(slopes).enumerate() {
            let value = point * (1 + self.tangents);
            self.store(block, value, a);
            match place.first {
                true => self.first_tangents(block, value + 1, slope),
                false => self.all_tangents::<R, K>(block, value + 1, slope),
            }
        }
    }

    /// The tangents of the input are unit vectors, which pick a column of the weights.
    #[inline(always)]
    fn first_tangents<const R: usize>(&mut self, block: &RowBlock, column: usize, slope: [V; R]) {
        for j in 0..self.tangents {
            let w = rows::<V, R>(self.zero, &block.weights[j * R * V::LANES..]);
            self.store(block, column + j, times(slope, w));
        }
    }

    /// The tangents of a point, from `column` on, in groups of even size.
    #[inline(always)]
    fn all_tangents<const R: usize, const K: usize>(
        &mut self,
        block: &RowBlock,
        mut column: usize,
        slope: [V; R],
    ) {
        let groups = self.tangents.div_ceil(3);
        for group in 0..groups {
            let width = (self.tangents + group) / groups;
            match width {
                1 => self.tangents::<R, 1, K>(block, column, slope),
                2 => self.tangents::<R, 2, K>(block, column, slope),
                _ => self.tangents::<R, 3, K>(block, column, slope),
            }
            column += width;
        }
    }

    /// `C` columns of tangents from `column`.
    #[inline(always)]
    fn tangents<const R: usize, const C: usize, const K: usize>(
        &mut self,
        block: &RowBlock,
        column: usize,
        slope: [V; R],
    ) {
        let product = self.product::<R, C, K>(block, column, 1);
        for (c, product) in product.into_iter().enumerate() {
            self.store(block, column + c, times(slope, product));
        }
    }

    /// The weights times `C` columns from `column`, `step` apart, in `K` sums each.
    #[inline(always)]
    fn product<const R: usize, const C: usize, const K: usize>(
        &self,
        block: &RowBlock,
        column: usize,
        step: usize,
    ) -> [[V; R]; C] {
        let zero = self.zero;
        let inputs = self.layer.inputs;
        let mut columns: [&[f64]; C] = [&[]; C];
        for (c, column) in (column..).step_by(step).zip(&mut columns) {
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
    fn store<const R: usize>(&mut self, block: &RowBlock, column: usize, vectors: [V; R]) {
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
