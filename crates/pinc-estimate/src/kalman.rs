//! The covariance of a Kalman filter.

use crate::EstimatorStatus;
use crate::estimator::{variances, write_diagonal};
use crate::matrix::{add_scaled, dot, factor, multiply, propagate};
use crate::{Correction, Tuning};
use pinc_qp::all_finite;

/// A covariance P with the noises that change it, in the form of Joseph: A P A' + Q and (I - K H) P
/// (I - K H)' + K R K', which keep it symmetric and positive semidefinite under rounding.
///
/// Measurements are independent, and used one after the other: each is a correction by a scalar.
#[derive(Clone, Debug)]
pub(crate) struct Kalman {
    /// Variances.
    q: Vec<f64>,
    r: Vec<f64>,
    p: Vec<f64>,
    /// P from before.
    before: Vec<f64>,
    gain: Vec<f64>,
    /// P h'
    product: Vec<f64>,
    work: Vec<f64>,
}

impl Kalman {
    pub(crate) fn new(tuning: &Tuning) -> Self {
        let n = tuning.process_sd.len();
        let mut kalman = Self {
            q: variances(&tuning.process_sd),
            r: variances(&tuning.measurement_sd),
            p: vec![0.0; n * n],
            before: vec![0.0; n * n],
            gain: vec![0.0; n],
            product: vec![0.0; n],
            work: vec![0.0; n * n],
        };
        kalman.reset(tuning);
        kalman
    }

    pub(crate) fn reset(&mut self, tuning: &Tuning) {
        write_diagonal(&tuning.initial_sd, &mut self.p);
    }

    pub(crate) fn covariance(&self) -> &[f64] {
        &self.p
    }

    /// Corrects P, and writes by how much the estimate changes into `change`. `h`: `[ny, n]`, the
    /// Jacobian of what is measured; `innovation`: `ny`, NaN where nothing was measured. Nothing
    /// has happened if the status is another than updated.
    pub(crate) fn correct(
        &mut self,
        h: &[f64],
        innovation: &[f64],
        change: &mut [f64],
    ) -> Correction {
        let n = change.len();
        self.before.copy_from_slice(&self.p);
        change.fill(0.0);
        let (mut nis, mut measured) = (0.0, 0);
        for (i, &innovation) in innovation.iter().enumerate() {
            if !innovation.is_nan() {
                nis += self.correct_by(&h[i * n..(i + 1) * n], innovation, self.r[i], change);
                measured += 1;
            }
        }
        if measured == 0 {
            return Correction::unused(EstimatorStatus::NothingMeasured, 0);
        }
        let status = if !all_finite(change) || !all_finite(&self.p) {
            EstimatorStatus::NotFinite
        } else if !factor(&self.p, n, &mut self.work) {
            EstimatorStatus::IndefiniteCovariance
        } else {
            let used = Correction::unused(EstimatorStatus::Updated, measured);
            return Correction { nis, ..used };
        };
        self.p.copy_from_slice(&self.before);
        Correction::unused(status, measured)
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
        mirror(&mut self.p, n);
        rest * rest / s
    }

    /// P = A P A' + Q. Nothing has happened if the status is another than updated.
    pub(crate) fn predict(&mut self, a: &[f64]) -> EstimatorStatus {
        let n = self.q.len();
        self.before.copy_from_slice(&self.p);
        propagate(a, &self.q, &mut self.p, &mut self.work);
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

/// Makes a matrix symmetric: the mean of what is below and above the diagonal.
pub(crate) fn mirror(p: &mut [f64], n: usize) {
    for i in 0..n {
        for j in 0..i {
            let mean = 0.5 * (p[i * n + j] + p[j * n + i]);
            p[i * n + j] = mean;
            p[j * n + i] = mean;
        }
    }
}

/// Writes measured minus expected into `innovation`, NaN where there is no measurement.
pub(crate) fn subtract(measured: &[f64], expected: &[f64], innovation: &mut [f64]) {
    for (to, (y, expected)) in innovation.iter_mut().zip(measured.iter().zip(expected)) {
        *to = if y.is_finite() { y - expected } else { f64::NAN };
    }
}
