//! The evolution strategy with covariance matrix adaptation (CMA-ES) in the unit cube.
//!
//! Source: N. Hansen, "The CMA Evolution Strategy: A Tutorial" (2016), arXiv:1604.00772. Two things
//! differ: the covariance is sampled through its Cholesky factor, whose standard normal numbers also
//! move the path of the step size, as in O. Krause et al., "CMA-ES with Optimal Covariance Update and
//! Storage Complexity" (2016); and points beyond the cube are mirrored at its surface, so that a minimum
//! there is one inside.

use rand::rngs::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// The first step size, in widths of the cube.
const FIRST_STEP: f64 = 0.25;

/// A run ends once its step size is below this: where a minimum at the surface makes the cost linear
/// in one direction, the others, in which it is quadratic, are settled to the root of this.
const LAST_STEP: f64 = 1e-4;

/// Candidates drawn around a mean, which moves to the better ones.
#[derive(Debug)]
pub(super) struct Evolution {
    /// Candidates of a generation.
    population: usize,
    mean: Vec<f64>,
    /// The step size sigma.
    step: f64,
    /// The covariance, row by row, and its Cholesky factor.
    covariance: Vec<f64>,
    factor: Vec<f64>,
    /// The paths of the covariance and of the step size.
    path: Vec<f64>,
    step_path: Vec<f64>,
    generations: i32,
}

/// A candidate's place, the point that it mirrors, and the standard normal numbers of that.
pub(super) struct Drawn {
    pub(super) place: Vec<f64>,
    point: Vec<f64>,
    normal: Vec<f64>,
}

impl Evolution {
    /// Begins at `mean`, with `4 + 3 ln n` candidates a generation times `size`.
    pub(super) fn new(mean: Vec<f64>, size: usize) -> Self {
        let n = mean.len();
        let mut identity = vec![0.0; n * n];
        identity.iter_mut().step_by(n + 1).for_each(|entry| *entry = 1.0);
        #[expect(clippy::cast_possible_truncation, reason = "a few candidates")]
        let usual = 4 + (3.0 * (n as f64).ln()) as usize;
        Self {
            population: usual * size,
            mean,
            step: FIRST_STEP,
            covariance: identity.clone(),
            factor: identity,
            path: vec![0.0; n],
            step_path: vec![0.0; n],
            generations: 0,
        }
    }

    /// Whether the candidates hardly differ any more.
    pub(super) fn is_over(&self) -> bool {
        let n = self.mean.len();
        let widest = (0..n).map(|i| self.covariance[i * n + i]).fold(0.0, f64::max).sqrt();
        let size = self.step * widest;
        size.is_nan() || size < LAST_STEP
    }

    /// Draws a generation.
    pub(super) fn draw(&self, random: &mut ChaCha8Rng) -> Vec<Drawn> {
        let n = self.mean.len();
        let mut one = || {
            let normal: Vec<f64> = StandardNormal.sample_iter(&mut *random).take(n).collect();
            let point = (0..n).map(|i| {
                let row = self.factor[i * n..=i * n + i].iter().zip(&normal);
                let moved: f64 = row.map(|(entry, normal)| entry * normal).sum();
                self.mean[i] + self.step * moved
            });
            let point: Vec<f64> = point.collect();
            Drawn { place: point.iter().map(|v| mirrored(*v)).collect(), point, normal }
        };
        (0..self.population).map(|_| one()).collect()
    }

    /// Moves to the better half of a generation, which is sorted, the best first.
    pub(super) fn learn(&mut self, sorted: &[&Drawn]) {
        let n = self.mean.len();
        let size = n as f64;
        let better = (sorted.len() / 2).max(1);
        let raw: Vec<f64> =
            (1..=better).map(|i| (better as f64 + 0.5).ln() - (i as f64).ln()).collect();
        let sum: f64 = raw.iter().sum();
        let weights: Vec<f64> = raw.iter().map(|weight| weight / sum).collect();
        let effective = 1.0 / weights.iter().map(|weight| weight * weight).sum::<f64>();
        // The rates of the tutorial's Table 1.
        let step_rate = (effective + 2.0) / (size + effective + 5.0);
        let damping =
            1.0 + 2.0 * (((effective - 1.0) / (size + 1.0)).sqrt() - 1.0).max(0.0) + step_rate;
        let path_rate = (4.0 + effective / size) / (size + 4.0 + 2.0 * effective / size);
        let one_rate = 2.0 / ((size + 1.3).powi(2) + effective);
        let many_rate = (1.0 - one_rate)
            .min(2.0 * (effective - 2.0 + 1.0 / effective) / ((size + 2.0).powi(2) + effective));
        let length = size.sqrt() * (1.0 - 1.0 / (4.0 * size) + 1.0 / (21.0 * size * size));
        let pairs = || weights.iter().zip(sorted);
        let mean_of = |of: &dyn Fn(&Drawn) -> f64| -> f64 {
            pairs().map(|(weight, drawn)| weight * of(drawn)).sum()
        };
        let before = self.mean.clone();
        let steps: Vec<f64> =
            (0..n).map(|i| mean_of(&|of| (of.point[i] - before[i]) / self.step)).collect();
        self.generations += 1;
        let keep = (step_rate * (2.0 - step_rate) * effective).sqrt();
        for (i, value) in self.step_path.iter_mut().enumerate() {
            *value = (1.0 - step_rate) * *value + keep * mean_of(&|of| of.normal[i]);
        }
        let norm = self.step_path.iter().map(|value| value * value).sum::<f64>().sqrt();
        let filled = (1.0 - (1.0 - step_rate).powi(2 * self.generations)).sqrt();
        let is_short = norm / filled < (1.4 + 2.0 / (size + 1.0)) * length;
        let keep = if is_short { (path_rate * (2.0 - path_rate) * effective).sqrt() } else { 0.0 };
        for (i, value) in self.path.iter_mut().enumerate() {
            *value = (1.0 - path_rate) * *value + keep * steps[i];
        }
        let lost = if is_short { 0.0 } else { one_rate * path_rate * (2.0 - path_rate) };
        for i in 0..n {
            for j in 0..n {
                let spread = mean_of(&|of| {
                    let moved = |i: usize| (of.point[i] - before[i]) / self.step;
                    moved(i) * moved(j)
                });
                let entry = &mut self.covariance[i * n + j];
                *entry = (1.0 - one_rate - many_rate + lost) * *entry
                    + one_rate * self.path[i] * self.path[j]
                    + many_rate * spread;
            }
            self.mean[i] = before[i] + self.step * steps[i];
        }
        self.step *= ((step_rate / damping) * (norm / length - 1.0)).min(1.0).exp();
        self.factor = factored(&self.covariance, n);
    }
}

/// The Cholesky factor of a covariance; a direction without spread stays one.
fn factored(covariance: &[f64], n: usize) -> Vec<f64> {
    let mut factor = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let products = (0..j).map(|k| factor[i * n + k] * factor[j * n + k]);
            let left = covariance[i * n + j] - products.sum::<f64>();
            factor[i * n + j] = match (i == j, factor[j * n + j]) {
                (true, _) => left.max(0.0).sqrt(),
                (false, pivot) if pivot > 0.0 => left / pivot,
                (false, _) => 0.0,
            };
        }
    }
    factor
}

/// The coordinate within 0 and 1 that a point shows in mirrors at both.
fn mirrored(value: f64) -> f64 {
    let around = value.rem_euclid(2.0);
    if around > 1.0 { 2.0 - around } else { around }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    fn mirrored_all(mean: &[f64]) -> Vec<f64> {
        mean.iter().map(|v| mirrored(*v)).collect()
    }

    fn minimum(cost: impl Fn(&[f64]) -> f64, generations: usize) -> (Vec<f64>, usize) {
        let mut random = ChaCha8Rng::seed_from_u64(4);
        let mut evolution = Evolution::new(vec![0.9, 0.2, 0.5], 1);
        for done in 0..generations {
            if evolution.is_over() {
                return (mirrored_all(&evolution.mean), done);
            }
            let drawn = evolution.draw(&mut random);
            let mut sorted: Vec<&Drawn> = drawn.iter().collect();
            sorted.sort_by(|a, b| cost(&a.place).total_cmp(&cost(&b.place)));
            evolution.learn(&sorted);
        }
        (mirrored_all(&evolution.mean), generations)
    }

    /// An ellipsoid turned against the axes, a hundred times longer than wide.
    #[test]
    fn an_ellipsoids_center_is_found() {
        let cost = |v: &[f64]| {
            let [a, b, c] = [v[0] - 0.3, v[1] - 0.6, v[2] - 0.45];
            (a + b).powi(2) + 1e4 * (a - b).powi(2) + 10.0 * (c + a).powi(2)
        };
        let (found, generations) = minimum(cost, 400);
        assert!(generations < 400);
        for (found, expected) in found.iter().zip([0.3, 0.6, 0.45]) {
            assert!((found - expected).abs() < 5e-3, "{found} is not {expected}");
        }
    }

    #[test]
    fn points_beyond_the_cube_are_mirrored_at_its_surface() {
        let places = [(0.3, 0.3), (-0.2, 0.2), (1.3, 0.7), (2.1, 0.1), (-1.4, 0.6), (1.0, 1.0)];
        for (point, place) in places {
            assert!((mirrored(point) - place).abs() < 1e-12, "{point}");
        }
    }

    #[test]
    fn a_minimum_at_the_surface_of_the_cube_is_found() {
        let (found, _) = minimum(|v| v[0] + (v[1] - 0.5).powi(2) - v[2], 200);
        assert!(found[0] < 0.01 && (found[1] - 0.5).abs() < 0.01 && found[2] > 0.99, "{found:?}");
    }

    /// Three generations of given numbers, the third of which drives the path so far that it is cut
    /// off and the step grows by its limit. Python, with the equations (5) to (47) of the tutorial.
    #[test]
    fn a_generation_moves_mean_step_and_covariance_as_the_tutorial_has_it() {
        let mut evolution = Evolution::new(vec![0.5, 0.4], 1);
        assert_eq!(evolution.population, 6);
        let rest = [[0.0; 2]; 3];
        let generations = [
            [[1.0, -0.5], [0.25, 0.75], [-0.5, 1.5]],
            [[-1.25, 0.5], [0.5, 0.25], [0.75, -1.0]],
            [[4.0, 3.5], [3.5, 4.0], [3.0, 3.75]],
        ];
        for normals in generations {
            let drawn = normals.iter().chain(&rest).map(|normal| {
                let f = &evolution.factor;
                let moved = [f[0] * normal[0], f[2] * normal[0] + f[3] * normal[1]];
                let point = [0, 1].map(|i| evolution.mean[i] + evolution.step * moved[i]).to_vec();
                Drawn { place: point.clone(), point, normal: normal.to_vec() }
            });
            let drawn: Vec<Drawn> = drawn.collect();
            evolution.learn(&drawn.iter().collect::<Vec<_>>());
        }
        let near = |found: &[f64], expected: &[f64]| {
            let mut pairs = found.iter().zip(expected);
            let is_near = pairs.all(|(a, b)| (a - b).abs() < 1e-12 * b.abs().max(1.0));
            assert!(is_near, "{found:?}, not {expected:?}");
        };
        near(&evolution.mean, &[1.172525153425287, 0.9736752098106808]);
        near(&[evolution.step], &[0.4993124104998094]);
        near(
            &evolution.covariance,
            &[1.4684927202516516, 0.4869317507350123, 0.4869317507350123, 1.0687642458670905],
        );
        near(&evolution.step_path, &[4.334459520190736, 4.551758766805436]);
        near(&evolution.path, &[-0.16261340062456447, 0.14666411024719792]);
    }

    /// A search is over where no coordinate's spread is a ten-thousandth of the cube any more.
    #[test]
    fn a_search_is_over_once_all_its_spreads_are_small() {
        let mut evolution = Evolution::new(vec![0.5; 2], 1);
        assert!(!evolution.is_over());
        evolution.step = 0.9e-4;
        assert!(evolution.is_over());
        evolution.covariance = vec![0.01, 0.0, 0.0, 1.3];
        assert!(!evolution.is_over());
        evolution.step = f64::NAN;
        assert!(evolution.is_over());
    }

    /// What is drawn has the covariance of the search, about its mean.
    #[test]
    fn candidates_are_drawn_with_the_covariance() {
        let mut evolution = Evolution::new(vec![0.5, 0.5], 4000);
        evolution.step = 0.05;
        evolution.covariance = vec![1.0, 0.6, 0.6, 2.0];
        evolution.factor = factored(&evolution.covariance, 2);
        let drawn = evolution.draw(&mut ChaCha8Rng::seed_from_u64(1));
        assert_eq!(drawn.len(), 24_000);
        let count = 24_000.0;
        let mean = |of: &dyn Fn(&Drawn) -> f64| drawn.iter().map(of).sum::<f64>() / count;
        // Four standard errors: 0.05 sqrt(2 / 24000) and 0.05^2 2 sqrt(2 / 24000).
        for i in 0..2 {
            assert!((mean(&|of| of.point[i]) - 0.5).abs() < 2e-3);
            for j in 0..2 {
                let found = mean(&|of| (of.point[i] - 0.5) * (of.point[j] - 0.5));
                let expected = 0.0025 * evolution.covariance[2 * i + j];
                assert!((found - expected).abs() < 2e-4, "{i} {j}: {found}, not {expected}");
            }
        }
        assert!(drawn.iter().all(|of| of.place.iter().all(|v| (0.0..=1.0).contains(v))));
    }
}
