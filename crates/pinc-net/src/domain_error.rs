//! The error of one step of a model all over a domain, and its worst place.

use crate::Domain;
use crate::mlp::to_f64;
use crate::sampling::{Points, Purpose, Sampler};
use pinc_ode::metrics::mean_squared_error;
use pinc_ode::{DynRhs, Model, Simulator};

/// The worst points from which the search for the largest error starts.
const STARTS: usize = 4;

/// Starts are at least this far apart in some variable, in widths.
const APART: f64 = 0.1;

/// Evaluations of the search from each start, per variable, at most.
const EVALUATIONS: usize = 100;

/// The first step of the search and the last, in widths.
const FIRST_STEP: f64 = 0.05;
const LAST_STEP: f64 = 1e-4;

/// Points that fill a domain, with the true states one step later.
///
/// The error of a state is measured in widths of its range in the domain; the error of a point is
/// the largest of its states' errors.
///
/// ```
/// use pinc_net::{Domain, DomainTruth};
/// use pinc_ode::Rk4;
/// use pinc_plants::VanDerPol;
///
/// let domain = Domain::new([-3.0..=3.0, -4.35..=4.35], [-1.0..=1.0]);
/// let mut truth = DomainTruth::draw(&VanDerPol::default(), &domain, 0.5, 256, 1e-9, 1);
/// let found = truth.judge(&mut Rk4::new(VanDerPol::default(), 0.5, 1));
/// assert!(found.rms < found.p99 && found.p99 <= found.max);
/// // In a corner of the domain, where no random point lies.
/// assert_eq!(found.worst.x[0].abs(), 3.0);
/// ```
#[derive(Clone, Debug)]
pub struct DomainTruth {
    ends: Vec<(f64, f64)>,
    /// The widths of the states.
    widths: Vec<f64>,
    sample_time_s: f64,
    integrator: Simulator,
    /// The number of inputs.
    inputs: usize,
    points: Points,
    next: Vec<f64>,
    unsolved: usize,
}

/// The errors of one step of a model over a domain, in widths of the domain.
#[derive(Clone, Debug, PartialEq)]
pub struct DomainError {
    /// Root mean square over points and states.
    pub rms: f64,
    /// The 99th percentile over the points.
    pub p99: f64,
    /// The largest found: among the points, and where a search from the worst of them ends.
    pub max: f64,
    /// Where that is.
    pub worst: WorstStep,
    /// The error of each point, in the order of [`DomainTruth::points`].
    pub errors: Vec<f64>,
}

/// A root mean square error over a sample of points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RmsError {
    /// Root mean square over points and states, in widths.
    pub rms: f64,
    /// Relative standard error of `rms`, near 1 where a few points make most of the error.
    pub uncertainty: f64,
}

/// The step with the largest error.
#[derive(Clone, Debug, PartialEq)]
pub struct WorstStep {
    /// The state before it, shape `nx`.
    pub x: Vec<f64>,
    /// The input, shape `nu`.
    pub u: Vec<f64>,
    /// The parameters, shape `np`.
    pub p: Vec<f64>,
    /// The state that is predicted worst, by its place.
    pub state: usize,
    /// Its predicted value, in its unit.
    pub predicted: f64,
    /// Its true value.
    pub truth: f64,
}

/// A place of the search, in widths from the lower ends, and the step from there.
struct SearchPoint {
    place: Vec<f64>,
    predicted: Vec<f64>,
    truth: Vec<f64>,
    error: f64,
}

impl DomainTruth {
    /// `count` quasi-random points of `domain`, drawn from `seed`, and the states after
    /// `sample_time_s` under a constant input, integrated with this local `tolerance`. Points from
    /// which the plant cannot be integrated over the whole step are left out and counted.
    #[must_use]
    pub fn draw(
        plant: &dyn DynRhs,
        domain: &Domain,
        sample_time_s: f64,
        count: usize,
        tolerance: f64,
        seed: u64,
    ) -> Self {
        let all = Sampler::Sobol.sample(count, sample_time_s, domain, 1, seed, Purpose::Domain);
        let mut integrator = Simulator::new(plant, tolerance);
        let (mut points, mut next) = (Points::new(plant.dims()), Vec::new());
        for i in 0..count {
            let (x, u, p) = (all.state(i), all.input(i), all.parameters(i));
            let mut end = x.to_vec();
            integrator.set_parameters(p);
            if integrator.integrate(&mut end, u, sample_time_s).is_ok() {
                points.push(sample_time_s, x, u, p);
                next.extend(end);
            }
        }
        let ends: Vec<_> = domain.ends().collect();
        let widths = ends[..plant.dims().nx].iter().map(|(low, high)| high - low).collect();
        let unsolved = count - points.len();
        let inputs = plant.dims().nu;
        Self { ends, widths, sample_time_s, integrator, inputs, points, next, unsolved }
    }

    /// The points that have a solution; their time is the step's.
    #[must_use]
    pub fn points(&self) -> &Points {
        &self.points
    }

    /// How many points have none.
    #[must_use]
    pub fn unsolved(&self) -> usize {
        self.unsolved
    }

    /// The error of one step of `model`, root mean square over points and states, in widths.
    #[must_use]
    pub fn rms(&self, model: &mut dyn Model) -> f64 {
        mean_squared_error(&self.predictions(model), &self.next, &self.widths).sqrt()
    }

    /// [`DomainTruth::rms`] with its uncertainty.
    #[must_use]
    pub fn rms_error(&self, model: &mut dyn Model) -> RmsError {
        let (n, predicted) = (self.widths.len(), self.predictions(model));
        let pairs = predicted.chunks_exact(n).zip(self.next.chunks_exact(n));
        let square = |(y, z)| mean_squared_error(y, z, &self.widths);
        let squares: Vec<f64> = pairs.map(square).collect();
        let (count, sum) = (to_f64(squares.len()), squares.iter().sum::<f64>());
        let mean = sum / count;
        let variance = squares.iter().map(|of| (of - mean).powi(2)).sum::<f64>() / count;
        // Half of the mean square's own.
        let uncertainty = if mean > 0.0 { 0.5 * (variance / count).sqrt() / mean } else { 0.0 };
        RmsError { rms: mean.sqrt(), uncertainty }
    }

    /// The errors of one step of `model`, and the worst, which is searched for by moving one
    /// variable at a time from the worst points.
    ///
    /// # Panics
    ///
    /// If no point has a solution.
    #[must_use]
    pub fn judge(&mut self, model: &mut dyn Model) -> DomainError {
        let (n, predicted) = (self.widths.len(), self.predictions(model));
        let rms = mean_squared_error(&predicted, &self.next, &self.widths).sqrt();
        let pairs = predicted.chunks_exact(n).zip(self.next.chunks_exact(n));
        let errors: Vec<f64> = pairs.map(|(y, truth)| self.largest(y, truth).1).collect();
        let mut order: Vec<usize> = (0..errors.len()).collect();
        order.sort_by(|&a, &b| errors[b].total_cmp(&errors[a]));
        let p99 = errors[order[errors.len() / 100]];
        let mut found: Vec<SearchPoint> = Vec::new();
        for &i in &order {
            let place = self.place(i);
            if found.len() < STARTS && found.iter().all(|other| apart(&other.place, &place)) {
                let of = |all: &[f64]| all[i * n..(i + 1) * n].to_vec();
                let (predicted, truth) = (of(&predicted), of(&self.next));
                found.push(SearchPoint { place, predicted, truth, error: errors[i] });
            }
        }
        let most = (EVALUATIONS * self.ends.len()).min(errors.len() / STARTS);
        let climbed = found.into_iter().map(|start| self.climb(start, most, model));
        let worst = climbed.max_by(|a, b| a.error.total_cmp(&b.error)).expect("there is a point");
        let [x, u, p] = self.at(&worst.place);
        let SearchPoint { predicted, truth, .. } = worst;
        let (state, max) = self.largest(&predicted, &truth);
        let worst = WorstStep { x, u, p, state, predicted: predicted[state], truth: truth[state] };
        DomainError { rms, p99, max, worst, errors }
    }

    fn predictions(&self, model: &mut dyn Model) -> Vec<f64> {
        let mut predicted = vec![0.0; self.next.len()];
        for (i, next) in predicted.chunks_exact_mut(self.widths.len()).enumerate() {
            let Self { points, .. } = self;
            model.step(points.state(i), points.input(i), points.parameters(i), next);
        }
        predicted
    }

    /// The state that is predicted worst, and its error in widths; infinite for what is no number.
    fn largest(&self, predicted: &[f64], truth: &[f64]) -> (usize, f64) {
        let pairs = predicted.iter().zip(truth).zip(&self.widths);
        let errors = pairs.map(|((y, truth), width)| {
            let error = (y - truth).abs() / width;
            if error.is_nan() { f64::INFINITY } else { error }
        });
        errors.enumerate().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0))
    }

    /// The place of point `i`, in widths.
    fn place(&self, i: usize) -> Vec<f64> {
        let Self { points, .. } = self;
        let values = points.state(i).iter().chain(points.input(i)).chain(points.parameters(i));
        values.zip(&self.ends).map(|(v, (low, high))| (v - low) / (high - low)).collect()
    }

    /// x, u and p at a place.
    fn at(&self, place: &[f64]) -> [Vec<f64>; 3] {
        // The ends are met exactly.
        let value = |(share, (low, high)): (&f64, &(f64, f64))| match *share {
            1.0 => *high,
            share => low + share * (high - low),
        };
        let mut x: Vec<f64> = place.iter().zip(&self.ends).map(value).collect();
        let mut u = x.split_off(self.widths.len());
        let p = u.split_off(self.inputs);
        [x, u, p]
    }

    /// The step from a place, if the plant can be integrated from there.
    fn step_from(&mut self, place: Vec<f64>, model: &mut dyn Model) -> Option<SearchPoint> {
        let [x, u, p] = self.at(&place);
        let (mut predicted, mut truth) = (vec![0.0; x.len()], x.clone());
        self.integrator.set_parameters(&p);
        self.integrator.integrate(&mut truth, &u, self.sample_time_s).ok()?;
        model.step(&x, &u, &p, &mut predicted);
        let error = self.largest(&predicted, &truth).1;
        Some(SearchPoint { place, predicted, truth, error })
    }

    /// A local maximum of the error, by the pattern search of Hooke and Jeeves (Journal of the ACM
    /// 8, 1961, 212): moves along one variable at a time, and again along the sum of those that
    /// helped.
    fn climb(&mut self, start: SearchPoint, most: usize, model: &mut dyn Model) -> SearchPoint {
        let (mut best, mut step, mut evaluations) = (start, FIRST_STEP, 0);
        while step > LAST_STEP && best.error.is_finite() && evaluations < most {
            let before = best.place.clone();
            for i in 0..before.len() {
                for to in [best.place[i] + step, best.place[i] - step] {
                    let mut place = best.place.clone();
                    place[i] = to.clamp(0.0, 1.0);
                    evaluations += 1;
                    if self.improve(&mut best, place, model) {
                        break;
                    }
                }
            }
            if best.place == before {
                step *= 0.5;
                continue;
            }
            let pairs = best.place.iter().zip(&before);
            let further = pairs.map(|(new, old)| (2.0 * new - old).clamp(0.0, 1.0)).collect();
            evaluations += 1;
            self.improve(&mut best, further, model);
        }
        best
    }

    fn improve(&mut self, best: &mut SearchPoint, place: Vec<f64>, model: &mut dyn Model) -> bool {
        let step = self.step_from(place, model);
        let better = step.filter(|step| step.error > best.error);
        let improves = better.is_some();
        better.into_iter().for_each(|better| *best = better);
        improves
    }
}

fn apart(one: &[f64], other: &[f64]) -> bool {
    one.iter().zip(other).any(|(a, b)| (a - b).abs() > APART)
}

impl DomainError {
    /// The share of the points whose error is larger than `error`.
    #[must_use]
    pub fn share_beyond(&self, error: f64) -> f64 {
        let beyond = self.errors.iter().filter(|of| **of > error).count();
        to_f64(beyond) / to_f64(self.errors.len())
    }
}
