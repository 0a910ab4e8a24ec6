//! One pass through a net, values and tangents together.

use super::layout::{Block, FoldedLayer, Layout};
use pinc_ad::simd::{Simd, Task, tanh_all};

/// `f64`s in a cache line: a vector that lies across two costs twice.
const LINE: usize = 8;

/// So many columns go through a product together, at most: with three vectors of neurons, twelve sums.
const GROUP: usize = 4;

/// So many points go through the net together, at most.
pub(super) const POINTS: usize = 8;

/// The input and the output of a layer at some points: a column of values for each point, then the columns of tangents,
/// those of a point side by side.
#[derive(Clone, Debug)]
pub(super) struct Columns {
    /// From one column to the next.
    stride: usize,
    points: usize,
    from: Vec<f64>,
    to: Vec<f64>,
    /// 1 - a^2 of the neurons at hand, at each point.
    slopes: Vec<f64>,
}

impl Columns {
    /// Room for up to [`POINTS`] points with `tangents` tangents each, in columns of up to `longest` numbers.
    pub(super) fn new(longest: usize, tangents: usize) -> Self {
        let stride = longest.next_multiple_of(LINE);
        let room = vec![0.0; POINTS * (1 + tangents) * stride + LINE];
        let slopes = vec![0.0; POINTS * stride + LINE];
        Self { stride, points: 0, from: room.clone(), to: room, slopes }
    }

    /// The inputs of the first layer are (x, u) at each point. Their tangents are unit vectors and are not stored.
    pub(super) fn start(&mut self, (x, n): (&[f64], usize), (u, m): (&[f64], usize)) {
        self.points = x.len() / n;
        let columns = aligned(&mut self.from).chunks_exact_mut(self.stride);
        for (point, column) in columns.enumerate().take(self.points) {
            column[..n].copy_from_slice(&x[point * n..(point + 1) * n]);
            column[n..n + m].copy_from_slice(&u[point * m..(point + 1) * m]);
        }
    }

    /// The values at `point`.
    pub(super) fn value(&self, point: usize) -> &[f64] {
        &self.from[start(&self.from) + point * self.stride..]
    }

    /// Tangent `j` of `tangents` at `point`.
    pub(super) fn tangent(&self, point: usize, j: usize, tangents: usize) -> &[f64] {
        self.value(self.points + point * tangents + j)
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
            let slopes = aligned(&mut columns.slopes);
            let (stride, points) = (columns.stride, columns.points);
            let mut pass = Pass { zero, layer, stride, from, to, slopes, points, tangents };
            let place = Place { first: l == 0, last: l == last };
            for block in &layer.blocks {
                match block.rows {
                    1 => pass.block::<1>(block, place),
                    2 => pass.block::<2>(block, place),
                    _ => pass.block::<3>(block, place),
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
    slopes: &'a mut [f64],
    points: usize,
    tangents: usize,
}

impl<V: Simd> Pass<'_, V> {
    /// `R` vectors of neurons: a = tanh z of the values, a' = (1 - a^2) z' of the tangents. The tangents'
    /// products do not wait for tanh, which takes as long as they do: the processor works on both. Columns go through
    /// the product in groups, so that a weight is loaded once for all of a group; where a group is small, several
    /// sums are kept for every one that is wanted, so that additions need not wait either.
    #[inline(always)]
    fn block<const R: usize>(&mut self, block: &Block, place: Place) {
        for (first, columns) in groups(0, self.points) {
            match columns {
                1 => self.values::<R, 1, 4>(block, first, place),
                2 => self.values::<R, 2, 2>(block, first, place),
                3 => self.values::<R, 3, 1>(block, first, place),
                _ => self.values::<R, 4, 1>(block, first, place),
            }
        }
        if place.first {
            self.first_tangents::<R>(block);
            return;
        }
        for (first, columns) in groups(self.points, self.points * self.tangents) {
            match columns {
                1 => self.tangents::<R, 1, 4>(block, first),
                2 => self.tangents::<R, 2, 2>(block, first),
                3 => self.tangents::<R, 3, 1>(block, first),
                _ => self.tangents::<R, 4, 1>(block, first),
            }
        }
    }

    /// The values of `C` points from `point`, and their slopes.
    #[inline(always)]
    fn values<const R: usize, const C: usize, const K: usize>(
        &mut self,
        block: &Block,
        point: usize,
        place: Place,
    ) {
        let zero = self.zero;
        let bias = rows::<V, R>(zero, &block.bias);
        let products = self.product::<R, C, K>(block, point);
        for (c, mut a) in products.into_iter().enumerate() {
            for (a, bias) in a.iter_mut().zip(bias) {
                *a = *a + bias;
            }
            let mut slope = [zero.constant(1.0); R];
            if !place.last {
                tanh_all(&mut a);
                for (slope, a) in slope.iter_mut().zip(a) {
                    *slope = a.neg_mul_add(a, *slope);
                }
            }
            self.store(block, point + c, a);
            write(slope, &mut self.slopes[(point + c) * self.stride..]);
        }
    }

    /// The tangents of the input are unit vectors, which pick a column of the weights.
    #[inline(always)]
    fn first_tangents<const R: usize>(&mut self, block: &Block) {
        for point in 0..self.points {
            let slope = self.slope::<R>(point);
            for j in 0..self.tangents {
                let w = rows::<V, R>(self.zero, &block.weights[j * R * V::LANES..]);
                let column = self.points + point * self.tangents + j;
                self.store(block, column, times(slope, w));
            }
        }
    }

    /// `C` columns of tangents from `column`.
    #[inline(always)]
    fn tangents<const R: usize, const C: usize, const K: usize>(
        &mut self,
        block: &Block,
        column: usize,
    ) {
        let product = self.product::<R, C, K>(block, column);
        for (column, product) in (column..).zip(product) {
            let slope = self.slope::<R>((column - self.points) / self.tangents);
            self.store(block, column, times(slope, product));
        }
    }

    /// What tanh' is at `point`.
    #[inline(always)]
    fn slope<const R: usize>(&self, point: usize) -> [V; R] {
        rows(self.zero, &self.slopes[point * self.stride..])
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
        write(vectors, &mut self.to[column * self.stride + block.first..]);
    }
}

/// Splits `count` columns from `first` into groups as even as can be: where each begins and how many it has.
#[inline(always)]
fn groups(first: usize, count: usize) -> impl Iterator<Item = (usize, usize)> {
    let groups = count.div_ceil(GROUP);
    (0..groups).scan(first, move |next, group| {
        let columns = (count + group) / groups;
        *next += columns;
        Some((*next - columns, columns))
    })
}

/// Writes the vectors to the first places of `to`.
#[inline(always)]
fn write<V: Simd, const R: usize>(vectors: [V; R], to: &mut [f64]) {
    let to = to[..R * V::LANES].chunks_exact_mut(V::LANES);
    for (vector, to) in vectors.into_iter().zip(to) {
        vector.write(to);
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
