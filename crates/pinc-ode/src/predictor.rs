//! The one interface between models and controllers.

use std::fmt::Debug;

/// The numbers of states `n` and inputs `m`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dims {
    /// `n`
    pub states: usize,
    /// `m`
    pub inputs: usize,
}

/// A discrete-time model x\[k+1\] = f(x\[k\], u\[k\]), with u held over the step: the control interface of
/// the paper, Eq. (interface).
///
/// A predictor owns its workspace: neither method allocates, and both give the same bits for the
/// same arguments. Where the model has no value they give NaN; they do not panic on it.
///
/// # Shapes
///
/// `x`, `next`: `n`; `u`: `m`; `a`: `[n, n]`, `b`: `[n, m]`, both row by row:
/// `a[i*n + j] = df_i/dx_j`, `b[i*m + j] = df_i/du_j`. Slices of other lengths are a programming
/// error and panic.
pub trait Predictor: Debug + Send {
    /// The numbers of states and inputs.
    fn dims(&self) -> Dims;

    /// The length T of one step, in s.
    fn sample_time_s(&self) -> f64;

    /// Writes f(x, u) into `next`.
    fn predict(&mut self, x: &[f64], u: &[f64], next: &mut [f64]);

    /// Writes f(x, u) into `next` and its Jacobians into `a` and `b`. The value in `next` may differ
    /// from that of [`Predictor::predict`] by rounding.
    fn linearize(&mut self, x: &[f64], u: &[f64], next: &mut [f64], a: &mut [f64], b: &mut [f64]);

    /// [`Predictor::linearize`] at several points, those of a prediction horizon: point k takes the k-th
    /// part of each slice. The results are those of `linearize` at each point, to rounding; they do not
    /// depend on the other points. A model that can share work between points overrides this.
    ///
    /// # Shapes
    ///
    /// `x`, `next`: `[points, n]`; `u`: `[points, m]`; `a`: `[points, n, n]`; `b`: `[points, n, m]`. No
    /// points are allowed.
    fn linearize_stages(
        &mut self,
        x: &[f64],
        u: &[f64],
        next: &mut [f64],
        a: &mut [f64],
        b: &mut [f64],
    ) {
        let Dims { states: n, inputs: m } = self.dims();
        let points = x.len() / n;
        assert!(x.len() == points * n && u.len() == points * m, "lengths of x and u");
        assert!(next.len() == points * n, "length of next");
        assert!(a.len() == points * n * n && b.len() == points * n * m, "lengths of a and b");
        for k in 0..points {
            let part = |width: usize| k * width..(k + 1) * width;
            let (x, u) = (&x[part(n)], &u[part(m)]);
            self.linearize(x, u, &mut next[part(n)], &mut a[part(n * n)], &mut b[part(n * m)]);
        }
    }
}
