//! Systems of linear equations over numbers with derivatives.
//!
//! A plant has a handful of states, and the entries of its matrix carry derivatives, which
//! libraries of linear algebra do not factor: so the elimination stands here.

use pinc_ad::{Dual, Scalar};

/// A number whose size can be asked for, so that rows can be exchanged.
pub(crate) trait Pivot: Scalar {
    /// The magnitude of its value.
    fn magnitude(self) -> f64;
}

impl Pivot for f64 {
    #[inline(always)]
    fn magnitude(self) -> f64 {
        self.abs()
    }
}

impl<const N: usize> Pivot for Dual<f64, N> {
    #[inline(always)]
    fn magnitude(self) -> f64 {
        self.re.abs()
    }
}

/// Factorises the matrix `a` of shape `[n, n]` in place, with exchange of rows: row i becomes the
/// `order[i]`-th of those before. The diagonal is replaced by its reciprocals. A singular matrix
/// gives numbers that are not finite.
#[inline(always)]
pub(crate) fn factorize<S: Pivot>(a: &mut [S], order: &mut [usize]) {
    let n = order.len();
    for k in 0..n {
        let mut pivot = k;
        for i in k + 1..n {
            if a[i * n + k].magnitude() > a[pivot * n + k].magnitude() {
                pivot = i;
            }
        }
        order[k] = pivot;
        if pivot != k {
            for j in 0..n {
                a.swap(k * n + j, pivot * n + j);
            }
        }
        let inverse = a[k * n + k].constant(1.0) / a[k * n + k];
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
#[inline(always)]
pub(crate) fn solve<S: Pivot>(a: &[S], order: &[usize], b: &mut [S]) {
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
        b[i] = b[i] * a[i * n + i];
    }
}

#[cfg(test)]
mod tests {
    use super::{factorize, solve};
    use pinc_ad::Dual;

    /// The matrix has a zero where the first pivot would be. A x = b has the solution (1, 2, 3);
    /// moving b along A (1, 1, 1) moves it along (1, 1, 1), and moving the first entry by e along
    /// the solution of A d = (-1, 0, 0) e.
    #[test]
    fn rows_are_exchanged_and_derivatives_follow() {
        let rows = [0.0, 2.0, 1.0, 4.0, 1.0, 0.0, 1.0, 0.0, 2.0];
        let mut a = rows.map(Dual::<f64, 2>::lift);
        a[0] = Dual::variable(0.0, 1);
        let along =
            |v: [f64; 3]| [0, 1, 2].map(|i| (0..3).map(|j| rows[i * 3 + j] * v[j]).sum::<f64>());
        let (b, step) = (along([1.0, 2.0, 3.0]), along([1.0, 1.0, 1.0]));
        let mut x = [0, 1, 2].map(|i| Dual { re: b[i], eps: [step[i], 0.0] });
        let mut order = [0; 3];
        factorize(&mut a, &mut order);
        solve(&a, &order, &mut x);
        let moved = along(x.map(|x| x.eps[1]));
        for i in 0..3 {
            let expected = [1.0, 2.0, 3.0][i];
            assert!((x[i].re - expected).abs() < 1e-14, "{x:?}");
            assert!((x[i].eps[0] - 1.0).abs() < 1e-14, "{x:?}");
            assert!((moved[i] + [1.0, 0.0, 0.0][i]).abs() < 1e-14, "{x:?}");
        }
    }
}
