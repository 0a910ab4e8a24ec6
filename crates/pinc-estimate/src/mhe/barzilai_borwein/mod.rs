//! The length of steps, judged by how they change.

#[cfg(test)]
mod tests;

/// So many steps are taken as they are.
const PATIENCE: usize = 4;
/// The least and the greatest length.
const LENGTHS: [f64; 2] = [0.05, 50.0];

/// The length of an iteration's steps, for a linear convergence that has turned out to be slow.
///
/// A Gauss-Newton step d misses a part of the Hessian. If the error is mostly along one direction,
/// in which the step is a part p of what is needed, then after a step of length `a` the next one is
/// d+ = (1 - a p) d. So p, and the length 1/p that would have met the solution, can be seen from
/// two steps in a row:
///
/// ```text
/// r = d+'d / d'd,    1/p = a / (1 - r)
/// ```
///
/// This is the step length of Barzilai and Borwein (IMA J. Numer. Anal. 8 (1988)) for the
/// fixed-point iteration z <- z + d(z), and Aitken's extrapolation where a = 1. It is a guess: the
/// caller takes it only if it brings the residual down.
#[derive(Clone, Debug)]
pub(super) struct BarzilaiBorwein {
    last: Vec<f64>,
    last_length: f64,
    steps: usize,
}

impl BarzilaiBorwein {
    /// For steps of `unknowns` numbers.
    pub(super) fn new(unknowns: usize) -> Self {
        Self { last: vec![0.0; unknowns], last_length: 1.0, steps: 0 }
    }

    /// Forgets all steps: an iteration begins.
    pub(super) fn reset(&mut self) {
        self.steps = 0;
    }

    /// The length to try for step `d`, if it is not 1.
    pub(super) fn length(&self, d: &[f64]) -> Option<f64> {
        if self.steps < PATIENCE {
            return None;
        }
        let ratio = dot(d, &self.last) / dot(&self.last, &self.last);
        let [least, greatest] = LENGTHS;
        (ratio < 1.0).then(|| (self.last_length / (1.0 - ratio)).clamp(least, greatest))
    }

    /// Takes note of a step and of its length.
    pub(super) fn remember(&mut self, d: &[f64], length: f64) {
        self.last.copy_from_slice(d);
        self.last_length = length;
        self.steps += 1;
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
