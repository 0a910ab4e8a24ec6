//! Products of matrices in vectors, with the columns in the lanes.

use pinc_ad::simd::Simd;

/// Lanes of the widest vector.
const WIDEST: usize = 8;

/// Rows that are computed side by side.
pub(super) const ROWS: usize = 4;

/// The length of rows of `width` numbers that are to be in vectors.
pub(super) fn padded(width: usize) -> usize {
    width.next_multiple_of(WIDEST)
}

/// A matrix, or its transpose: entry (i, k) is at `i by_row + k by_column`.
#[derive(Clone, Copy)]
pub(super) struct Factor<'a> {
    pub(super) matrix: &'a [f64],
    pub(super) by_row: usize,
    pub(super) by_column: usize,
}

/// What a product does to the matrix that it is for.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum To {
    /// Adds itself.
    Add,
    /// Takes the place of what was there.
    Set,
}

/// to += factor from or to = factor from, where `factor` is of shape `[rows, inner]`: the first
/// `width` columns of these rows, and what is beyond them in the last vectors.
#[inline(always)]
pub(super) fn multiply<V: Simd>(
    zero: V,
    action: To,
    factor: Factor<'_>,
    [rows, inner]: [usize; 2],
    from: &[f64],
    to: &mut [f64],
    [stride, width]: [usize; 2],
) {
    let mut first = 0;
    while first + ROWS <= rows {
        multiply_rows::<V, ROWS>(zero, action, factor, [first, inner], from, to, [stride, width]);
        first += ROWS;
    }
    while first + 2 <= rows {
        multiply_rows::<V, 2>(zero, action, factor, [first, inner], from, to, [stride, width]);
        first += 2;
    }
    if first < rows {
        multiply_rows::<V, 1>(zero, action, factor, [first, inner], from, to, [stride, width]);
    }
}

/// `R` rows of [`multiply`], from `first` on: two vectors of each side by side, then one.
#[inline(always)]
fn multiply_rows<V: Simd, const R: usize>(
    zero: V,
    action: To,
    factor: Factor<'_>,
    [first, inner]: [usize; 2],
    from: &[f64],
    to: &mut [f64],
    [stride, width]: [usize; 2],
) {
    let to = &mut to[first * stride..(first + R) * stride];
    let from = &from[..inner * stride];
    let (mut at, sizes) = (0, [first, stride]);
    while at + 2 * V::LANES <= stride && at + V::LANES < width {
        multiply_tile::<V, R, 2>(zero, action, factor, from, to, at, sizes);
        at += 2 * V::LANES;
    }
    if at < width {
        multiply_tile::<V, R, 1>(zero, action, factor, from, to, at, sizes);
    }
}

/// `C` vectors of each of `R` rows of [`multiply`], from column `at` on.
#[inline(always)]
fn multiply_tile<V: Simd, const R: usize, const C: usize>(
    zero: V,
    action: To,
    Factor { matrix, by_row, by_column }: Factor<'_>,
    from: &[f64],
    to: &mut [f64],
    at: usize,
    [first, stride]: [usize; 2],
) {
    let mut sums = [[zero; C]; R];
    if action == To::Add {
        for (row, sums) in to.chunks_exact(stride).zip(&mut sums) {
            for (c, sum) in sums.iter_mut().enumerate() {
                *sum = zero.load(&row[at + c * V::LANES..]);
            }
        }
    }
    for (k, row) in from.chunks_exact(stride).enumerate() {
        let mut vectors = [zero; C];
        for (c, vector) in vectors.iter_mut().enumerate() {
            *vector = zero.load(&row[at + c * V::LANES..]);
        }
        for (i, sums) in sums.iter_mut().enumerate() {
            let entry = zero.constant(matrix[(first + i) * by_row + k * by_column]);
            for (sum, vector) in sums.iter_mut().zip(vectors) {
                *sum = vector.mul_add(entry, *sum);
            }
        }
    }
    for (row, sums) in to.chunks_exact_mut(stride).zip(&sums) {
        for (c, sum) in sums.iter().enumerate() {
            sum.write(&mut row[at + c * V::LANES..]);
        }
    }
}
