//! Helpers for tests of integrators: exact solutions, steps and a regression.

use pinc_ad::Scalar;
use pinc_ode::{Linearization, Model, Plant, Stages, Variable};

/// States after some time, by mpmath: see pinc-plants/tests/data/expected.py.
const FLOWS: &str = include_str!("../../../pinc-plants/tests/data/flows.csv");

/// A row of flows.csv.
pub(crate) struct Flow {
    pub(crate) x: Vec<f64>,
    pub(crate) u: Vec<f64>,
    pub(crate) duration_s: f64,
    pub(crate) end: Vec<f64>,
}

/// All rows of this plant.
pub(crate) fn flows(plant: &str) -> Vec<Flow> {
    let numbers = |field: &str| -> Vec<f64> {
        let parse = |v: &str| v.parse().expect("a number");
        field.split(' ').map(parse).collect()
    };
    let parse = |line: &str| {
        let fields: Vec<_> = line.split(',').collect();
        Flow {
            x: numbers(fields[1]),
            u: numbers(fields[2]),
            duration_s: numbers(fields[3])[0],
            end: numbers(fields[4]),
        }
    };
    let rows: Vec<_> =
        FLOWS.lines().filter(|line| line.split(',').next() == Some(plant)).map(parse).collect();
    assert!(!rows.is_empty(), "no flow of {plant}");
    rows
}

/// A damped oscillator with a force, x' = v, v' = u - 2 d v - (1 + d^2) x, which swings at 1 rad/s.
#[derive(Clone, Debug)]
pub(crate) struct Oscillator {
    pub(crate) damping: f64,
}

impl Plant for Oscillator {
    fn states(&self) -> &[Variable] {
        static VARIABLES: [Variable; 2] = [Variable::new("x", "m"), Variable::new("v", "m/s")];
        &VARIABLES
    }
    fn inputs(&self) -> &[Variable] {
        static VARIABLES: [Variable; 1] = [Variable::new("u", "m/s^2")];
        &VARIABLES
    }
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        let d = self.damping;
        dx[0] = x[1];
        dx[1] = u[0] - x[1] * (2.0 * d) - x[0] * (1.0 + d * d);
    }
}

impl Oscillator {
    /// The matrix exponential exp(A t), row by row.
    pub(crate) fn transition(&self, t: f64) -> [f64; 4] {
        let d = self.damping;
        let (s, c) = t.sin_cos();
        [c + d * s, s, -(1.0 + d * d) * s, c - d * s].map(|v| (-d * t).exp() * v)
    }

    /// The state after `t` seconds: it swings about the equilibrium (u / (1 + d^2), 0).
    pub(crate) fn exact(&self, x: &[f64], u: f64, t: f64) -> [f64; 2] {
        let [a, b, c, d] = self.transition(t);
        let rest = u / (1.0 + self.damping * self.damping);
        let from_rest = x[0] - rest;
        [rest + a * from_rest + b * x[1], c * from_rest + d * x[1]]
    }
}

/// The slope of the line that fits (log x, log y) best, by least squares.
pub(crate) fn log_slope(points: &[(f64, f64)]) -> f64 {
    assert!(points.len() >= 4, "too few points for a regression: {points:?}");
    let count = points.iter().fold(0.0, |n, _| n + 1.0);
    let logs = || points.iter().map(|(x, y)| (x.ln(), y.ln()));
    let mean_x = logs().map(|(x, _)| x).sum::<f64>() / count;
    let mean_y = logs().map(|(_, y)| y).sum::<f64>() / count;
    let covariance: f64 = logs().map(|(x, y)| (x - mean_x) * (y - mean_y)).sum();
    covariance / logs().map(|(x, _)| (x - mean_x).powi(2)).sum::<f64>()
}

/// The largest difference of two states.
pub(crate) fn distance(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let differences = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    differences.fold(0.0, |worst, d| if d.is_nan() { d } else { f64::max(worst, d) })
}

/// The state after a step.
pub(crate) fn predict(model: &mut (impl Model + ?Sized), x: &[f64], u: &[f64]) -> Vec<f64> {
    let mut next = vec![f64::NAN; x.len()];
    model.step(x, u, &[], &mut next);
    next
}

/// f(x, u), df/dx and df/du.
pub(crate) fn linearize(model: &mut (impl Model + ?Sized), x: &[f64], u: &[f64]) -> [Vec<f64>; 3] {
    let (n, m) = (x.len(), u.len());
    let [mut next, mut a, mut b] = [n, n * n, n * m].map(|len| vec![f64::NAN; len]);
    model.linearize(
        Stages { x, u, p: &[] },
        Linearization { next: &mut next, a: &mut a, b: &mut b, e: &mut [] },
    );
    [next, a, b]
}

/// The order of a method, made with a number of substeps, by regression of the errors against `end`
/// with 2, 3, 4, 6, 8, .. 3072 of them, down to rounding: without those above 1e-5, where the step
/// is still too long for the leading term to rule, and those below 1e-12, where rounding (1e-16 a
/// substep) is more than a few per cent. At least five errors are left, so that an error that is
/// off by a quarter at one end of the line changes its slope by less than 0.15.
pub(crate) fn order<M: Model + ?Sized>(
    method: impl Fn(usize) -> Box<M>,
    x: &[f64],
    u: &[f64],
    end: &[f64],
) -> f64 {
    let substeps = (1..12).flat_map(|k| [2 << (k - 1), 3 << (k - 1)]);
    let errors: Vec<_> = substeps
        .map(|substeps: u32| {
            let mut method = method(usize::try_from(substeps).expect("a small number"));
            let error = distance(&predict(&mut *method, x, u), end);
            (method.sample_time_s() / f64::from(substeps), error)
        })
        .filter(|(_, error)| (1e-12..1e-5).contains(error))
        .collect();
    let smallest = errors.iter().fold(f64::INFINITY, |s, (_, e)| s.min(*e));
    assert!(errors.len() >= 5 && smallest < 2e-11, "not down to rounding: {errors:?}");
    log_slope(&errors)
}
