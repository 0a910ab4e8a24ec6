//! One step of a model: how wrong it is over a domain, and how long it takes.

use crate::RunError;
use crate::clock::{for_seconds, time};
use pinc_net::{Domain, Points, Sampler};
use pinc_ode::metrics::mean_squared_error;
use pinc_ode::{Dims, DynPlant, Integrator, LinearizationBuffer, Model, Simulator, Stages};
use pinc_record::{StepErrors, median, to_f64};
use std::hint::black_box;
use std::ops::Range;

/// Steps that are timed together, so that reading the clock does not count.
const BATCH: usize = 256;

/// Points at which Jacobians are compared, at most.
const JACOBIANS: usize = 256;

/// Substeps of RK5 for the true Jacobians.
const FINE: usize = 512;

/// Points that fill a domain, with the true states one step later.
#[derive(Debug)]
pub struct Steps {
    dims: Dims,
    points: Points,
    next: Vec<f64>,
    /// The widths of the states, then of the inputs, then of the parameters.
    widths: Vec<f64>,
}

impl Steps {
    /// `count` steps of `plant` over `sample_time_s` from all over `domain`, integrated with this
    /// local tolerance.
    ///
    /// # Errors
    ///
    /// [`RunError`] if the plant cannot be integrated there.
    pub fn new(
        plant: &dyn DynPlant,
        domain: &Domain,
        sample_time_s: f64,
        count: usize,
        tolerance: f64,
    ) -> Result<Self, RunError> {
        // Sobol points are the same for each seed up to a scrambling.
        let points = Sampler::Sobol.collocation(count, sample_time_s, domain, 1, 0);
        let mut integrator = Simulator::new(plant, tolerance);
        let mut next = Vec::new();
        for i in 0..count {
            let mut x = points.state(i).to_vec();
            integrator.set_parameters(points.parameters(i));
            integrator.integrate(&mut x, points.input(i), sample_time_s)?;
            next.extend(x);
        }
        let widths = domain.ends().map(|(low, high)| high - low).collect();
        Ok(Self { dims: plant.dims(), points, next, widths })
    }

    /// Root mean square of the errors over all points and states, in the states' units.
    pub fn rms_in_units(&self, model: &mut dyn Model) -> f64 {
        let units = vec![1.0; self.dims.nx];
        mean_squared_error(&self.predictions(model), &self.next, &units).sqrt()
    }

    /// The true Jacobians of the first points, by a method of order 5 with many substeps.
    ///
    /// # Errors
    ///
    /// [`RunError`] if the plant has no such integrator.
    pub fn true_jacobians(
        &self,
        plant: &dyn DynPlant,
        sample_time_s: f64,
    ) -> Result<LinearizationBuffer, RunError> {
        Ok(self.linearized(&mut *plant.model(Integrator::Rk5, sample_time_s, FINE)?))
    }

    /// A model's Jacobians at the same points.
    fn linearized(&self, model: &mut dyn Model) -> LinearizationBuffer {
        let count = self.points.len().min(JACOBIANS);
        let [x, u, p] = &self.flat(0..count);
        let mut to = LinearizationBuffer::new(self.dims, count);
        model.linearize(Stages { x, u, p }, to.as_mut());
        to
    }

    /// Points in a row, `[points, nx]`, `[points, nu]` and `[points, np]`; after the last comes the first.
    fn flat(&self, points: Range<usize>) -> [Vec<f64>; 3] {
        let of = |get: fn(&Points, usize) -> &[f64]| {
            let points = points.clone().map(|i| get(&self.points, i % self.points.len()));
            points.flatten().copied().collect()
        };
        [of(Points::state), of(Points::input), of(Points::parameters)]
    }

    /// The errors of a model, whose [`Steps::true_jacobians`] are `truth`.
    pub fn errors(&self, truth: &LinearizationBuffer, model: &mut dyn Model) -> StepErrors {
        let n = self.dims.nx;
        let predicted = self.predictions(model);
        let pairs = predicted.chunks_exact(n).zip(self.next.chunks_exact(n));
        let mut squares: Vec<f64> =
            pairs.map(|(y, truth)| mean_squared_error(y, truth, &self.widths[..n])).collect();
        let mean = squares.iter().sum::<f64>() / to_f64(squares.len() as u64);
        squares.sort_by(f64::total_cmp);
        let part = |percent: usize| squares[(squares.len() * percent / 100).min(squares.len() - 1)];
        StepErrors {
            rms: mean.sqrt(),
            median: part(50).sqrt(),
            p99: part(99).sqrt(),
            max: squares.last().copied().unwrap_or(f64::NAN).sqrt(),
            jacobian_rms: self.jacobian_error(truth, &self.linearized(model)),
        }
    }

    fn predictions(&self, model: &mut dyn Model) -> Vec<f64> {
        let mut predicted = vec![0.0; self.next.len()];
        for (i, next) in predicted.chunks_exact_mut(self.dims.nx).enumerate() {
            let Self { points, .. } = self;
            model.step(points.state(i), points.input(i), points.parameters(i), next);
        }
        predicted
    }

    /// Root mean square over points and entries, in widths of the domain per width.
    fn jacobian_error(&self, truth: &LinearizationBuffer, found: &LinearizationBuffer) -> f64 {
        let n = self.dims.nx;
        let (of, rest) = self.widths.split_at(n);
        let by_u = &rest[..self.dims.nu];
        // The widths of what a state is differentiated by.
        let squares = |found: &[f64], truth: &[f64], by: &[f64]| -> f64 {
            let entries = found.iter().zip(truth).enumerate();
            let square = |(k, (found, truth)): (usize, (&f64, &f64))| {
                ((found - truth) * by[k % by.len()] / of[k / by.len() % n]).powi(2)
            };
            entries.map(square).sum()
        };
        let sum = squares(&found.a, &truth.a, of) + squares(&found.b, &truth.b, by_u);
        (sum / to_f64((truth.a.len() + truth.b.len()) as u64)).sqrt()
    }

    /// The median time of a step when each waits for the one before, as in a simulation.
    pub fn forward_ns(&self, model: &mut dyn Model, seconds: f64) -> f64 {
        let batch = self.points.len().min(BATCH);
        let mut x = vec![0.0; self.dims.nx];
        let mut next: Vec<f64> = x.clone();
        let nothing = black_box(0.0);
        nanoseconds(seconds, batch, || {
            for i in 0..batch {
                // The points are in the domain, wherever the step before went: min(0, |next|) is 0,
                // but has to be waited for.
                for ((x, &from), next) in x.iter_mut().zip(self.points.state(i)).zip(&next) {
                    *x = from + next.abs().min(nothing);
                }
                model.step(&x, self.points.input(i), self.points.parameters(i), &mut next);
            }
            black_box(&mut next);
        })
    }

    /// The median time of a step with both Jacobians, when a controller asks for `stages` points at a time.
    pub fn forward_jacobian_ns(&self, model: &mut dyn Model, stages: usize, seconds: f64) -> f64 {
        let calls = (self.points.len().min(BATCH) / stages).max(1);
        let horizon = |call: usize| self.flat(call * stages..(call + 1) * stages);
        let horizons: Vec<_> = (0..calls).map(horizon).collect();
        let mut to = LinearizationBuffer::new(self.dims, stages);
        nanoseconds(seconds, calls * stages, || {
            for [x, u, p] in &horizons {
                let at = Stages { x: black_box(x), u: black_box(u), p };
                model.linearize(at, to.as_mut());
                black_box(&mut to);
            }
        })
    }
}

/// The median time of `work` that does something `times` times.
fn nanoseconds(seconds: f64, times: usize, mut work: impl FnMut()) -> f64 {
    let mut samples = Vec::new();
    for_seconds(seconds, || samples.push(time(&mut work)));
    1e9 * median(&samples) / to_f64(times as u64)
}
