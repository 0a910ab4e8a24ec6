//! Least squares row by row: the triangular factor of a QR decomposition that takes further rows.

/// How many rows are gathered before they are worked into the triangle.
const GATHERED: usize = 96;

/// The triangular factor R of rows with `width` columns that were pushed: R'R is the sum of the
/// squares of the rows. The last column usually has the residuals.
#[derive(Clone, Debug)]
pub(crate) struct Triangle {
    width: usize,
    /// Rows of which the first `width`, or fewer, are the triangle.
    rows: Vec<f64>,
    count: usize,
    /// The vector of a reflection.
    product: Vec<f64>,
}

impl Triangle {
    pub(crate) fn new(width: usize) -> Self {
        let rows = Vec::with_capacity((width + GATHERED) * width);
        Self { width, rows, count: 0, product: vec![0.0; width] }
    }

    pub(crate) fn width(&self) -> usize {
        self.width
    }

    pub(crate) fn clear(&mut self) {
        self.rows.clear();
        self.count = 0;
    }

    /// A further row, of zeros, to be written.
    pub(crate) fn push(&mut self) -> &mut [f64] {
        if self.count == self.width + GATHERED {
            self.triangularize();
        }
        let begin = self.rows.len();
        self.rows.resize(begin + self.width, 0.0);
        self.count += 1;
        &mut self.rows[begin..]
    }

    /// The upper triangle, `[width, width]`, row by row.
    pub(crate) fn factor(&mut self) -> &[f64] {
        self.triangularize();
        self.rows.resize(self.width * self.width, 0.0);
        self.count = self.width;
        &self.rows
    }

    /// The factor, to be changed.
    pub(crate) fn factor_mut(&mut self) -> &mut [f64] {
        self.factor();
        &mut self.rows
    }

    /// The rows that have been worked in.
    pub(crate) fn finished(&self) -> &[f64] {
        &self.rows
    }

    /// Householder reflections, one per column, of all rows.
    fn triangularize(&mut self) {
        let (width, count) = (self.width, self.count);
        for column in 0..width.min(count) {
            let below = &mut self.rows[column * width..count * width];
            reflect(below, width, column, &mut self.product);
        }
        self.count = count.min(width);
        self.rows.truncate(self.count * width);
    }
}

/// Makes the entries of `column` 0 in all rows but the first, by a reflection of the columns from
/// there on.
fn reflect(rows: &mut [f64], width: usize, column: usize, product: &mut [f64]) {
    let largest = rows.chunks_exact(width).fold(0.0, |m: f64, row| m.max(row[column].abs()));
    let (first, others) = rows.split_at_mut(width);
    if others.chunks_exact(width).all(|row| row[column] == 0.0) {
        return;
    }
    // The square of the largest entry may not be a number: they are scaled.
    let scaled = |row: &[f64]| (row[column] / largest).powi(2);
    let squares = scaled(first) + others.chunks_exact(width).map(scaled).sum::<f64>();
    let alpha = -first[column].signum() * largest * squares.sqrt();
    let head = first[column] - alpha;
    // v = (1, entries / head), H = I - tau v v'.
    let tau = -head / alpha;
    let product = &mut product[column + 1..];
    product.copy_from_slice(&first[column + 1..]);
    for row in others.chunks_exact_mut(width) {
        row[column] /= head;
        let v = row[column];
        product.iter_mut().zip(&row[column + 1..]).for_each(|(sum, a)| *sum += v * a);
    }
    first[column] = alpha;
    first[column + 1..].iter_mut().zip(&*product).for_each(|(a, sum)| *a -= tau * sum);
    for row in others.chunks_exact_mut(width) {
        let v = tau * row[column];
        row[column] = 0.0;
        row[column + 1..].iter_mut().zip(&*product).for_each(|(a, sum)| *a -= v * sum);
    }
}

/// Solves R x + c = 0 for the upper left triangle of `n` columns of rows with `width` columns; `c`
/// is replaced by x.
pub(crate) fn solve(rows: &[f64], width: usize, n: usize, c: &mut [f64]) {
    for i in (0..n).rev() {
        let row = &rows[i * width..i * width + n];
        let known: f64 = row[i + 1..].iter().zip(&c[i + 1..n]).map(|(r, x)| r * x).sum();
        c[i] = -(c[i] + known) / row[i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// R'R is A'A, however many rows A has.
        #[test]
        fn the_factor_has_the_squares_of_the_rows(
            (width, entries) in (1_usize..6, prop::collection::vec(-3.0..3.0_f64, 0..1400)),
        ) {
            let mut triangle = Triangle::new(width);
            let rows: Vec<_> = entries.chunks_exact(width).collect();
            rows.iter().for_each(|row| triangle.push().copy_from_slice(row));
            let r = triangle.factor().to_vec();
            for i in 0..width {
                for j in 0..width {
                    let expected: f64 = rows.iter().map(|row| row[i] * row[j]).sum();
                    let found: f64 = (0..width).map(|k| r[k * width + i] * r[k * width + j]).sum();
                    prop_assert!((found - expected).abs() <= 1e-11 * (1.0 + rows.len() as f64));
                    prop_assert!(j >= i || r[i * width + j] == 0.0);
                }
            }
        }
    }

    #[test]
    fn a_triangle_is_solved() {
        let rows = [2.0, 1.0, 9.0, 0.0, 4.0, 9.0];
        let mut c = [-5.0, -8.0];
        solve(&rows, 3, 2, &mut c);
        assert_eq!(c.map(f64::to_bits), [1.5, 2.0].map(f64::to_bits));
    }
}
