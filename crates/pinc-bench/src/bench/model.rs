//! One step of a model: its time alone and with Jacobians, and its error.

use super::cases::{Case, Effort};
use super::clock::{for_seconds, median, time, to_f64};
use super::results::ModelStep;
use crate::BenchError;
use crate::system::System;
use pinc_net::{Domain, PincNet, PincPredictor, Points, Sampler};
use pinc_ode::metrics::mean_squared_error;
use pinc_ode::{Dims, Predictor};
use std::hint::black_box;

/// Substeps of the Runge-Kutta method that are measured.
const SUBSTEPS: [usize; 5] = [1, 4, 5, 10, 50];

/// Steps that are timed together, so that reading the clock does not count.
const BATCH: usize = 256;

/// Tolerance of the truth.
const TOLERANCE: f64 = 1e-12;

/// A net, with how long it was trained.
pub(super) struct Trained {
    pub(super) net: PincNet,
    pub(super) seconds: f64,
}

/// Measures the models of a plant: Runge-Kutta by substeps, then `nets`.
pub(super) fn run(
    case: Case,
    plant: &dyn System,
    domain: &Domain,
    nets: &[&Trained],
    effort: &Effort,
) -> Result<Vec<ModelStep>, BenchError> {
    let horizon_s = nets[0].net.horizon_s();
    let truth = Truth::new(plant, domain, horizon_s, effort.one_step_points)?;
    let row = |model: &mut dyn Predictor| ModelStep {
        plant: case.name(),
        model: "rk4",
        layers: None,
        substeps: None,
        trained_s: None,
        forward_ns: truth.forward_ns(model, effort.model_s),
        forward_jacobian_ns: truth.forward_jacobian_ns(model, effort.model_s),
        one_step_rms: truth.rms(model),
    };
    let mut rows = Vec::new();
    for substeps in SUBSTEPS {
        let row = row(&mut *plant.rk4(horizon_s, substeps));
        rows.push(ModelStep { substeps: Some(substeps), ..row });
    }
    for Trained { net, seconds } in nets {
        let row = row(&mut PincPredictor::new(net));
        let (layers, trained_s) = (Some(super::kernel::size(net)), Some(*seconds));
        rows.push(ModelStep { model: "pinc", layers, trained_s, ..row });
    }
    Ok(rows)
}

/// Points that fill the domain, with the true states one step later.
struct Truth {
    dims: Dims,
    points: Points,
    next: Vec<f64>,
}

impl Truth {
    fn new(
        plant: &dyn System,
        domain: &Domain,
        horizon_s: f64,
        count: usize,
    ) -> Result<Self, BenchError> {
        // Sobol points are the same for each seed up to a scrambling.
        let points = Sampler::Sobol.collocation(count, horizon_s, domain, 1, 0);
        let mut integrator = plant.truth(TOLERANCE);
        let mut next = Vec::new();
        for i in 0..count {
            let mut x = points.state(i).to_vec();
            integrator.integrate(&mut x, points.input(i), horizon_s)?;
            next.extend(x);
        }
        Ok(Self { dims: plant.dims(), points, next })
    }

    /// Root mean square over all points and states, in the states' units.
    fn rms(&self, model: &mut dyn Predictor) -> f64 {
        let mut predicted = vec![0.0; self.next.len()];
        let states = self.dims.states;
        for (i, next) in predicted.chunks_exact_mut(states).enumerate() {
            model.predict(self.points.state(i), self.points.input(i), next);
        }
        mean_squared_error(&predicted, &self.next, &vec![1.0; states]).sqrt()
    }

    fn forward_ns(&self, model: &mut dyn Predictor, seconds: f64) -> f64 {
        let mut next = vec![0.0; self.dims.states];
        self.nanoseconds(seconds, |x, u| {
            model.predict(x, u, &mut next);
            black_box(&mut next);
        })
    }

    fn forward_jacobian_ns(&self, model: &mut dyn Predictor, seconds: f64) -> f64 {
        let Dims { states: n, inputs: m } = self.dims;
        let (mut next, mut a, mut b) = (vec![0.0; n], vec![0.0; n * n], vec![0.0; n * m]);
        self.nanoseconds(seconds, |x, u| {
            model.linearize(x, u, &mut next, &mut a, &mut b);
            black_box((&mut next, &mut a, &mut b));
        })
    }

    /// The median time of `work` at a point.
    fn nanoseconds(&self, seconds: f64, mut work: impl FnMut(&[f64], &[f64])) -> f64 {
        let batch = self.points.len().min(BATCH);
        let mut times = Vec::new();
        for_seconds(seconds, || {
            times.push(time(|| {
                for i in 0..batch {
                    work(black_box(self.points.state(i)), black_box(self.points.input(i)));
                }
            }));
        });
        1e9 * median(&times) / to_f64(batch as u64)
    }
}
