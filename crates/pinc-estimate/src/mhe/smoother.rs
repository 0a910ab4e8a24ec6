//! The linearized problem of a window in which no bound holds anything.

use crate::matrix::{add_scaled, dot};
use pinc_ode::Dims;

/// The solution of
///
/// ```text
/// min  sum_j |w_j|^2 / 2 + sum_j |(e_j + H_j d_j) / r|^2 / 2
/// s.t. d_0 = r_0 + B_0 w_0,  d_j = A_j d_(j-1) + r_j + B_j w_j
/// ```
///
/// by a Kalman filter through the stages and the smoother of Bryson and Frazier back, whose adjoint
/// variables are the multipliers of the equations. It inverts no covariance, so that noises may be
/// 0, and takes as long as a few steps of the filter.
///
/// Reference: Bierman, *Factorization Methods for Discrete Sequential Estimation*, chapter X.
#[derive(Clone, Debug)]
pub(super) struct Smoother {
    n: usize,
    ny: usize,
    /// What is expected of each stage before its measurements, `[stages, n]`, and its covariance,
    /// `[stages, n, n]`.
    mean: Vec<f64>,
    covariance: Vec<f64>,
    /// The gain of each measurement, `[stages, ny, n]`, and its innovation divided by the
    /// innovation's variance.
    gain: Vec<f64>,
    weighted: Vec<f64>,
    /// Those after the measurements.
    p: Vec<f64>,
    m: Vec<f64>,
    product: Vec<f64>,
}

/// A problem; blocks stage by stage, row by row.
#[derive(Clone, Copy, Debug)]
pub(super) struct Linear<'a> {
    /// A, `[stages, n, n]`; the first is not used.
    pub(super) a: &'a [f64],
    /// B, `[stages, n, n]`: the first a lower triangle, the others diagonal.
    pub(super) b: &'a [f64],
    /// r, `[stages, n]`.
    pub(super) defects: &'a [f64],
    /// H, `[stages, ny, n]`.
    pub(super) h: &'a [f64],
    /// e, `[stages, ny]`: expected minus measured, NaN where nothing was.
    pub(super) errors: &'a [f64],
    /// The variances of the measurements, `ny`.
    pub(super) variances: &'a [f64],
}

impl Smoother {
    pub(super) fn new(dims: Dims, stages: usize) -> Self {
        let (n, ny) = (dims.nx, dims.ny);
        Self {
            n,
            ny,
            mean: vec![0.0; stages * n],
            covariance: vec![0.0; stages * n * n],
            gain: vec![0.0; stages * ny * n],
            weighted: vec![0.0; stages * ny],
            p: vec![0.0; n * n],
            m: vec![0.0; n],
            product: vec![0.0; n * n],
        }
    }

    /// Writes the states d, `[stages, n]`, the noises w, `[stages, n]`, and the multipliers of the
    /// equations, `[stages, n]`.
    pub(super) fn solve(&mut self, of: Linear<'_>, d: &mut [f64], w: &mut [f64], l: &mut [f64]) {
        // With constants the loops are unrolled.
        match self.n {
            2 => self.solve_with(of, [d, w, l], 2),
            4 => self.solve_with(of, [d, w, l], 4),
            6 => self.solve_with(of, [d, w, l], 6),
            n => self.solve_with(of, [d, w, l], n),
        }
    }

    #[inline(always)]
    fn solve_with(&mut self, of: Linear<'_>, [d, w, l]: [&mut [f64]; 3], n: usize) {
        let stages = d.len() / n;
        for j in 0..stages {
            self.expect(of, j, n);
            self.measure(of, j, n);
        }
        // The adjoint variable, from behind; stage j gets what the stages after it leave.
        self.m[..n].fill(0.0);
        for j in (0..stages).rev() {
            for i in (0..self.ny).rev() {
                let weighted = self.weighted[j * self.ny + i];
                if !weighted.is_nan() {
                    let (gain, h) = (self.row(&self.gain, j, i, n), self.row(of.h, j, i, n));
                    let factor = dot(gain, &self.m[..n]) + weighted;
                    add_scaled(&mut self.m[..n], -factor, h);
                }
            }
            let lambda = &mut l[j * n..(j + 1) * n];
            lambda.copy_from_slice(&self.m[..n]);
            let (d, w) = (&mut d[j * n..(j + 1) * n], &mut w[j * n..(j + 1) * n]);
            let p = &self.covariance[j * n * n..(j + 1) * n * n];
            d.copy_from_slice(&self.mean[j * n..(j + 1) * n]);
            w.fill(0.0);
            let b = &of.b[j * n * n..(j + 1) * n * n];
            for (i, lambda) in lambda.iter().enumerate() {
                add_scaled(d, -lambda, &p[i * n..(i + 1) * n]);
                if j == 0 {
                    add_scaled(w, -lambda, &b[i * n..(i + 1) * n]);
                } else {
                    w[i] = -lambda * b[i * n + i];
                }
            }
            self.m[..n].fill(0.0);
            let a = &of.a[j * n * n..(j + 1) * n * n];
            for (lambda, a) in lambda.iter().zip(a.chunks_exact(n)) {
                add_scaled(&mut self.m[..n], *lambda, a);
            }
        }
    }

    /// What is expected of stage `j`.
    #[inline(always)]
    fn expect(&mut self, of: Linear<'_>, j: usize, n: usize) {
        let mean = &mut self.mean[j * n..(j + 1) * n];
        let next = &mut self.covariance[j * n * n..(j + 1) * n * n];
        let b = &of.b[j * n * n..(j + 1) * n * n];
        mean.copy_from_slice(&of.defects[j * n..(j + 1) * n]);
        // The rows of B_0, or of A P; their products with the rows of B_0 or A are the covariance.
        let (left, right) = if j == 0 {
            (b, b)
        } else {
            let a = &of.a[j * n * n..(j + 1) * n * n];
            let product = &mut self.product[..n * n];
            product.fill(0.0);
            for ((row, a), mean) in product.chunks_exact_mut(n).zip(a.chunks_exact(n)).zip(mean) {
                *mean += dot(a, &self.m[..n]);
                for (factor, p) in a.iter().zip(self.p[..n * n].chunks_exact(n)) {
                    add_scaled(row, *factor, p);
                }
            }
            (&*product, a)
        };
        for i in 0..n {
            for k in 0..=i {
                let entry = dot(&left[i * n..(i + 1) * n], &right[k * n..(k + 1) * n]);
                next[i * n + k] = entry;
                next[k * n + i] = entry;
            }
            if j > 0 {
                next[i * n + i] += b[i * n + i] * b[i * n + i];
            }
        }
    }

    /// Corrects with the measurements of stage `j`, one after the other.
    #[inline(always)]
    fn measure(&mut self, of: Linear<'_>, j: usize, n: usize) {
        let ny = self.ny;
        self.m[..n].copy_from_slice(&self.mean[j * n..(j + 1) * n]);
        self.p[..n * n].copy_from_slice(&self.covariance[j * n * n..(j + 1) * n * n]);
        for i in 0..ny {
            let h = &of.h[(j * ny + i) * n..(j * ny + i + 1) * n];
            let error = of.errors[j * ny + i];
            if error.is_nan() {
                self.weighted[j * ny + i] = f64::NAN;
                continue;
            }
            let gain = &mut self.gain[(j * ny + i) * n..(j * ny + i + 1) * n];
            gain.fill(0.0);
            for (h, p) in h.iter().zip(self.p[..n * n].chunks_exact(n)) {
                add_scaled(gain, *h, p);
            }
            let variance = dot(h, gain) + of.variances[i];
            let innovation = -(error + dot(h, &self.m[..n]));
            let weighted = innovation / variance;
            self.weighted[j * ny + i] = weighted;
            add_scaled(&mut self.m[..n], weighted, gain);
            let by = 1.0 / variance;
            for (row, along) in self.p[..n * n].chunks_exact_mut(n).zip(&*gain) {
                add_scaled(row, -along * by, gain);
            }
            gain.iter_mut().for_each(|gain| *gain *= by);
        }
    }

    /// Row `i` of stage `j` of measurements.
    #[inline(always)]
    fn row<'r>(&self, rows: &'r [f64], j: usize, i: usize, n: usize) -> &'r [f64] {
        let first = (j * self.ny + i) * n;
        &rows[first..first + n]
    }
}
