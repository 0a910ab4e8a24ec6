//! Linear systems with a band of entries about the diagonal.

use pinc_ad::simd::{Isa, Simd, Task};

/// A matrix of which only a band may differ from zero, as d I - J, and its factors. A matrix without
/// zeros is a band that is as wide as itself.
///
/// ```
/// use pinc_ode::Banded;
///
/// // (0 2; 4 1) x = (2, 9)
/// let mut matrix = Banded::default();
/// matrix.clear(2, [1, 1]);
/// for (row, column, entry) in [(0, 1, 2.0), (1, 0, 4.0), (1, 1, 1.0)] {
///     matrix.add(row, column, entry);
/// }
/// assert!(matrix.factor());
/// let mut x = [2.0, 9.0];
/// matrix.solve(&mut x);
/// assert_eq!(x, [2.0, 1.0]);
/// ```
#[derive(Clone, Debug)]
pub struct Banded {
    isa: Isa,
    size: usize,
    /// Entries below the diagonal, and above it.
    below: usize,
    above: usize,
    /// Row by row, from `below` columns before the diagonal on; exchanges of rows fill `below` more
    /// columns behind the columns of `above`.
    entries: Vec<f64>,
    /// The factors below the diagonal, column by column: `[size, below]`.
    factors: Vec<f64>,
    order: Vec<usize>,
}

/// A matrix without rows.
impl Default for Banded {
    fn default() -> Self {
        let (entries, factors, order) = Default::default();
        Self { isa: Isa::detect(), size: 0, below: 0, above: 0, entries, factors, order }
    }
}

impl Banded {
    /// Takes the band from `jacobian`, of shape `[size, columns]` with `columns >= size`: it has
    /// all entries that are not zero. A band does not become narrower: an entry that vanishes at
    /// one point need not do so at the next.
    pub(crate) fn set_pattern(&mut self, jacobian: &[f64], size: usize) {
        if self.size != size {
            *self = Self { size, ..Self::default() };
        }
        let columns = jacobian.len().checked_div(size).unwrap_or(0).max(1);
        for (i, row) in jacobian.chunks_exact(columns).enumerate() {
            let row = &row[..size];
            let first = row.iter().position(|entry| *entry != 0.0).unwrap_or(i);
            let last = row.iter().rposition(|entry| *entry != 0.0).unwrap_or(i);
            self.below = self.below.max(i.saturating_sub(first));
            self.above = self.above.max(last.saturating_sub(i));
        }
    }

    /// Entries of a row, with room for those that exchanges fill.
    fn width(&self) -> usize {
        2 * self.below + self.above + 1
    }

    /// What a factorization costs beside an evaluation of the equation, roughly: one for every ten
    /// entries of a band.
    pub(crate) fn cost(&self) -> f64 {
        0.1 * self.below as f64
    }

    /// Makes this the matrix 0 with `size` rows and a band of so many entries below and above the
    /// diagonal.
    pub fn clear(&mut self, size: usize, [below, above]: [usize; 2]) {
        (self.size, self.below, self.above) = (size, below, above);
        self.clear_entries();
    }

    fn clear_entries(&mut self) {
        let count = self.size * self.width();
        self.entries.clear();
        self.entries.resize(count, 0.0);
        self.factors.resize(self.size * self.below, 0.0);
        self.order.resize(self.size, 0);
    }

    /// Adds to an entry within the band.
    pub fn add(&mut self, row: usize, column: usize, value: f64) {
        let at = row * self.width() + column + self.below - row;
        self.entries[at] += value;
    }

    /// Factorizes `diagonal` I - `jacobian` with exchange of rows. Says whether it is regular and
    /// finite.
    pub(crate) fn factorize(&mut self, jacobian: &[f64], diagonal: f64) -> bool {
        let (n, below, width) = (self.size, self.below, self.width());
        let columns = jacobian.len().checked_div(n).unwrap_or(0);
        self.clear_entries();
        for i in 0..n {
            let row = &jacobian[i * columns..][..n];
            let range = i.saturating_sub(below)..n.min(i + self.above + 1);
            for j in range {
                self.entries[i * width + j + below - i] = -row[j];
            }
            self.entries[i * width + below] += diagonal;
        }
        self.factor()
    }

    /// Replaces the entries by the factors, with exchange of rows. Returns whether the matrix is
    /// regular and finite.
    pub fn factor(&mut self) -> bool {
        self.isa.dispatch(Factor(self))
    }

    /// Returns the largest absolute reciprocal of the factors' pivots: infinite or large for a
    /// matrix that is close to singular.
    #[must_use]
    pub fn largest_reciprocal(&self) -> f64 {
        let pivots = self.entries.iter().skip(self.below).step_by(self.width());
        pivots.fold(0.0, |most: f64, pivot| most.max(pivot.abs()))
    }

    /// Column `k`; the pivot is replaced by its reciprocal.
    #[inline(always)]
    fn eliminate(&mut self, k: usize) -> bool {
        let (n, below, width) = (self.size, self.below, self.width());
        // Column j of row i is at i * width + j + below - i.
        let place = |i: usize, j: usize| i * width + j + below - i;
        let end = n.min(k + below + 1);
        let size = |i: &usize| self.entries[place(*i, k)].abs();
        let pivot = (k..end).max_by(|a, b| size(a).total_cmp(&size(b))).unwrap_or(k);
        let last = n.min(k + self.above + below + 1);
        self.order[k] = pivot;
        if pivot != k {
            for j in k..last {
                self.entries.swap(place(k, j), place(pivot, j));
            }
        }
        let inverse = 1.0 / self.entries[place(k, k)];
        if !inverse.is_finite() {
            return false;
        }
        self.entries[place(k, k)] = inverse;
        for i in k + 1..end {
            let factor = self.entries[place(i, k)] * inverse;
            self.factors[k * below + i - k - 1] = factor;
            if factor != 0.0 {
                let (upper, lower) = self.entries.split_at_mut(i * width);
                let from = &upper[place(k, k + 1)..=place(k, last - 1).max(place(k, k))];
                let to = &mut lower[k + 1 + below - i..];
                to.iter_mut().zip(from).for_each(|(to, from)| *to -= factor * from);
            }
        }
        true
    }

    /// Solves with the factors: `b`, of length `size`, becomes the solution.
    pub fn solve(&self, b: &mut [f64]) {
        self.isa.dispatch(Solve(self, b));
    }
}

/// [`Banded::factor`].
struct Factor<'a>(&'a mut Banded);

impl Task for Factor<'_> {
    type Output = bool;

    #[inline(always)]
    fn run<V: Simd>(self, _: V) -> bool {
        (0..self.0.size).all(|k| self.0.eliminate(k))
    }
}

/// [`Banded::solve`].
struct Solve<'a>(&'a Banded, &'a mut [f64]);

impl Task for Solve<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Simd>(self, _: V) {
        let Self(Banded { size, below, above, entries, factors, order, .. }, b) = self;
        let (n, below, reach) = (*size, *below, above + below);
        for (k, &pivot) in order.iter().enumerate() {
            b.swap(k, pivot);
            let (known, rest) = b[k..].split_at_mut(1);
            let factors = &factors[k * below..(k + 1) * below];
            rest.iter_mut().zip(factors).for_each(|(to, factor)| *to -= factor * known[0]);
        }
        for (i, row) in entries.chunks_exact(below + reach + 1).enumerate().rev() {
            let (pivot, right) = (row[below], &row[below + 1..]);
            let right = &right[..reach.min(n - 1 - i)];
            b[i] = (b[i] - dot(right, &b[i + 1..])) * pivot;
        }
    }
}

/// The sum of the products, in eight parts that a vector can have side by side.
#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<8>(), b[..a.len()].as_chunks::<8>());
    let mut sums = [0.0; 8];
    for (a, b) in a.iter().zip(b) {
        (0..8).for_each(|lane| sums[lane] += a[lane] * b[lane]);
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use super::Banded;

    /// Numbers in [-1, 1) that look random.
    fn number(k: usize) -> f64 {
        let k = u32::try_from(k).unwrap();
        (f64::from(k) * 0.618_033_988_75 + f64::from(k * k % 101) * 0.37).fract() * 2.0 - 1.0
    }

    /// d I - J times the solution is the right-hand side, for bands of all widths, also where rows
    /// have to be exchanged, and with columns of inputs behind the columns of states.
    #[test]
    fn solutions_satisfy_their_systems() {
        for (n, below, above) in [(1, 0, 0), (5, 1, 1), (12, 3, 1), (12, 0, 4), (9, 8, 8)] {
            for diagonal in [0.0, 1e-3, 1.0, 1e6] {
                let columns = n + 2;
                let mut jacobian = vec![0.0; n * columns];
                for i in 0..n {
                    for j in 0..columns {
                        if j >= n || (j + below >= i && j <= i + above) {
                            jacobian[i * columns + j] = number(i * columns + j + 1);
                        }
                    }
                }
                let mut band = Banded::default();
                band.set_pattern(&jacobian, n);
                assert!(band.factorize(&jacobian, diagonal), "{n} {below} {above} {diagonal}");
                let b: Vec<f64> = (0..n).map(|i| number(100 + i)).collect();
                let mut x = b.clone();
                band.solve(&mut x);
                let largest = x.iter().fold(1.0_f64, |m, v| m.max(v.abs())) * (1.0 + diagonal);
                for i in 0..n {
                    let row: f64 = (0..n).map(|j| jacobian[i * columns + j] * x[j]).sum();
                    let left = diagonal * x[i] - row - b[i];
                    assert!(left.abs() < 1e-13 * largest, "{n} {below} {above} {diagonal} {left}");
                }
            }
        }
    }

    #[test]
    fn a_singular_matrix_is_reported() {
        let mut band = Banded::default();
        band.set_pattern(&[1.0, 0.0, 0.0, 2.0], 2);
        assert!(!band.factorize(&[1.0, 0.0, 0.0, 2.0], 1.0));
    }
}
