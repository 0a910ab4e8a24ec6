//! The box that is examined.

use super::steady::Point;
use crate::spec::Experiment;
use pinc_ode::Dims;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// A box of states and inputs.
pub(super) struct Region {
    pub(super) name: &'static str,
    pub(super) dims: Dims,
    /// States, then inputs.
    pub(super) low: Vec<f64>,
    pub(super) high: Vec<f64>,
}

impl Region {
    /// The training domain, or else the controller's bounds. A state without bounds has the range of the
    /// start and the references, or 1 about the start.
    pub(super) fn of(experiment: &Experiment, dims: Dims) -> Option<Self> {
        if let Some(domain) = &experiment.domain {
            let low = [&domain.state_low[..], &domain.input_low].concat();
            let high = [&domain.state_high[..], &domain.input_high].concat();
            return Some(Self { name: "the training domain", dims, low, high });
        }
        let control = experiment.control.as_ref()?;
        let variables = experiment.plant.variables().state_names();
        let (mut low, mut high) = (control.initial_state.clone(), control.initial_state.clone());
        for reference in &control.references {
            for (name, &value) in control.controlled.iter().zip(&reference.value) {
                if let Some(i) = variables.iter().position(|state| state == name) {
                    (low[i], high[i]) = (low[i].min(value), high[i].max(value));
                }
            }
        }
        for (low, high) in low.iter_mut().zip(&mut high).filter(|(low, high)| low >= high) {
            (*low, *high) = (*low - 0.5, *high + 0.5);
        }
        low = control.state_low.clone().unwrap_or(low);
        high = control.state_high.clone().unwrap_or(high);
        low.extend(&control.input_low);
        high.extend(&control.input_high);
        Some(Self { name: "the controller's bounds", dims, low, high })
    }

    /// The size of variable `i`, states first: what its errors are measured in.
    pub(super) fn width(&self, i: usize) -> f64 {
        let width = self.high[i] - self.low[i];
        if width > 0.0 { width } else { 1.0 }
    }

    /// The middle.
    pub(super) fn centre(&self) -> Point {
        let ends = self.low.iter().zip(&self.high);
        self.split(ends.map(|(low, high)| f64::midpoint(*low, *high)).collect())
    }

    /// Random points.
    pub(super) fn points(&self, seed: u64) -> impl Iterator<Item = Point> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        std::iter::repeat_with(move || {
            let ends = self.low.iter().zip(&self.high);
            self.split(ends.map(|(low, high)| low + (high - low) * rng.random::<f64>()).collect())
        })
    }

    /// Points where functions are most likely to break: with one variable at an end or at 0, the others in
    /// the middle, and the two outermost corners.
    pub(super) fn special_points(&self) -> Vec<Point> {
        let middle = self.centre().joined();
        let mut points = vec![self.split(self.low.clone()), self.split(self.high.clone())];
        for i in 0..middle.len() {
            let inside = |v: &f64| (self.low[i]..=self.high[i]).contains(v);
            for value in [self.low[i], self.high[i], 0.0].into_iter().filter(inside) {
                let mut point = middle.clone();
                point[i] = value;
                points.push(self.split(point));
            }
        }
        points
    }

    /// Whether two points are one, to a millionth of the box.
    pub(super) fn same(&self, one: &Point, other: &Point) -> bool {
        let pairs = one.joined().into_iter().zip(other.joined()).enumerate();
        pairs.into_iter().all(|(i, (a, b))| (a - b).abs() <= 1e-6 * self.width(i))
    }

    pub(super) fn split(&self, mut x: Vec<f64>) -> Point {
        let u = x.split_off(self.dims.nx);
        Point { x, u }
    }
}
