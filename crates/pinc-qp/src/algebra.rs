//! Products of small matrices, stored row by row, and vectors.

/// Whether all numbers are finite. All are looked at, in vectors, which takes less time than to
/// stop at the first that is not, where nearly always none is.
#[inline]
#[must_use]
pub fn all_finite(values: &[f64]) -> bool {
    // 0 times infinity is NaN.
    let (fours, rest) = values.as_chunks::<4>();
    let mut sums = [0.0; 4];
    for four in fours {
        for (sum, value) in sums.iter_mut().zip(four) {
            *sum += value * 0.0;
        }
    }
    let rest: f64 = rest.iter().map(|value| value * 0.0).sum();
    (sums.iter().sum::<f64>() + rest).is_finite()
}

/// The largest absolute value; infinity if there is a NaN. In vectors, as [`all_finite`].
#[inline]
#[must_use]
pub fn largest(values: &[f64]) -> f64 {
    let (fours, rest) = values.as_chunks::<4>();
    let (mut most, mut sums) = ([0.0_f64; 4], [0.0; 4]);
    for four in fours {
        for ((most, sum), value) in most.iter_mut().zip(&mut sums).zip(four) {
            *most = more(*most, value.abs());
            // 0 times infinity is NaN.
            *sum += value * 0.0;
        }
    }
    let (mut most, mut sum) = (most.into_iter().fold(0.0, more), sums.into_iter().sum::<f64>());
    for value in rest {
        most = more(most, value.abs());
        sum += value * 0.0;
    }
    if sum.is_finite() { most } else { f64::INFINITY }
}

/// The larger of the two, where neither is NaN: one instruction, which `f64::max` is not.
#[inline(always)]
fn more(a: f64, b: f64) -> f64 {
    if b > a { b } else { a }
}

/// Makes a matrix that is symmetric up to rounding symmetric: the means of what is below and above
/// the diagonal. `stride` is how far its rows are apart.
#[inline(always)]
pub fn symmetrize(matrix: &mut [f64], size: usize, stride: usize) {
    for c in 1..size {
        for r in 0..c {
            let mean = 0.5 * (matrix[c * stride + r] + matrix[r * stride + c]);
            matrix[c * stride + r] = mean;
            matrix[r * stride + c] = mean;
        }
    }
}

/// Block `j` of blocks of `size` numbers.
#[inline(always)]
pub(super) fn block(blocks: &[f64], j: usize, size: usize) -> &[f64] {
    &blocks[j * size..(j + 1) * size]
}

/// Block `j` of blocks of `size` numbers, to be written.
#[inline(always)]
pub(super) fn block_mut(blocks: &mut [f64], j: usize, size: usize) -> &mut [f64] {
    &mut blocks[j * size..(j + 1) * size]
}

/// sum += factor vector, as far as the shorter goes.
#[inline(always)]
pub(super) fn add_scaled(sum: &mut [f64], factor: f64, vector: &[f64]) {
    for (sum, entry) in sum.iter_mut().zip(vector) {
        *sum += factor * entry;
    }
}

/// a'b, in two sums side by side.
#[inline(always)]
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (a2, b2) = (a.chunks_exact(2), b.chunks_exact(2));
    let last = match (a2.remainder(), b2.remainder()) {
        ([a], [b]) => a * b,
        _ => 0.0,
    };
    let mut sums = [0.0; 2];
    for (a, b) in a2.zip(b2) {
        sums[0] += a[0] * b[0];
        sums[1] += a[1] * b[1];
    }
    sums[0] + sums[1] + last
}

/// sum += matrix vector
#[inline(always)]
pub(super) fn add_product(matrix: &[f64], vector: &[f64], sum: &mut [f64]) {
    for (sum, row) in sum.iter_mut().zip(matrix.chunks_exact(vector.len())) {
        *sum += dot(row, vector);
    }
}

/// sum += matrix' vector
#[inline(always)]
pub(super) fn add_transposed(matrix: &[f64], vector: &[f64], sum: &mut [f64]) {
    for (row, factor) in matrix.chunks_exact(sum.len()).zip(vector) {
        add_scaled(sum, *factor, row);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_number_that_is_not_finite_is_found_anywhere() {
        for length in 0..11 {
            let mut values = vec![f64::MAX; length];
            assert!(all_finite(&values));
            for i in 0..length {
                for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                    let good = std::mem::replace(&mut values[i], bad);
                    assert!(!all_finite(&values), "{bad} at {i} of {length}");
                    assert!(largest(&values).is_infinite(), "{bad} at {i} of {length}");
                    values[i] = good;
                }
            }
        }
    }

    #[test]
    fn the_largest_is_found_anywhere() {
        for length in 1..11 {
            for i in 0..length {
                for value in [3.5, -3.5] {
                    let mut values = vec![-1.0; length];
                    values[i] = value;
                    assert_eq!(largest(&values).to_bits(), 3.5_f64.to_bits(), "{i} of {length}");
                }
            }
        }
    }
}
