//! A pass of many points through a net: points lie in the lanes of vectors.

use super::layout::{BlockedLayer, Layout};
use super::step::{LINE, start};
use pinc_ad::simd::{Simd, Task, tanh_all};
use pinc_ode::{Dims, Linearization, Stages};

/// Maximum number of columns of a neuron that are computed together.
const COLUMNS: usize = 4;

/// For each neuron of a layer a vector of values and then vectors of tangents, in the current
/// layer and in the next.
#[derive(Clone, Debug)]
pub(super) struct Cells {
    from: Vec<f64>,
    to: Vec<f64>,
}

impl Cells {
    /// Memory for layers of up to `widest` neurons with up to `tangents` tangents each, in vectors
    /// of so many lanes.
    pub(super) fn new(widest: usize, tangents: usize, lanes: usize) -> Self {
        let room = vec![0.0; widest * (1 + tangents) * lanes + LINE];
        Self { from: room.clone(), to: room }
    }
}

/// As many points as a vector has lanes, or fewer.
pub(super) struct Batched<'a> {
    pub(super) layout: &'a Layout,
    pub(super) cells: &'a mut Cells,
    pub(super) dims: Dims,
    /// By how many of the numbers (x, u, p) there are derivatives: by x and u, or by all.
    pub(super) tangents: usize,
    pub(super) at: Stages<'a>,
    pub(super) out: Linearization<'a>,
}

impl Task for Batched<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Simd>(mut self, zero: V) {
        self.start(zero);
        let Self { layout, cells, tangents, .. } = &mut self;
        let width = 1 + *tangents;
        let last = layout.packed.len() - 1;
        for (l, layer) in layout.packed.iter().enumerate() {
            let Cells { from, to } = &mut **cells;
            let (at_from, at_to) = (start(from), start(to));
            let (from, to) = (&from[at_from..], &mut to[at_to..]);
            let mut pass = LayerPass { zero, layer, width, from, to };
            if l == 0 {
                pass.enter();
            } else {
                pass.multiply();
            }
            if l < last {
                pass.activate();
            }
            std::mem::swap(&mut cells.from, &mut cells.to);
        }
        self.finish(zero);
    }
}

impl Batched<'_> {
    /// The values of (x, u, p), without the tangents, which are unit vectors. Lanes without a point
    /// repeat the last one.
    #[inline(always)]
    fn start<V: Simd>(&mut self, zero: V) {
        let Dims { nx: n, nu: m, np, .. } = self.dims;
        let Stages { x, u, p } = self.at;
        let points = x.len() / n;
        let at = start(&self.cells.from);
        let mut to = self.cells.from[at..].chunks_exact_mut(V::LANES);
        for (of, width) in [(x, n), (u, m), (p, np)] {
            for (i, to) in (0..width).zip(&mut to) {
                zero.generate(|lane| of[lane.min(points - 1) * width + i]).write(to);
            }
        }
    }

    /// From the last layer's cells to the results.
    #[inline(always)]
    fn finish<V: Simd>(self, _: V) {
        let Dims { nx: n, nu: m, np, .. } = self.dims;
        let (x, Linearization { next, a, b, e }) = (self.at.x, self.out);
        let points = x.len() / n;
        let from = &self.cells.from[start(&self.cells.from)..];
        let width = 1 + self.tangents;
        let own: f64 = if self.layout.adds_initial_state() { 1.0 } else { 0.0 };
        for (i, cell) in from.chunks_exact(width * V::LANES).take(n).enumerate() {
            let (value, tangents) = cell.split_at(V::LANES);
            let (by_x, rest) = tangents.split_at(n * V::LANES);
            let (by_u, by_p) = rest.split_at(m * V::LANES);
            for (point, value) in value[..points].iter().enumerate() {
                next[point * n + i] = value + own * x[point * n + i];
            }
            for (j, by) in by_x.chunks_exact(V::LANES).enumerate() {
                let own = if i == j { own } else { 0.0 };
                for (point, value) in by[..points].iter().enumerate() {
                    a[(point * n + i) * n + j] = value + own;
                }
            }
            for (by, matrix, width) in [(by_u, &mut *b, m), (by_p, &mut *e, np)] {
                for (j, by) in by.chunks_exact(V::LANES).enumerate() {
                    for (point, value) in by[..points].iter().enumerate() {
                        matrix[(point * n + i) * width + j] = *value;
                    }
                }
            }
        }
    }
}

/// The evaluation of one layer.
struct LayerPass<'a, V> {
    zero: V,
    layer: &'a BlockedLayer,
    /// Vectors of a neuron: 1 and the tangents.
    width: usize,
    from: &'a [f64],
    to: &'a mut [f64],
}

impl<V: Simd> LayerPass<'_, V> {
    /// The first layer: its tangents are columns of the weights.
    #[inline(always)]
    fn enter(&mut self) {
        let BlockedLayer { inputs, bias, rows, .. } = self.layer;
        let zero = self.zero;
        for (row, &bias) in bias.iter().enumerate() {
            let weights = &rows[row * inputs..(row + 1) * inputs];
            let mut sum = zero.constant(bias);
            for (k, &w) in weights.iter().enumerate() {
                sum = zero.constant(w).mul_add(zero.load(&self.from[k * V::LANES..]), sum);
            }
            self.store(row, 0, sum);
            for (j, &w) in weights.iter().enumerate().take(self.width - 1) {
                self.store(row, 1 + j, zero.constant(w));
            }
        }
    }

    /// z = W a + b, z' = W a'.
    #[inline(always)]
    fn multiply(&mut self) {
        let groups = self.width.div_ceil(COLUMNS);
        let mut first = 0;
        for group in 0..groups {
            // Evenly divided: 6 columns are 3 and 3.
            let columns = (self.width + group) / groups;
            match columns {
                1 => self.columns::<1>(first),
                2 => self.columns::<2>(first),
                3 => self.columns::<3>(first),
                _ => self.columns::<4>(first),
            }
            first += columns;
        }
    }

    /// `C` columns from `first` of all neurons.
    #[inline(always)]
    fn columns<const C: usize>(&mut self, first: usize) {
        let mut weights = &self.layer.blocks[..];
        let mut row = 0;
        while row < self.layer.bias.len() {
            let count = BlockedLayer::ROWS.min(self.layer.bias.len() - row);
            let (block, further) = weights.split_at(count * self.layer.inputs);
            match count {
                1 => self.block::<1, C>(block, row, first),
                2 => self.block::<2, C>(block, row, first),
                3 => self.block::<3, C>(block, row, first),
                _ => self.block::<4, C>(block, row, first),
            }
            weights = further;
            row += count;
        }
    }

    /// `R` neurons from `row`, `C` columns from `first`.
    #[inline(always)]
    fn block<const R: usize, const C: usize>(&mut self, weights: &[f64], row: usize, first: usize) {
        let zero = self.zero;
        let mut sums = [[zero; C]; R];
        if first == 0 {
            for (sum, &bias) in sums.iter_mut().zip(&self.layer.bias[row..]) {
                sum[0] = zero.constant(bias);
            }
        }
        let cells = self.from.chunks_exact(self.width * V::LANES);
        for (weights, cell) in weights.as_chunks::<R>().0.iter().zip(cells) {
            let cell = &cell[first * V::LANES..][..C * V::LANES];
            let mut a = [zero; C];
            for (a, from) in a.iter_mut().zip(cell.chunks_exact(V::LANES)) {
                *a = zero.load(from);
            }
            for (sum, &w) in sums.iter_mut().zip(weights) {
                let w = zero.constant(w);
                for (sum, a) in sum.iter_mut().zip(a) {
                    *sum = w.mul_add(a, *sum);
                }
            }
        }
        for (r, sum) in sums.into_iter().enumerate() {
            for (c, sum) in sum.into_iter().enumerate() {
                self.store(row + r, first + c, sum);
            }
        }
    }

    /// a = tanh z, a' = (1 - a^2) z'.
    #[inline(always)]
    fn activate(&mut self) {
        let neurons = self.layer.bias.len();
        let mut row = 0;
        while row < neurons {
            if neurons - row >= 4 {
                self.activate_rows::<4>(row);
                row += 4;
            } else {
                self.activate_rows::<1>(row);
                row += 1;
            }
        }
    }

    #[inline(always)]
    fn activate_rows<const R: usize>(&mut self, row: usize) {
        let zero = self.zero;
        let mut values = [zero; R];
        for (r, value) in values.iter_mut().enumerate() {
            *value = zero.load(&self.to[(row + r) * self.width * V::LANES..]);
        }
        tanh_all(&mut values);
        for (r, a) in values.into_iter().enumerate() {
            self.store(row + r, 0, a);
            let slope = a.neg_mul_add(a, a.constant(1.0));
            let first = ((row + r) * self.width + 1) * V::LANES;
            let tangents = &mut self.to[first..first + (self.width - 1) * V::LANES];
            for tangent in tangents.chunks_exact_mut(V::LANES) {
                (zero.load(tangent) * slope).write(tangent);
            }
        }
    }

    #[inline(always)]
    fn store(&mut self, row: usize, column: usize, vector: V) {
        let at = (row * self.width + column) * V::LANES;
        vector.write(&mut self.to[at..at + V::LANES]);
    }
}
