//! Samples: collocation points and initial conditions.

use crate::Domain;
use crate::mlp::to_f64;
use crate::net::Scenario;
use pinc_ode::Dims;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};

/// How collocation points (t, y0, u, p) are distributed over \[0, T\] and the domain.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sampler {
    /// All coordinates uniform and independent: the paper's text.
    Independent,
    /// As many random (y0, u, p) as there are initial points, each on the same uniform grid of
    /// times with both ends: the authors' code.
    CoupledGrid,
    /// A scrambled Sobol sequence (Owen scrambling): low discrepancy.
    Sobol,
}

/// A set of points (t, y0, u, p).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Points {
    states: usize,
    inputs: usize,
    parameters: usize,
    t: Vec<f64>,
    y0: Vec<f64>,
    u: Vec<f64>,
    p: Vec<f64>,
}

/// The purpose of a stream of random numbers. Each purpose has a stream of its own, so that drawing
/// more numbers for one does not change the others.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Purpose {
    Weights = 1,
    Collocation = 2,
    Initial = 3,
    Validation = 4,
    OneStep = 5,
    Fresh = 6,
    Test = 7,
    TestOneStep = 8,
    Domain = 9,
    Directions = 10,
    FreshDirections = 11,
}

/// The random numbers of `seed` for `purpose`.
pub(crate) fn rng(seed: u64, purpose: Purpose) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(purpose as u64);
    rng
}

impl Points {
    /// No points yet, of a plant of these dimensions.
    #[must_use]
    pub fn new(dims: Dims) -> Self {
        Self { states: dims.nx, inputs: dims.nu, parameters: dims.np, ..Self::default() }
    }

    /// Appends the point (t, y0, u, p).
    ///
    /// # Panics
    ///
    /// If a length is not the plant's.
    pub fn push(&mut self, t: f64, y0: &[f64], u: &[f64], p: &[f64]) {
        assert_eq!(y0.len(), self.states, "length of y0");
        assert_eq!(u.len(), self.inputs, "length of u");
        assert_eq!(p.len(), self.parameters, "length of p");
        self.t.push(t);
        self.y0.extend_from_slice(y0);
        self.u.extend_from_slice(u);
        self.p.extend_from_slice(p);
    }

    /// Appends points of the same plant.
    pub fn extend(&mut self, others: &Self) {
        for i in 0..others.len() {
            self.push(others.time(i), others.state(i), others.input(i), others.parameters(i));
        }
    }

    /// Number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.t.len()
    }

    /// Whether there are no points.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.t.is_empty()
    }

    /// The time of point `i`, in s.
    #[must_use]
    pub fn time(&self, i: usize) -> f64 {
        self.t[i]
    }

    /// The initial state of point `i`.
    #[must_use]
    pub fn state(&self, i: usize) -> &[f64] {
        &self.y0[i * self.states..(i + 1) * self.states]
    }

    /// The input of point `i`.
    #[must_use]
    pub fn input(&self, i: usize) -> &[f64] {
        &self.u[i * self.inputs..(i + 1) * self.inputs]
    }

    /// The parameters of point `i`.
    #[must_use]
    pub fn parameters(&self, i: usize) -> &[f64] {
        &self.p[i * self.parameters..(i + 1) * self.parameters]
    }

    /// State, input and parameters of point `i` as other numbers.
    pub(crate) fn lifted<S>(&self, i: usize, lift: impl Fn(f64) -> S) -> [Vec<S>; 3] {
        let all = [self.state(i), self.input(i), self.parameters(i)];
        all.map(|values| values.iter().map(|v| lift(*v)).collect())
    }
}

impl Sampler {
    /// `count` collocation points over \[0, T\] and `domain`; `scenarios` is the number of (y0, u,
    /// p) of the coupled grid, which divides its points evenly among them (rounding the number of
    /// times up).
    #[must_use]
    pub fn collocation(
        self,
        count: usize,
        sample_time_s: f64,
        domain: &Domain,
        scenarios: usize,
        seed: u64,
    ) -> Points {
        self.sample(count, sample_time_s, domain, scenarios, seed, Purpose::Collocation)
    }

    pub(crate) fn sample(
        self,
        count: usize,
        sample_time_s: f64,
        domain: &Domain,
        scenarios: usize,
        seed: u64,
        purpose: Purpose,
    ) -> Points {
        let ends: Vec<_> = std::iter::once((0.0, sample_time_s)).chain(domain.ends()).collect();
        let mut points = Points::new(domain.dims());
        let mut random = rng(seed, purpose);
        match self {
            Self::Independent => {
                for _ in 0..count {
                    points.push_unit(&ends, || random.random());
                }
            }
            Self::Sobol => {
                let scramble: u32 = random.random();
                for i in 0..count {
                    let mut dimension = 0..;
                    points.push_unit(&ends, || sobol(i, dimension.next().unwrap_or(0), scramble));
                }
            }
            Self::CoupledGrid => {
                let scenarios = scenarios.max(1);
                let times = count.div_ceil(scenarios).max(2);
                for _ in 0..scenarios {
                    let draw = |&(l, h): &(f64, f64)| l + (h - l) * random.random::<f64>();
                    let values: Vec<f64> = ends[1..].iter().map(draw).collect();
                    for k in 0..times {
                        points.push_row(sample_time_s * to_f64(k) / to_f64(times - 1), &values);
                    }
                }
            }
        }
        points
    }

    /// `count` times over \[0, T\] for one scenario: the collocation points of a conventional PINN.
    #[must_use]
    pub fn scenario(
        self,
        count: usize,
        sample_time_s: f64,
        scenario: &Scenario,
        seed: u64,
    ) -> Points {
        let dims = Dims::new(scenario.initial_state.len(), scenario.input.len());
        let mut points = Points::new(dims);
        let mut random = rng(seed, Purpose::Collocation);
        let scramble: u32 = random.random();
        for i in 0..count {
            let unit = match self {
                Self::Independent => random.random(),
                Self::Sobol => sobol(i, 0, scramble),
                Self::CoupledGrid => to_f64(i) / to_f64(count.max(2) - 1),
            };
            points.push(sample_time_s * unit, &scenario.initial_state, &scenario.input, &[]);
        }
        points
    }
}

/// `count` initial conditions (t = 0) with random (y0, u, p) in `domain`.
#[must_use]
pub fn initial_conditions(count: usize, domain: &Domain, seed: u64) -> Points {
    let ends: Vec<_> = std::iter::once((0.0, 0.0)).chain(domain.ends()).collect();
    let mut points = Points::new(domain.dims());
    let mut random = rng(seed, Purpose::Initial);
    for _ in 0..count {
        points.push_unit(&ends, || random.random());
    }
    points
}

impl Points {
    /// Appends a point whose coordinates, in the order t, y0, u, p, come from \[0, 1).
    fn push_unit(&mut self, ends: &[(f64, f64)], mut unit: impl FnMut() -> f64) {
        let values: Vec<f64> =
            ends.iter().map(|&(low, high)| low + (high - low) * unit()).collect();
        self.push_row(values[0], &values[1..]);
    }

    /// Appends the point of time `t` and the numbers y0, u, p.
    fn push_row(&mut self, t: f64, numbers: &[f64]) {
        let (y0, rest) = numbers.split_at(self.states);
        let (u, p) = rest.split_at(self.inputs);
        self.push(t, y0, u, p);
    }
}

/// Coordinate `dimension` of point `i`. The generator has 2^16 points a scramble; further ones come
/// from further scrambles.
fn sobol(i: usize, dimension: u32, scramble: u32) -> f64 {
    const PERIOD: usize = 1 << 16;
    let index = u32::try_from(i % PERIOD).unwrap_or(0);
    let round = u32::try_from(i / PERIOD).unwrap_or(u32::MAX);
    f64::from(sobol_burley::sample(index, dimension, scramble.wrapping_add(round)))
}
