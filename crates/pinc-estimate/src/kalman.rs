//! The covariance of a Kalman filter.

use crate::estimator::{limit, variances, write_diagonal};
use crate::gate::{Gatekeeper, Judgement};
use crate::matrix::{add_scaled, dot, factor, multiply, propagate, solve_lower};
use crate::{Correction, EstimatorStatus, Tuning};
use pinc_ode::Memory;
use pinc_qp::{all_finite, symmetrize};

/// A covariance P with the noises that change it, in the form of Joseph: A P A' + Q and (I - K H) P
/// (I - K H)' + K R K', which keep it symmetric and positive semidefinite under rounding.
///
/// Measurements are independent, and used one after the other: each is a correction by a scalar.
#[derive(Clone, Debug)]
pub(crate) struct Kalman {
    /// Variances.
    q: Vec<f64>,
    r: Vec<f64>,
    /// The most that a prediction leaves of each variance.
    most: Vec<f64>,
    gate: Gatekeeper,
    p: Vec<f64>,
    /// P from before.
    before: Vec<f64>,
    gain: Vec<f64>,
    /// P h'
    product: Vec<f64>,
    work: Vec<f64>,
    /// The covariance of what is measured, its root, and innovations.
    s: Vec<f64>,
    s_root: Vec<f64>,
    residual: Vec<f64>,
}

impl Kalman {
    pub(crate) fn new(tuning: &Tuning) -> Self {
        let (n, ny) = (tuning.process_sd.len(), tuning.measurement_sd.len());
        let mut kalman = Self {
            q: variances(&tuning.process_sd),
            r: variances(&tuning.measurement_sd),
            most: tuning.most_variance(),
            gate: Gatekeeper::new(tuning),
            p: vec![0.0; n * n],
            before: vec![0.0; n * n],
            gain: vec![0.0; n],
            product: vec![0.0; n],
            work: vec![0.0; n * n],
            s: vec![0.0; ny * ny],
            s_root: vec![0.0; ny * ny],
            residual: vec![0.0; ny],
        };
        kalman.reset(tuning);
        kalman
    }

    pub(crate) fn reset(&mut self, tuning: &Tuning) {
        write_diagonal(&tuning.initial_sd, &mut self.p);
        self.gate.reset();
    }

    /// Saves or restores P and what was rejected.
    pub(crate) fn remember(&mut self, memory: &mut Memory<'_>) {
        memory.numbers(&mut self.p);
        self.gate.remember(memory);
    }

    pub(crate) fn covariance(&self) -> &[f64] {
        &self.p
    }

    /// P before the last correction.
    pub(crate) fn prior(&self) -> &[f64] {
        &self.before
    }

    /// Corrects P, and writes by how much the estimate changes into `change`. `h`: `[ny, n]`, the
    /// Jacobian of what is measured; `innovation`: `ny`, NaN where nothing was measured, and
    /// afterwards also where it was rejected. P is not corrected if the status is a failure.
    pub(crate) fn correct(
        &mut self,
        h: &[f64],
        innovation: &mut [f64],
        change: &mut [f64],
    ) -> Correction {
        let n = change.len();
        self.before.copy_from_slice(&self.p);
        change.fill(0.0);
        let judgement = self.judge(h, innovation);
        let (mut nis, mut measured) = (0.0, 0);
        for (i, &innovation) in innovation.iter().enumerate() {
            if !innovation.is_nan() {
                nis += self.correct_by(&h[i * n..(i + 1) * n], innovation, self.r[i], change);
                measured += 1;
            }
        }
        let status = if measured == 0 {
            judgement.status(EstimatorStatus::NothingMeasured)
        } else if !all_finite(change) || !all_finite(&self.p) {
            EstimatorStatus::NotFinite
        } else if !factor(&self.p, n, &mut self.work) {
            EstimatorStatus::IndefiniteCovariance
        } else {
            judgement.status(EstimatorStatus::Updated)
        };
        if measured == 0 {
            nis = f64::NAN;
        } else if !status.is_corrected() {
            self.p.copy_from_slice(&self.before);
            nis = self.nis(h, innovation);
        }
        let Judgement { rejected, .. } = judgement;
        Correction { nis, rejected, ..Correction::unused(status, measured) }
    }

    /// Judges the measurements, and widens P if one passes only then. Those rejected become NaN.
    fn judge(&mut self, h: &[f64], innovation: &mut [f64]) -> Judgement {
        let n = self.product.len();
        let (mut judgement, mut doublings) = (Judgement::default(), None);
        for (i, (h, &v)) in h.chunks_exact(n).zip(&*innovation).enumerate() {
            if v.is_nan() {
                continue;
            }
            // What is within the noise alone takes no product.
            let passes = self.gate.passes(v, self.r[i]) || self.gate.passes(v, self.variance(h, i));
            self.gate.note(i, passes);
            judgement.rejected += usize::from(!passes);
            let due = self.gate.widening(i);
            let due = due.filter(|due| self.gate.passes(v, self.wide_variance(h, i, *due)));
            doublings = doublings.max(due);
        }
        if judgement.rejected == 0 {
            return judgement;
        }
        if let Some(doublings) = doublings {
            judgement.widened = true;
            self.gate.widen(doublings, &mut self.p);
            self.before.copy_from_slice(&self.p);
        }
        for (i, (h, v)) in h.chunks_exact(n).zip(innovation).enumerate() {
            if v.is_nan() || !self.gate.is_rejected(i) {
                continue;
            }
            if judgement.widened && self.gate.passes(*v, self.variance(h, i)) {
                self.gate.note_reacquired(i);
                judgement.rejected -= 1;
            } else {
                *v = f64::NAN;
            }
        }
        judgement
    }

    /// The variance of the innovation of quantity `i`, with its Jacobian.
    fn variance(&self, h: &[f64], i: usize) -> f64 {
        let rows = self.p.chunks_exact(h.len()).zip(h);
        rows.map(|(row, entry)| entry * dot(row, h)).sum::<f64>() + self.r[i]
    }

    /// The variance of the innovation of quantity `i` with P widened.
    fn wide_variance(&self, h: &[f64], i: usize, doublings: usize) -> f64 {
        let diagonal = self.p.iter().step_by(h.len() + 1).zip(h).enumerate();
        diagonal.map(|(k, (p, h))| h * h * self.gate.wide(k, doublings, *p)).sum::<f64>()
            + self.r[i]
    }

    /// The normalized innovation squared, v' S^-1 v, of measurements that could not be used; NaN if
    /// S is singular.
    fn nis(&mut self, h: &[f64], innovation: &[f64]) -> f64 {
        let n = self.product.len();
        let row = |i: usize| &h[i * n..(i + 1) * n];
        let present = || innovation.iter().enumerate().filter(|(_, v)| !v.is_nan());
        let count = present().count();
        for (a, (i, v)) in present().enumerate() {
            self.residual[a] = *v;
            multiply(&self.p, row(i), &mut self.product);
            for (b, (j, _)) in present().enumerate() {
                let noise = if i == j { self.r[i] } else { 0.0 };
                self.s[a * count + b] = dot(row(j), &self.product) + noise;
            }
        }
        let (s, root) = (&self.s[..count * count], &mut self.s_root[..count * count]);
        if !factor(s, count, root) || (0..count).any(|i| root[i * (count + 1)] <= 0.0) {
            return f64::NAN;
        }
        let residual = &mut self.residual[..count];
        solve_lower(root, residual);
        dot(residual, residual)
    }

    /// Corrects with one measurement: its Jacobian, innovation and variance. Gives its share of the
    /// normalized innovation squared.
    fn correct_by(&mut self, h: &[f64], innovation: f64, r: f64, change: &mut [f64]) -> f64 {
        let n = h.len();
        multiply(&self.p, h, &mut self.product);
        let s = dot(h, &self.product) + r;
        let rest = innovation - dot(h, change);
        for (gain, product) in self.gain.iter_mut().zip(&self.product) {
            *gain = product / s;
        }
        add_scaled(change, rest, &self.gain);
        // (I - K h) P, then times (I - K h)' from the right.
        for (row, gain) in self.p.chunks_exact_mut(n).zip(&self.gain) {
            add_scaled(row, -gain, &self.product);
            let along = dot(row, h);
            add_scaled(row, r * gain - along, &self.gain);
        }
        symmetrize(&mut self.p, n, n);
        rest * rest / s
    }

    /// P = A P A' + Q, within the largest variances. Nothing has happened if the status is another than updated.
    pub(crate) fn predict(&mut self, a: &[f64]) -> EstimatorStatus {
        let n = self.q.len();
        self.before.copy_from_slice(&self.p);
        propagate(a, &self.q, &mut self.p, &mut self.work);
        limit(&self.most, &mut self.p);
        let status = if !all_finite(&self.p) {
            EstimatorStatus::NotFinite
        } else if !factor(&self.p, n, &mut self.work) {
            EstimatorStatus::IndefiniteCovariance
        } else {
            return EstimatorStatus::Updated;
        };
        self.p.copy_from_slice(&self.before);
        status
    }
}

/// Writes measured minus expected into `innovation`, NaN where there is no measurement.
pub(crate) fn subtract(measured: &[f64], expected: &[f64], innovation: &mut [f64]) {
    for (to, (y, expected)) in innovation.iter_mut().zip(measured.iter().zip(expected)) {
        *to = if y.is_finite() { y - expected } else { f64::NAN };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A correction that leaves no covariance is not made; its innovation is normalized by the
    /// covariance that is kept.
    #[test]
    fn a_correction_that_fails_has_its_normalized_innovation() {
        let tuning = Tuning {
            initial_sd: vec![1.0; 2],
            process_sd: vec![0.0; 2],
            measurement_sd: vec![1.0; 2],
            ..Tuning::default()
        };
        let mut kalman = Kalman::new(&tuning);
        let (indefinite, identity) = ([1.0, 1.5, 1.5, 1.0], [1.0, 0.0, 0.0, 1.0]);
        kalman.p.copy_from_slice(&indefinite);
        let correction = kalman.correct(&identity, &mut [1.0, -1.0], &mut [0.0; 2]);
        assert_eq!(correction.status, EstimatorStatus::IndefiniteCovariance);
        assert_eq!(kalman.covariance(), indefinite);
        // S = [2, 1.5; 1.5, 2], whose inverse is [2, -1.5; -1.5, 2] / 1.75.
        assert!((correction.nis - 4.0).abs() < 1e-12, "{}", correction.nis);
        let correction = kalman.correct(&identity, &mut [1.0, f64::NAN], &mut [0.0; 2]);
        assert_eq!(correction.status, EstimatorStatus::IndefiniteCovariance);
        assert!((correction.nis - 0.5).abs() < 1e-12, "{}", correction.nis);
    }
}
