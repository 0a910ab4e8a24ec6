//! Products and factors of small matrices, stored row by row.

/// a'b
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// sum += factor vector
pub(crate) fn add_scaled(sum: &mut [f64], factor: f64, vector: &[f64]) {
    for (sum, entry) in sum.iter_mut().zip(vector) {
        *sum += factor * entry;
    }
}

/// Writes M v into `product`; `m`: `[product.len(), v.len()]`.
pub(crate) fn multiply(m: &[f64], v: &[f64], product: &mut [f64]) {
    for (to, row) in product.iter_mut().zip(m.chunks_exact(v.len())) {
        *to = dot(row, v);
    }
}

/// Writes A P A' + diag(q) into `p`, for a symmetric `p` of size `q.len()`; `work` is as large.
pub(crate) fn propagate(a: &[f64], q: &[f64], p: &mut [f64], work: &mut [f64]) {
    let n = q.len();
    for (row, a) in work.chunks_exact_mut(n).zip(a.chunks_exact(n)) {
        row.fill(0.0);
        for (factor, p) in a.iter().zip(p.chunks_exact(n)) {
            // In an augmented model, a good part of A is 0.
            if *factor != 0.0 {
                add_scaled(row, *factor, p);
            }
        }
    }
    for i in 0..n {
        for j in 0..=i {
            let entry = dot(&work[i * n..(i + 1) * n], &a[j * n..(j + 1) * n]);
            p[i * n + j] = entry;
            p[j * n + i] = entry;
        }
        p[i * n + i] += q[i];
    }
}

/// A pivot below this part of its diagonal entry counts as 0: what is left of it is rounding.
const ROUNDING: f64 = 1e-14;
/// A pivot that is negative by more than this part of its diagonal entry is no rounding.
const INDEFINITE: f64 = 1e-9;

/// Factors the symmetric and positive semidefinite P = L L', of size `n`, into the lower triangle
/// `l`, whose other entries become 0. `false` if it has a negative eigenvalue beyond rounding, or
/// numbers that are not finite.
pub(crate) fn factor(p: &[f64], n: usize, l: &mut [f64]) -> bool {
    l.fill(0.0);
    for j in 0..n {
        let (above, below) = l.split_at_mut(j * n);
        let row = &mut below[..n];
        for i in 0..j {
            let other = &above[i * n..(i + 1) * n];
            let rest = p[j * n + i] - dot(&row[..i], &other[..i]);
            row[i] = if other[i] > 0.0 { rest / other[i] } else { 0.0 };
        }
        let diagonal = p[j * n + j];
        let pivot = diagonal - dot(&row[..j], &row[..j]);
        if !pivot.is_finite() || pivot < -INDEFINITE * diagonal.abs() || diagonal < 0.0 {
            return false;
        }
        row[j] = if pivot > ROUNDING * diagonal { pivot.sqrt() } else { 0.0 };
    }
    true
}

/// v <- L^-1 v, for a lower triangle L with a positive diagonal.
pub(crate) fn solve_lower(l: &[f64], v: &mut [f64]) {
    let n = v.len();
    for i in 0..n {
        let row = &l[i * n..(i + 1) * n];
        v[i] = (v[i] - dot(&row[..i], &v[..i])) / row[i];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(found: &[f64], expected: &[f64]) {
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12, "{found} is not {expected}");
        }
    }

    #[test]
    fn a_factor_is_a_root() {
        let p = [4.0, 2.0, 1.0, 2.0, 5.0, 3.0, 1.0, 3.0, 6.0];
        let mut l = [9.0; 9];
        assert!(factor(&p, 3, &mut l));
        let mut product = p;
        let (mut identity, mut work) = ([0.0; 9], [0.0; 9]);
        (0..3).for_each(|i| identity[4 * i] = 1.0);
        propagate(&l, &[0.0; 3], &mut identity, &mut work);
        product.copy_from_slice(&identity);
        close(&product, &p);
        let mut v = [2.0, 6.0, 9.0];
        solve_lower(&l, &mut v);
        let mut back = [0.0; 3];
        multiply(&l, &v, &mut back);
        close(&back, &[2.0, 6.0, 9.0]);
    }

    #[test]
    fn a_semidefinite_matrix_has_a_factor_and_an_indefinite_one_has_none() {
        let mut l = [0.0; 4];
        assert!(factor(&[4.0, 2.0, 2.0, 1.0], 2, &mut l));
        close(&l, &[2.0, 0.0, 1.0, 0.0]);
        assert!(factor(&[0.0, 0.0, 0.0, 1.0], 2, &mut l));
        assert!(!factor(&[4.0, 3.0, 3.0, 1.0], 2, &mut l));
        assert!(!factor(&[f64::NAN, 0.0, 0.0, 1.0], 2, &mut l));
        assert!(!factor(&[1.0, 0.0, 0.0, f64::INFINITY], 2, &mut l));
        assert!(!factor(&[-1.0, 0.0, 0.0, 1.0], 2, &mut l));
    }

    #[test]
    fn a_covariance_is_propagated() {
        let mut p = [2.0, 1.0, 1.0, 3.0];
        propagate(&[1.0, 1.0, 0.0, 2.0], &[0.5, 0.25], &mut p, &mut [0.0; 4]);
        close(&p, &[7.5, 8.0, 8.0, 12.25]);
    }
}
