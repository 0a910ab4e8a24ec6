//! The integrator that stands for the exact solution beside a distilled net.

use crate::VerifyError;
use pinc_net::{PincModel, PincNet};
use pinc_ode::{DynPlant, Integrator, Model};

/// Integrators with the substeps that are tried, the cheapest first.
const TRIED: [(Integrator, [usize; 4]); 2] =
    [(Integrator::Rk5, [8, 16, 32, 64]), (Integrator::Rosenbrock, [16, 64, 256, 1024])];

/// Points of the net's domain at which they are tried.
const POINTS: u32 = 32;

/// At so many of them the plant may have no solution.
const WITHOUT_SOLUTION: usize = 3;

/// An integrator is accurate if twice the substeps change a step by this part of the net's error.
const ACCURATE: f64 = 0.05;

/// The cheapest integrator with its substeps that is accurate beside a distilled net of `plant` over
/// `t` seconds: at each of some points of the net's domain, twice the substeps change its step by little
/// against the net's error there, or against the median of these.
///
/// # Errors
///
/// [`VerifyError::NoReference`] if none of those that are tried is.
pub fn reference(
    net: &PincNet,
    plant: &dyn DynPlant,
    t: f64,
) -> Result<(Integrator, usize), VerifyError> {
    let mut model = PincModel::at(net, t).map_err(VerifyError::Net)?;
    let points = points(net);
    let predicted = Steps::of(&mut model, net, &points);
    let is_accurate = |method, substeps| {
        let steps = |substeps| {
            let mut exact = plant.model(method, t, substeps).ok()?;
            Some(Steps::of(&mut *exact, net, &points))
        };
        let (Some(coarse), Some(fine)) = (steps(substeps), steps(2 * substeps)) else {
            return false;
        };
        let errors = predicted.distances(&fine);
        let mut sorted = errors.clone();
        sorted.sort_by(f64::total_cmp);
        let typical = sorted[sorted.len() / 2];
        let changes = coarse.distances(&fine).into_iter().zip(errors);
        let (known, unknown): (Vec<_>, Vec<_>) =
            changes.partition(|(change, _)| change.is_finite());
        unknown.len() <= WITHOUT_SOLUTION
            && known.into_iter().all(|(change, error)| change <= ACCURATE * error.max(typical))
    };
    let tried = TRIED.into_iter().flat_map(|(method, all)| all.map(|substeps| (method, substeps)));
    let mut tried = tried.filter(|(method, substeps)| is_accurate(*method, *substeps));
    tried.next().ok_or(VerifyError::NoReference)
}

/// Points that spread evenly over the domain: multiples of the powers of 1 / g with g^(d + 1) = g + 1
/// (M. Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018).
fn points(net: &PincNet) -> Vec<Vec<f64>> {
    let ends: Vec<(f64, f64)> = net.domain().ends().collect();
    let mut g = 2.0_f64;
    for _ in 0..50 {
        g = (1.0 + g).powf(1.0 / (f64::from(u32::try_from(ends.len()).unwrap_or(u32::MAX)) + 1.0));
    }
    let place = |k: u32| {
        let mut part = 1.0;
        let at = ends.iter().map(|(low, high)| {
            part /= g;
            low + (high - low) * (0.5 + f64::from(k) * part).fract()
        });
        at.collect()
    };
    (0..POINTS).map(place).collect()
}

/// A model's steps from all points.
struct Steps {
    next: Vec<Vec<f64>>,
    /// The widths of the states' ranges.
    widths: Vec<f64>,
}

impl Steps {
    fn of(model: &mut dyn Model, net: &PincNet, points: &[Vec<f64>]) -> Self {
        let dims = net.dims();
        let step = |point: &Vec<f64>| {
            let (x, rest) = point.split_at(dims.nx);
            let (u, p) = rest.split_at(dims.nu);
            let mut next = vec![0.0; dims.nx];
            model.step(x, u, p, &mut next);
            next
        };
        let widths = net.domain().ends().take(dims.nx).map(|(low, high)| high - low).collect();
        Self { next: points.iter().map(step).collect(), widths }
    }

    /// How far the states are from others, in widths, at each point; NaN where one is no number.
    fn distances(&self, other: &Self) -> Vec<f64> {
        let one = |(a, b): (&Vec<f64>, &Vec<f64>)| {
            let parts = a.iter().zip(b).zip(&self.widths).map(|((a, b), width)| (a - b) / width);
            parts.map(|part| part * part).sum::<f64>().sqrt()
        };
        self.next.iter().zip(&other.next).map(one).collect()
    }
}
