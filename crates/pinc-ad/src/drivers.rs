//! Derivative, gradient and Jacobian of a function given as a closure.

use crate::{Dual, Scalar, Tape, Var};

/// Directions that [`jacobian`] takes through the function at once: one AVX-512 register of `f64`.
const DIRECTIONS: usize = 8;

/// df/dx at `x`, exact to rounding, by one dual number. `x` may itself be a dual number, for higher
/// derivatives: use [`Dual::lift`] on outer values inside `f`.
pub fn derivative<S: Scalar>(f: impl FnOnce(Dual<S>) -> Dual<S>, x: S) -> S {
    f(Dual::variable(x, 0)).eps[0]
}

/// The value of `f` at `x` and its gradient (shape `[x.len()]`), by one sweep of a [`Tape`].
pub fn gradient(f: impl for<'t> FnOnce(&[Var<'t>]) -> Var<'t>, x: &[f64]) -> (f64, Vec<f64>) {
    let tape = Tape::new();
    let inputs: Vec<_> = x.iter().map(|&v| tape.variable(v)).collect();
    let output = f(&inputs);
    (output.value(), tape.gradient(output, &inputs))
}

/// The Jacobian of `f: R^n -> R^m` at `x`, shape `[m, n]`, row by row, by dual numbers with eight
/// directions at a time.
///
/// `f` writes its `m = outputs` results into its second argument, which comes filled with zeros.
pub fn jacobian(
    f: impl Fn(&[Dual<f64, DIRECTIONS>], &mut [Dual<f64, DIRECTIONS>]),
    x: &[f64],
    outputs: usize,
) -> Vec<f64> {
    let n = x.len();
    let mut jacobian = vec![0.0; outputs * n];
    let mut out = vec![Dual::lift(0.0); outputs];
    for first in (0..n).step_by(DIRECTIONS) {
        let seeded: Vec<_> = x
            .iter()
            .enumerate()
            .map(|(i, &v)| Dual::variable(v, if i < first { DIRECTIONS } else { i - first }))
            .collect();
        out.fill(Dual::lift(0.0));
        f(&seeded, &mut out);
        let width = DIRECTIONS.min(n - first);
        for (row, value) in jacobian.chunks_exact_mut(n).zip(&out) {
            row[first..first + width].copy_from_slice(&value.eps[..width]);
        }
    }
    jacobian
}
