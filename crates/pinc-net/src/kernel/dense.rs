//! Matrix products over columns of cells: the inner loops.

use crate::mlp::Layer;
use pinc_ad::simd::Simd;
use std::ops::Range;

/// What one neuron holds for one panel of points: two vectors of values, then the two vectors of
/// their time tangents. Value and tangent are columns of the same product, so one product serves
/// both.
pub(super) type Cell<V> = [V; 4];

/// The most rows of a register block for which there is code.
const MAX_ROWS: usize = 5;

/// A weight matrix in the order in which [`multiply`] reads it: blocks of rows, and in a block
/// column by column.
#[derive(Clone, Debug, Default)]
pub(super) struct Packed {
    rows: usize,
    depth: usize,
    block: usize,
    data: Vec<f64>,
}

impl Packed {
    /// An empty matrix of `rows` x `depth` for register blocks of `block` rows.
    fn new(rows: usize, depth: usize, block: usize) -> Self {
        Self { rows, depth, block, data: vec![0.0; rows * depth] }
    }

    fn fill(&mut self, entry: impl Fn(usize, usize) -> f64) {
        let mut data = self.data.iter_mut();
        for first in (0..self.rows).step_by(self.block) {
            for column in 0..self.depth {
                for row in first..self.rows.min(first + self.block) {
                    if let Some(to) = data.next() {
                        *to = entry(row, column);
                    }
                }
            }
        }
    }
}

/// One layer's weights, packed for the forward product W a and the backward product W' z.
#[derive(Clone, Debug)]
pub(super) struct PackedLayer {
    layer: Layer,
    pub(super) forward: Packed,
    pub(super) backward: Packed,
    pub(super) bias: Vec<f64>,
}

impl PackedLayer {
    pub(super) fn new(layer: Layer, block: usize) -> Self {
        let (inputs, outputs) = (layer.inputs, layer.outputs);
        Self {
            forward: Packed::new(outputs, inputs, block),
            backward: Packed::new(inputs, outputs, block),
            bias: vec![0.0; outputs],
            layer,
        }
    }

    pub(super) fn fill(&mut self, parameters: &[f64]) {
        let weight = &parameters[self.layer.weight.clone()];
        let inputs = self.layer.inputs;
        self.forward.fill(|row, column| weight[row * inputs + column]);
        self.backward.fill(|row, column| weight[column * inputs + row]);
        self.bias.copy_from_slice(&parameters[self.layer.bias.clone()]);
    }
}

/// output = matrix * input (+ bias in the value columns).
///
/// # Shapes
///
/// `input`: one cell per column of the matrix; `output`: one per row.
#[inline(always)]
pub(super) fn multiply<V: Simd>(
    matrix: &Packed,
    bias: Option<&[f64]>,
    input: &[Cell<V>],
    output: &mut [Cell<V>],
    zero: V,
) {
    const { assert!(V::ROWS <= MAX_ROWS) };
    let (mut weights, mut output, mut bias) = (&matrix.data[..], output, bias);
    while !output.is_empty() {
        let count = output.len().min(matrix.block);
        let (block, further) = weights.split_at(count * matrix.depth);
        let (sums, below) = output.split_at_mut(count);
        // The numbers of rows are compile-time constants, so that sums stay in registers.
        match count {
            1 => rows::<V, 1>(block, bias, input, sums, zero),
            2 => rows::<V, 2>(block, bias, input, sums, zero),
            3 => rows::<V, 3>(block, bias, input, sums, zero),
            4 => rows::<V, 4>(block, bias, input, sums, zero),
            _ => rows::<V, 5>(block, bias, input, sums, zero),
        }
        bias = bias.map(|b| &b[count..]);
        (weights, output) = (further, below);
    }
}

#[inline(always)]
fn rows<V: Simd, const R: usize>(
    weights: &[f64],
    bias: Option<&[f64]>,
    input: &[Cell<V>],
    output: &mut [Cell<V>],
    zero: V,
) {
    let mut sum = [[zero; 4]; R];
    if let Some(bias) = bias {
        for r in 0..R {
            let b = zero.constant(bias[r]);
            sum[r][0] = b;
            sum[r][1] = b;
        }
    }
    let (columns, _) = weights.as_chunks::<R>();
    for (weights, a) in columns.iter().zip(input) {
        for r in 0..R {
            let w = zero.constant(weights[r]);
            for c in 0..4 {
                sum[r][c] = w.mul_add(a[c], sum[r][c]);
            }
        }
    }
    output[..R].copy_from_slice(&sum);
}

/// gradient\[row, column\] += sum over panels of adjoint\[row\] * input\[column\], lane by lane:
/// the gradient of a weight matrix, still spread over lanes. For matrices whose gradient stays in
/// cache in this form; [`accumulate_wide`] is for others.
///
/// # Shapes
///
/// `shape` is (panels, rows, columns); `adjoint`: `[panels, rows]`, `input`: `[panels, columns]`,
/// `gradient`: `[rows, columns]`.
#[inline(always)]
pub(super) fn accumulate<V: Simd>(
    adjoint: &[Cell<V>],
    input: &[Cell<V>],
    gradient: &mut [V],
    shape: (usize, usize, usize),
) {
    const { assert!(V::ROWS <= MAX_ROWS) };
    let (_, height, _) = shape;
    for first in (0..height).step_by(V::ROWS) {
        match (height - first).min(V::ROWS) {
            1 => outer_rows::<V, 1>(adjoint, input, gradient, first, shape),
            2 => outer_rows::<V, 2>(adjoint, input, gradient, first, shape),
            3 => outer_rows::<V, 3>(adjoint, input, gradient, first, shape),
            4 => outer_rows::<V, 4>(adjoint, input, gradient, first, shape),
            _ => outer_rows::<V, 5>(adjoint, input, gradient, first, shape),
        }
    }
}

#[inline(always)]
fn outer_rows<V: Simd, const R: usize>(
    adjoint: &[Cell<V>],
    input: &[Cell<V>],
    gradient: &mut [V],
    row: usize,
    shape: (usize, usize, usize),
) {
    let (_, _, width) = shape;
    let mut column = 0;
    while width - column >= 4 {
        outer::<V, R, 4>(adjoint, input, gradient, (row, column), shape);
        column += 4;
    }
    match width - column {
        1 => outer::<V, R, 1>(adjoint, input, gradient, (row, column), shape),
        2 => outer::<V, R, 2>(adjoint, input, gradient, (row, column), shape),
        3 => outer::<V, R, 3>(adjoint, input, gradient, (row, column), shape),
        _ => {}
    }
}

#[inline(always)]
fn outer<V: Simd, const R: usize, const C: usize>(
    adjoint: &[Cell<V>],
    input: &[Cell<V>],
    gradient: &mut [V],
    (row, column): (usize, usize),
    shape: (usize, usize, usize),
) {
    let (panels, height, width) = shape;
    let place = |r: usize| {
        let first = (row + r) * width + column;
        first..first + C
    };
    let mut sum = [[gradient[0]; C]; R];
    for (r, sum) in sum.iter_mut().enumerate() {
        sum.copy_from_slice(&gradient[place(r)]);
    }
    // By index: dividing the slices into panels costs two divisions each time.
    for panel in 0..panels {
        let adjoint = &adjoint[panel * height + row..][..R];
        let input = &input[panel * width + column..][..C];
        for v in 0..4 {
            for r in 0..R {
                for c in 0..C {
                    sum[r][c] = adjoint[r][v].mul_add(input[c][v], sum[r][c]);
                }
            }
        }
    }
    for (r, sum) in sum.iter().enumerate() {
        gradient[place(r)].copy_from_slice(sum);
    }
}

/// Rows of the adjoint that stay in the first-level cache while the input goes past them.
const STRIP: usize = 24;

/// gradient\[row, column\] += sum over panels and lanes of adjoint\[row\] * input\[column\]: the
/// gradient of a weight matrix that is too large to stay spread over lanes. Its sums over lanes
/// take a number each, and are made as soon as those over the panels are.
///
/// # Shapes
///
/// See [`accumulate`].
#[inline(always)]
pub(super) fn accumulate_wide<V: Simd>(
    adjoint: &[Cell<V>],
    input: &[Cell<V>],
    gradient: &mut [f64],
    shape: (usize, usize, usize),
) {
    let (_, height, width) = shape;
    for first in (0..height).step_by(STRIP) {
        let rows = first..height.min(first + STRIP);
        let mut column = 0;
        while column < width {
            let rows = rows.clone();
            column += match width - column {
                left if V::LANES == 8 && left >= 8 => {
                    strip::<V, 8>(adjoint, input, gradient, (rows, column), shape)
                }
                4.. => strip::<V, 4>(adjoint, input, gradient, (rows, column), shape),
                2.. => strip::<V, 2>(adjoint, input, gradient, (rows, column), shape),
                _ => strip::<V, 1>(adjoint, input, gradient, (rows, column), shape),
            };
        }
    }
}

/// `C` columns from `column` in some rows; returns `C`.
#[inline(always)]
fn strip<V: Simd, const C: usize>(
    adjoint: &[Cell<V>],
    input: &[Cell<V>],
    gradient: &mut [f64],
    (rows, column): (Range<usize>, usize),
    shape: (usize, usize, usize),
) -> usize {
    let mut row = rows.start;
    while rows.end - row >= 3 {
        sums::<V, 3, C>(adjoint, input, gradient, (row, column), shape);
        row += 3;
    }
    while row < rows.end {
        sums::<V, 1, C>(adjoint, input, gradient, (row, column), shape);
        row += 1;
    }
    C
}

/// `R` rows and `C` columns of the gradient.
#[inline(always)]
fn sums<V: Simd, const R: usize, const C: usize>(
    adjoint: &[Cell<V>],
    input: &[Cell<V>],
    gradient: &mut [f64],
    (row, column): (usize, usize),
    (panels, height, width): (usize, usize, usize),
) {
    let zero = adjoint[0][0].constant(0.0);
    let mut sum = [[zero; C]; R];
    for panel in 0..panels {
        let adjoint = &adjoint[panel * height + row..][..R];
        let input = &input[panel * width + column..][..C];
        for v in 0..4 {
            for r in 0..R {
                for c in 0..C {
                    sum[r][c] = adjoint[r][v].mul_add(input[c][v], sum[r][c]);
                }
            }
        }
    }
    for (r, sum) in sum.iter().enumerate() {
        let to = &mut gradient[(row + r) * width + column..][..C];
        if C == V::LANES {
            (zero.load(to) + V::sums(sum)).write(to);
        } else {
            for (to, sum) in to.iter_mut().zip(sum) {
                *to += sum.sum();
            }
        }
    }
}
