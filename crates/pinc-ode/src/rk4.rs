//! The classical Runge-Kutta method of order 4.

use crate::{Dims, Plant, Predictor};
use pinc_ad::{Dual, Scalar};

/// Directions of differentiation that go through the method together.
const DIRECTIONS: usize = 4;

/// The classical Runge-Kutta method with a fixed number of substeps, as a [`Predictor`]:
///
/// ```text
/// 0   |
/// 1/2 | 1/2
/// 1/2 | 0    1/2        x+ = x + h (k1 + 2 k2 + 2 k3 + k4) / 6,   h = T / substeps
/// 1   | 0    0    1
/// ----+--------------------
///     | 1/6  1/3  1/3  1/6
/// ```
///
/// The Jacobians are those of the method itself, exact to rounding, by dual numbers through it.
/// Global error O(h^4). Reference: Hairer, Norsett, Wanner, *Solving Ordinary Differential Equations
/// I*, table II.1.2.
#[derive(Clone, Debug)]
pub struct Rk4<P> {
    plant: P,
    dims: Dims,
    horizon_s: f64,
    substeps: usize,
    value: Workspace<f64>,
    tangent: Workspace<Dual<f64, DIRECTIONS>>,
}

impl<P: Plant> Rk4<P> {
    /// The method over steps of `horizon_s` seconds, each in `substeps` parts.
    ///
    /// # Panics
    ///
    /// If `horizon_s` is not positive and finite or `substeps` is 0.
    #[must_use]
    pub fn new(plant: P, horizon_s: f64, substeps: usize) -> Self {
        assert!(horizon_s > 0.0 && horizon_s.is_finite(), "the step must be positive");
        assert!(substeps > 0, "at least one substep");
        let dims = plant.dims();
        let value = Workspace::new(dims, 0.0);
        let tangent = Workspace::new(dims, Dual::lift(0.0));
        Self { plant, dims, horizon_s, substeps, value, tangent }
    }

    /// The number of substeps a step is divided into.
    #[must_use]
    pub fn substeps(&self) -> usize {
        self.substeps
    }
}

impl<P: Plant> Predictor for Rk4<P> {
    fn dims(&self) -> Dims {
        self.dims
    }

    fn horizon_s(&self) -> f64 {
        self.horizon_s
    }

    fn predict(&mut self, x: &[f64], u: &[f64], next: &mut [f64]) {
        self.value.x.copy_from_slice(x);
        self.value.u.copy_from_slice(u);
        self.value.run(&self.plant, self.horizon_s, self.substeps);
        next.copy_from_slice(&self.value.x);
    }

    fn linearize(&mut self, x: &[f64], u: &[f64], next: &mut [f64], a: &mut [f64], b: &mut [f64]) {
        let Dims { states: n, inputs: m } = self.dims;
        assert!(x.len() == n && u.len() == m && next.len() == n, "lengths of x, u, next");
        assert!(a.len() == n * n && b.len() == n * m, "lengths of a, b");
        for first in (0..n + m).step_by(DIRECTIONS) {
            let seed = |value: f64, column: usize| {
                Dual::variable(value, column.checked_sub(first).unwrap_or(DIRECTIONS))
            };
            for (j, (to, &value)) in self.tangent.x.iter_mut().zip(x).enumerate() {
                *to = seed(value, j);
            }
            for (j, (to, &value)) in self.tangent.u.iter_mut().zip(u).enumerate() {
                *to = seed(value, n + j);
            }
            self.tangent.run(&self.plant, self.horizon_s, self.substeps);
            for (i, result) in self.tangent.x.iter().enumerate() {
                next[i] = result.re;
                for (column, &derivative) in (first..n + m).zip(&result.eps) {
                    if column < n {
                        a[i * n + column] = derivative;
                    } else {
                        b[i * m + column - n] = derivative;
                    }
                }
            }
        }
    }
}

/// State and stages of the method on one kind of number.
#[derive(Clone, Debug)]
struct Workspace<S> {
    x: Vec<S>,
    u: Vec<S>,
    stage: Vec<S>,
    k: [Vec<S>; 4],
}

impl<S: Scalar> Workspace<S> {
    fn new(dims: Dims, zero: S) -> Self {
        let n = vec![zero; dims.states];
        let k = std::array::from_fn(|_| n.clone());
        Self { x: n.clone(), u: vec![zero; dims.inputs], stage: n, k }
    }

    /// Advances `self.x` by `duration` seconds in `substeps` steps.
    fn run<P: Plant>(&mut self, plant: &P, duration: f64, substeps: usize) {
        #[expect(clippy::cast_precision_loss, reason = "a number of substeps is far below 2^53")]
        let h = duration / substeps as f64;
        for _ in 0..substeps {
            self.step(plant, h);
        }
    }

    fn step<P: Plant>(&mut self, plant: &P, h: f64) {
        let Self { x, u, stage, k: [k1, k2, k3, k4] } = self;
        plant.rhs(x, u, k1);
        advance(stage, x, h / 2.0, k1);
        plant.rhs(stage, u, k2);
        advance(stage, x, h / 2.0, k2);
        plant.rhs(stage, u, k3);
        advance(stage, x, h, k3);
        plant.rhs(stage, u, k4);
        for (i, x) in x.iter_mut().enumerate() {
            *x = *x + (k1[i] + k4[i] + (k2[i] + k3[i]) * 2.0) * (h / 6.0);
        }
    }
}

/// stage = x + h k
fn advance<S: Scalar>(stage: &mut [S], x: &[S], h: f64, k: &[S]) {
    for ((stage, &x), &k) in stage.iter_mut().zip(x).zip(k) {
        *stage = x + k * h;
    }
}
