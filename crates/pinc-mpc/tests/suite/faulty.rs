//! A model that fails on demand.

use pinc_ode::{Dims, Linearization, Model, Stages};
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

impl<M: Model> Model for Faulty<M> {
    fn dims(&self) -> Dims {
        self.model.dims()
    }

    fn sample_time_s(&self) -> f64 {
        self.model.sample_time_s()
    }

    fn step(&mut self, x: &[f64], u: &[f64], _p: &[f64], next: &mut [f64]) {
        self.model.step(x, u, &[], next);
        match self.fault.load(Ordering::Relaxed) {
            NOT_A_NUMBER => next[0] = f64::NAN,
            WRONG => next.iter_mut().for_each(|v| *v = 3.0 * (5.0 * *v).sin() + 1e3 * u[0]),
            _ => {}
        }
    }

    fn linearize(&mut self, at: Stages<'_>, mut out: Linearization<'_>) {
        let dims = self.dims();
        for k in 0..at.count(dims) {
            let (at, out) = (at.point(k, dims), out.point(k, dims));
            let Linearization { next, a, b, e } = out;
            self.model.linearize(at, Linearization { next, a, b, e });
            match self.fault.load(Ordering::Relaxed) {
                NOT_A_NUMBER => a[0] = f64::NAN,
                // Jacobians that do not belong to the values.
                WRONG => self.step(at.x, at.u, at.p, next),
                _ => {}
            }
        }
    }
}
