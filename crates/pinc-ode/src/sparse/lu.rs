//! Systems of linear equations with exchange of rows.

/// Factorises the matrix `a` of shape `[n, n]` in place, with exchange of rows: row i becomes the
/// `order[i]`-th of those before. The diagonal is replaced by its reciprocals. A singular matrix
/// gives numbers that are not finite.
pub(super) fn factorize(a: &mut [f64], order: &mut [usize]) {
    let n = order.len();
    for k in 0..n {
        let mut pivot = k;
        for i in k + 1..n {
            if a[i * n + k].abs() > a[pivot * n + k].abs() {
                pivot = i;
            }
        }
        order[k] = pivot;
        if pivot != k {
            for j in 0..n {
                a.swap(k * n + j, pivot * n + j);
            }
        }
        let inverse = 1.0 / a[k * n + k];
        a[k * n + k] = inverse;
        for i in k + 1..n {
            let factor = a[i * n + k] * inverse;
            a[i * n + k] = factor;
            for j in k + 1..n {
                a[i * n + j] = (-factor).mul_add(a[k * n + j], a[i * n + j]);
            }
        }
    }
}

/// Solves with the factors of [`factorize`]: `b` becomes the solution.
pub(super) fn solve(a: &[f64], order: &[usize], b: &mut [f64]) {
    let n = order.len();
    for (k, &pivot) in order.iter().enumerate() {
        b.swap(k, pivot);
    }
    for i in 1..n {
        for j in 0..i {
            b[i] = (-a[i * n + j]).mul_add(b[j], b[i]);
        }
    }
    for i in (0..n).rev() {
        for j in i + 1..n {
            b[i] = (-a[i * n + j]).mul_add(b[j], b[i]);
        }
        b[i] *= a[i * n + i];
    }
}

/// Solves with the transposed matrix: `b` becomes the solution.
pub(super) fn solve_transposed(a: &[f64], order: &[usize], b: &mut [f64]) {
    let n = order.len();
    for i in 0..n {
        b[i] *= a[i * n + i];
        for j in i + 1..n {
            b[j] = (-a[i * n + j]).mul_add(b[i], b[j]);
        }
    }
    for i in (1..n).rev() {
        for j in 0..i {
            b[j] = (-a[i * n + j]).mul_add(b[i], b[j]);
        }
    }
    for (k, &pivot) in order.iter().enumerate().rev() {
        b.swap(k, pivot);
    }
}

#[cfg(test)]
mod tests {
    use super::{factorize, solve, solve_transposed};

    /// The matrix has a zero where the first pivot would be. A x = b has the solution (1, 2, 3).
    #[test]
    fn rows_are_exchanged() {
        let mut a = [0.0, 2.0, 1.0, 4.0, 1.0, 0.0, 1.0, 0.0, 2.0];
        let (mut x, mut order) = ([7.0, 6.0, 7.0], [0; 3]);
        factorize(&mut a, &mut order);
        solve(&a, &order, &mut x);
        // A'x = b.
        let mut transposed = [11.0, 4.0, 7.0];
        solve_transposed(&a, &order, &mut transposed);
        for (x, expected) in x.into_iter().chain(transposed).zip([1.0_f64, 2.0, 3.0].repeat(2)) {
            assert!((x - expected).abs() < 1e-14, "{x}");
        }
    }
}
