//! The factors of small dense matrices.

use super::algebra::{add_scaled, dot};
use pinc_ad::simd::Simd;

/// L of H = L L', below and on the diagonal; its transpose is mirrored above, so that columns and
/// rows of L are both contiguous.
#[derive(Clone, Debug)]
pub(crate) struct Cholesky {
    size: usize,
    square: Vec<f64>,
    /// 1 / `L_cc`
    inverse_diagonal: Vec<f64>,
}

/// How many columns of a large matrix are eliminated between two looks at the clock.
const UNASKED: usize = 16;

/// A pivot below this part of its diagonal entry counts as 0: what is left of it is rounding.
pub(crate) const SMALLEST_PIVOT: f64 = 1e-13;

impl Cholesky {
    pub(crate) fn new(size: usize) -> Self {
        Self { size, square: vec![0.0; size * size], inverse_diagonal: vec![0.0; size] }
    }

    /// Factors H + shift I, where of H, `[n, n]`, only the lower triangle, column by column, is read;
    /// `false` if it is not positive definite.
    /// `None`: `expired` said before the end that the time is up.
    pub(crate) fn factor_within(
        &mut self,
        h: &[f64],
        shift: f64,
        expired: &mut dyn FnMut() -> bool,
    ) -> Option<bool> {
        self.square.copy_from_slice(h);
        if shift > 0.0 {
            self.square.iter_mut().step_by(self.size + 1).for_each(|entry| *entry += shift);
        }
        self.factor_columns(h, self.size, |c| c % UNASKED == UNASKED - 1 && expired())
    }

    /// Factors H without a time limit, unrolled where the caller's n is a constant.
    #[inline(always)]
    pub(crate) fn factor_sized(&mut self, h: &[f64], n: usize) -> bool {
        self.square[..n * n].copy_from_slice(&h[..n * n]);
        self.factor_columns(h, n, |_| false) == Some(true)
    }

    /// Factors what is in `square`; the pivots are compared with the diagonal of H.
    #[inline(always)]
    fn factor_columns(
        &mut self,
        h: &[f64],
        n: usize,
        mut expired: impl FnMut(usize) -> bool,
    ) -> Option<bool> {
        for c in 0..n {
            if expired(c) {
                return None;
            }
            let (left, right) = self.square.split_at_mut((c + 1) * n);
            let column = &mut left[c * n + c..];
            let pivot = column[0];
            if pivot.is_nan() || pivot <= SMALLEST_PIVOT * h[c * n + c] {
                return Some(false);
            }
            let inverse = 1.0 / pivot.sqrt();
            self.inverse_diagonal[c] = inverse;
            column.iter_mut().for_each(|entry| *entry *= inverse);
            for (i, target) in right.chunks_exact_mut(n).enumerate() {
                let factor = column[1 + i];
                target[c] = factor;
                add_scaled(&mut target[c + 1 + i..], -factor, &column[1 + i..]);
            }
        }
        Some(true)
    }

    /// v <- L^-1 v
    pub(crate) fn forward(&self, v: &mut [f64]) {
        self.forward_sized(v, self.size);
    }

    /// v <- L^-1 v, unrolled where the caller's n is a constant.
    #[inline(always)]
    pub(crate) fn forward_sized(&self, v: &mut [f64], n: usize) {
        for c in 0..n {
            let value = v[c] * self.inverse_diagonal[c];
            v[c] = value;
            let below = &self.square[c * n + c + 1..(c + 1) * n];
            add_scaled(&mut v[c + 1..], -value, below);
        }
    }

    /// V <- L^-1 V for rows in vectors, `[n, stride]`, unrolled where the caller's n is a constant.
    #[inline(always)]
    pub(crate) fn forward_rows<V: Simd>(&self, zero: V, v: &mut [f64], [n, stride]: [usize; 2]) {
        for at in (0..stride).step_by(V::LANES) {
            for r in 0..n {
                let mut row = zero.load(&v[r * stride + at..]);
                for c in 0..r {
                    let factor = zero.constant(self.square[c * n + r]);
                    row = factor.neg_mul_add(zero.load(&v[c * stride + at..]), row);
                }
                let row = row * zero.constant(self.inverse_diagonal[r]);
                row.write(&mut v[r * stride + at..]);
            }
        }
    }

    /// V <- L'^-1 V for rows in vectors, likewise.
    #[inline(always)]
    pub(crate) fn backward_rows<V: Simd>(&self, zero: V, v: &mut [f64], [n, stride]: [usize; 2]) {
        for at in (0..stride).step_by(V::LANES) {
            for r in (0..n).rev() {
                let mut row = zero.load(&v[r * stride + at..]);
                for c in r + 1..n {
                    let factor = zero.constant(self.square[r * n + c]);
                    row = factor.neg_mul_add(zero.load(&v[c * stride + at..]), row);
                }
                let row = row * zero.constant(self.inverse_diagonal[r]);
                row.write(&mut v[r * stride + at..]);
            }
        }
    }

    /// v <- L'^-1 v
    pub(crate) fn backward(&self, v: &mut [f64]) {
        self.backward_sized(v, self.size);
    }

    /// v <- L'^-1 v, unrolled where the caller's n is a constant.
    #[inline(always)]
    pub(crate) fn backward_sized(&self, v: &mut [f64], n: usize) {
        for r in (0..n).rev() {
            let value = v[r] * self.inverse_diagonal[r];
            v[r] = value;
            add_scaled(&mut v[..r], -value, &self.square[r * n..r * n + r]);
        }
    }
}

/// The thin factors Q R of a matrix that columns are appended to and removed from; Q has
/// orthonormal columns. By Gram-Schmidt, repeated where digits were lost, and Givens rotations;
/// reference: Daniel, Gragg, Kaufman and Stewart, Math. Comp. 30 (1976).
#[derive(Clone, Debug)]
pub(crate) struct ThinQr {
    size: usize,
    columns: usize,
    /// Column by column, each of length `size`.
    q: Vec<f64>,
    /// Upper triangle, column by column, each of length `size`.
    r: Vec<f64>,
}

impl ThinQr {
    pub(crate) fn new(size: usize) -> Self {
        Self { size, columns: 0, q: vec![0.0; size * size], r: vec![0.0; size * size] }
    }

    pub(crate) fn clear(&mut self) {
        self.columns = 0;
    }

    /// Splits a vector into its part in the range of Q and the rest: v = Q w + z. `z` holds v at
    /// first; gives |z|^2.
    pub(crate) fn split(&self, z: &mut [f64], w: &mut [f64]) -> f64 {
        let before = dot(z, z);
        let w = &mut w[..self.columns];
        w.fill(0.0);
        let after = self.project(z, w);
        if after < 0.25 * before { self.project(z, w) } else { after }
    }

    /// Moves what of `z` is in the range of Q to `w`; gives what |z|^2 is then.
    fn project(&self, z: &mut [f64], w: &mut [f64]) -> f64 {
        for (w, q) in w.iter_mut().zip(self.q.chunks_exact(self.size)) {
            let part = dot(q, z);
            *w += part;
            add_scaled(z, -part, q);
        }
        dot(z, z)
    }

    /// Appends the column Q w + z, where z is orthogonal to Q and |z|^2 = `squared`.
    pub(crate) fn push(&mut self, w: &[f64], z: &[f64], squared: f64) {
        let at = self.columns * self.size;
        let norm = squared.sqrt();
        let inverse = 1.0 / norm;
        for (q, z) in self.q[at..].iter_mut().zip(z) {
            *q = z * inverse;
        }
        self.r[at..at + self.columns].copy_from_slice(&w[..self.columns]);
        self.r[at + self.columns] = norm;
        self.columns += 1;
    }

    /// The length of a column.
    pub(crate) fn norm(&self, column: usize) -> f64 {
        let r = &self.r[column * self.size..=column * self.size + column];
        dot(r, r).sqrt()
    }

    /// Removes column `gone`.
    pub(crate) fn remove(&mut self, gone: usize) {
        let n = self.size;
        self.columns -= 1;
        for c in gone..self.columns {
            let (here, next) = self.r[c * n..(c + 2) * n].split_at_mut(n);
            here[..c + 2].copy_from_slice(&next[..c + 2]);
        }
        for c in gone..self.columns {
            let (a, b) = (self.r[c * n + c], self.r[c * n + c + 1]);
            let length = a.hypot(b);
            let (cosine, sine) = (a / length, b / length);
            for column in self.r[c * n..self.columns * n].chunks_exact_mut(n) {
                let (a, b) = (column[c], column[c + 1]);
                column[c] = cosine * a + sine * b;
                column[c + 1] = cosine * b - sine * a;
            }
            let (first, second) = self.q[c * n..(c + 2) * n].split_at_mut(n);
            for (a, b) in first.iter_mut().zip(second) {
                (*a, *b) = (cosine * *a + sine * *b, cosine * *b - sine * *a);
            }
        }
    }

    /// v <- R^-1 v
    pub(crate) fn solve(&self, v: &mut [f64]) {
        for c in (0..self.columns).rev() {
            let column = &self.r[c * self.size..=c * self.size + c];
            v[c] /= column[c];
            let value = v[c];
            add_scaled(&mut v[..c], -value, column);
        }
    }

    /// v <- R'^-1 v
    pub(crate) fn solve_transposed(&self, v: &mut [f64]) {
        for c in 0..self.columns {
            let column = &self.r[c * self.size..=c * self.size + c];
            v[c] = (v[c] - dot(&column[..c], &v[..c])) / column[c];
        }
    }

    /// sum += Q (s - Q' sum), so that Q' sum = s; s becomes what was missing.
    pub(crate) fn meet(&self, sum: &mut [f64], s: &mut [f64]) {
        for (s, q) in s[..self.columns].iter_mut().zip(self.q.chunks_exact(self.size)) {
            *s -= dot(q, sum);
        }
        for (s, q) in s[..self.columns].iter().zip(self.q.chunks_exact(self.size)) {
            add_scaled(sum, *s, q);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matrices_that_are_not_positive_definite_are_refused() {
        let factors = |h: [f64; 4]| Cholesky::new(2).factor_within(&h, 0.0, &mut || true);
        assert_eq!(factors([2.0, 1.0, 1.0, 2.0]), Some(true));
        assert_eq!(factors([1.0, 2.0, 2.0, 1.0]), Some(false));
        assert_eq!(factors([0.0, 0.0, 0.0, 1.0]), Some(false));
        assert_eq!(factors([1.0, 0.0, 0.0, f64::NAN]), Some(false));
        // Singular up to rounding: the second pivot is 1e-15.
        assert_eq!(factors([1.0, 1.0, 1.0, 1.0 + 1e-15]), Some(false));
        assert_eq!(factors([1.0, 1.0, 1.0, 1.0 + 1e-12]), Some(true));
    }

    #[test]
    fn a_large_matrix_is_left_when_the_time_is_up() {
        let n = 3 * UNASKED + 1;
        let mut h = vec![0.0; n * n];
        h.iter_mut().step_by(n + 1).for_each(|entry| *entry = 1.0);
        for (last, expected) in [(0, None), (2, None), (3, Some(true))] {
            let mut looks = 0;
            let mut expired = || {
                looks += 1;
                looks > last
            };
            assert_eq!(Cholesky::new(n).factor_within(&h, 0.0, &mut expired), expected, "{last}");
        }
    }
}
