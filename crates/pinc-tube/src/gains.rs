//! The feedback along a plan.

use crate::matrix::{dot, multiply, multiply_transposed};
use crate::{AlongPlan, Feedback};
use pinc_ode::Dims;

/// K at each stage, `[N, m, n]`. The first is 0: the input applied now does not wait for what the
/// plant does.
#[derive(Debug)]
pub(crate) struct Gains {
    feedback: Feedback,
    pub(crate) k: Vec<f64>,
    dims: [usize; 2],
    /// S, `[n, n]`, of the cost to go, and the next.
    s: [Vec<f64>; 2],
    /// S A and S B.
    sa: Vec<f64>,
    sb: Vec<f64>,
    /// A' S B, `[n, m]`.
    l: Vec<f64>,
    /// I + B' S B, `[m, m]`, and its Cholesky factor in the lower half.
    h: Vec<f64>,
}

impl Gains {
    pub(crate) fn new(feedback: Feedback, Dims { nx: n, nu: m, .. }: Dims, stages: usize) -> Self {
        let mut k = vec![0.0; stages * m * n];
        if let Feedback::Given(gain) = &feedback {
            k.chunks_exact_mut(m * n).skip(1).for_each(|k| k.copy_from_slice(gain));
        }
        Self {
            feedback,
            k,
            dims: [n, m],
            s: [vec![0.0; n * n], vec![0.0; n * n]],
            sa: vec![0.0; n * n],
            sb: vec![0.0; n * m],
            l: vec![0.0; n * m],
            h: vec![0.0; m * m],
        }
    }

    /// K of a stage.
    pub(crate) fn stage(&self, j: usize) -> &[f64] {
        let size = self.sb.len();
        &self.k[j * size..(j + 1) * size]
    }

    /// The gains along a plan, backwards:
    ///
    /// ```text
    /// S_N = I,  K = -(I + B' S B)^-1 B' S A,  S <- I + A' S A + A' S B K
    /// ```
    pub(crate) fn follow(&mut self, along: AlongPlan<'_>) {
        if self.feedback != Feedback::Riccati {
            return;
        }
        let Self { k, dims: [n, m], s: [s, next], sa, sb, l, h, .. } = self;
        let (n, m) = (*n, *m);
        s.fill(0.0);
        add_identity(s, n);
        for j in (1..along.stages()).rev() {
            let (_, [a, b]) = along.stage(j);
            let k = &mut k[j * m * n..(j + 1) * m * n];
            multiply(s, a, n, n, sa);
            multiply(s, b, n, m, sb);
            multiply_transposed(b, sb, [m, m], h);
            add_identity(h, m);
            // S is symmetric: B' S A = (S B)' A.
            multiply_transposed(sb, a, [m, n], k);
            factor(h, m);
            solve(h, m, k, n);
            multiply_transposed(a, sa, [n, n], next);
            add_identity(next, n);
            // L = (S B)' A is (I + B' S B) times -K, and L' = A' (S B).
            multiply_transposed(a, sb, [n, m], l);
            for (next, l) in next.chunks_exact_mut(n).zip(l.chunks_exact(m)) {
                for (l, k) in l.iter().zip(k.chunks_exact(n)) {
                    next.iter_mut().zip(k).for_each(|(next, k)| *next += l * k);
                }
            }
            std::mem::swap(s, next);
        }
    }
}

/// The Cholesky factor of a positive definite matrix, in its lower half.
fn factor(h: &mut [f64], m: usize) {
    for i in 0..m {
        for j in 0..=i {
            let sum = dot(&h[i * m..i * m + j], &h[j * m..j * m + j]);
            let rest = h[i * m + j] - sum;
            h[i * m + j] = if i == j { rest.sqrt() } else { rest / h[j * m + j] };
        }
    }
}

/// Replaces L, `[m, n]`, by -H^-1 L for a factored H.
fn solve(h: &[f64], m: usize, l: &mut [f64], n: usize) {
    for column in 0..n {
        for i in 0..m {
            let sum: f64 = (0..i).map(|j| h[i * m + j] * l[j * n + column]).sum();
            l[i * n + column] = (l[i * n + column] - sum) / h[i * m + i];
        }
        for i in (0..m).rev() {
            let sum: f64 = (i + 1..m).map(|j| h[j * m + i] * l[j * n + column]).sum();
            l[i * n + column] = (l[i * n + column] - sum) / h[i * m + i];
        }
        (0..m).for_each(|i| l[i * n + column] = -l[i * n + column]);
    }
}

/// Adds the identity to a matrix, `[n, n]`.
fn add_identity(matrix: &mut [f64], n: usize) {
    matrix.iter_mut().step_by(n + 1).for_each(|diagonal| *diagonal += 1.0);
}
