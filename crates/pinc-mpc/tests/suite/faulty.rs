//! A model that fails on demand.

use pinc_ode::{Dims, Predictor};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// What is wrong with the model.
pub(crate) const SOUND: u64 = 0;
pub(crate) const NOT_A_NUMBER: u64 = 1;
pub(crate) const WRONG: u64 = 2;

/// A model that fails as it is told: with NaN, or with the numbers of quite another one.
#[derive(Debug)]
pub(crate) struct Faulty<M> {
    pub(crate) model: M,
    pub(crate) fault: Arc<AtomicU64>,
}

impl<M: Predictor> Predictor for Faulty<M> {
    fn dims(&self) -> Dims {
        self.model.dims()
    }

    fn sample_time_s(&self) -> f64 {
        self.model.sample_time_s()
    }

    fn predict(&mut self, x: &[f64], u: &[f64], next: &mut [f64]) {
        self.model.predict(x, u, next);
        match self.fault.load(Ordering::Relaxed) {
            NOT_A_NUMBER => next[0] = f64::NAN,
            WRONG => next.iter_mut().for_each(|v| *v = 3.0 * (5.0 * *v).sin() + 1e3 * u[0]),
            _ => {}
        }
    }

    fn linearize(&mut self, x: &[f64], u: &[f64], next: &mut [f64], a: &mut [f64], b: &mut [f64]) {
        self.model.linearize(x, u, next, a, b);
        match self.fault.load(Ordering::Relaxed) {
            NOT_A_NUMBER => a[0] = f64::NAN,
            // Jacobians that do not belong to the values.
            WRONG => self.predict(x, u, next),
            _ => {}
        }
    }
}
