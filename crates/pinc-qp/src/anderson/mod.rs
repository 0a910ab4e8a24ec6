//! Anderson acceleration of an iteration.

#[cfg(test)]
mod tests;

use crate::{Multipliers, OcpDims, QpStep};

/// How many earlier steps are looked at.
const DEPTH: usize = 2;
/// Two differences of steps are independent if so much of one is orthogonal to the other.
const INDEPENDENT: f64 = 1e-8;

/// Anderson's acceleration of the iteration z <- z + d(z).
///
/// A Gauss-Newton step misses a part of the Hessian, so that each step leaves the same fractions of
/// the error's components. Of the last steps `d_i`, which ended at `z_i + d_i`, the combination
///
/// ```text
/// z = sum_i alpha_i (z_i + d_i),    sum_i alpha_i = 1,    |sum_i alpha_i d_i| least,
/// ```
///
/// removes the components that last longest, from the multipliers likewise. It is a guess: the caller
/// takes it only if it brings the residual down.
///
/// References: Anderson, "Iterative procedures for nonlinear integral equations", J. ACM 12 (1965);
/// Walker and Ni, "Anderson acceleration for fixed-point iterations", SIAM J. Numer. Anal. 49 (2011).
#[derive(Clone, Debug)]
pub struct Anderson {
    /// The steps, the last one first.
    steps: [Step; DEPTH + 1],
    /// How many there were.
    count: usize,
}

#[derive(Clone, Debug)]
struct Step {
    d: Vec<f64>,
    /// Where it ended, from where the iteration is now.
    end: Vec<f64>,
    multipliers: Multipliers,
}

impl Anderson {
    /// For the steps of problems of these sizes.
    #[must_use]
    pub fn new(dims: OcpDims) -> Self {
        let zeros = || vec![0.0; dims.unknowns()];
        let step = || Step { d: zeros(), end: zeros(), multipliers: Multipliers::new(dims) };
        Self { steps: std::array::from_fn(|_| step()), count: 0 }
    }

    /// Forgets all steps: another iteration begins.
    pub fn reset(&mut self) {
        self.count = 0;
    }

    /// Accelerates `step` if at least `least` earlier steps are known. Returns whether it did.
    pub fn accelerate(&mut self, step: &mut QpStep, least: usize) -> bool {
        let known = self.count.min(DEPTH);
        self.steps.rotate_right(1);
        self.count += 1;
        let [now, past @ ..] = &mut self.steps;
        now.d.copy_from_slice(&step.d);
        now.end.copy_from_slice(&step.d);
        now.multipliers.copy_from(&step.multipliers);
        if self.count <= least {
            return false;
        }
        let Some(gammas) = gammas(&now.d, &past[..known]) else { return false };
        for (before, gamma) in past.iter().zip(gammas) {
            move_back(&mut step.d, [&now.end, &before.end], gamma);
            let parts = now.multipliers.parts().into_iter().zip(before.multipliers.parts());
            for (to, (now, before)) in step.multipliers.parts_mut().into_iter().zip(parts) {
                move_back(to, [now, before], gamma);
            }
        }
        true
    }

    /// Undoes the acceleration of `step`.
    pub fn take_back(&self, step: &mut QpStep) {
        step.d.copy_from_slice(&self.steps[0].d);
        step.multipliers.copy_from(&self.steps[0].multipliers);
    }

    /// Tells that the iteration moved by `length` times `d`.
    pub fn advance(&mut self, d: &[f64], length: f64) {
        for step in &mut self.steps {
            step.end.iter_mut().zip(d).for_each(|(end, d)| *end -= length * d);
        }
    }
}

/// Returns the gammas for which `|d - sum_i gamma_i (d - d_i)|` is least.
fn gammas(d: &[f64], past: &[Step]) -> Option<[f64; DEPTH]> {
    let (one, two) = (past.first()?, past.get(1));
    let [mut aa, mut ab, mut bb, mut ad, mut bd] = [0.0; 5];
    for ((d, one), two) in d.iter().zip(&one.d).zip(&two.unwrap_or(one).d) {
        let (a, b) = (d - one, d - two);
        aa += a * a;
        ab += a * b;
        bb += b * b;
        ad += a * d;
        bd += b * d;
    }
    // The part of b that is orthogonal to a.
    let along = ab / aa;
    let left = bb - along * ab;
    let second = if left > INDEPENDENT * bb { (bd - along * ad) / left } else { 0.0 };
    let gammas = [ad / aa - along * second, second];
    gammas.iter().all(|gamma| gamma.is_finite()).then_some(gammas)
}

/// Moves `to` by a part of the way from `now` to `before`.
fn move_back(to: &mut [f64], [now, before]: [&[f64]; 2], part: f64) {
    for (to, (now, before)) in to.iter_mut().zip(now.iter().zip(before)) {
        *to += part * (before - now);
    }
}
