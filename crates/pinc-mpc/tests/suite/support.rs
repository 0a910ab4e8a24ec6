//! Models, problems and constraints that several tests use.

use pinc_ad::Scalar;
use pinc_mpc::{NmpcProblem, Weights};
use pinc_ode::{Dims, Linearization, Model, Plant, Stages, Variable};

/// x' = rate (u - x) with two outputs at most, c x or c x + u: c, and whether u is added.
#[derive(Clone, Debug)]
pub(crate) struct Lag {
    pub(crate) rate: f64,
    pub(crate) outputs: &'static [(f64, bool)],
}

impl Plant for Lag {
    fn states(&self) -> &[Variable] {
        static VARIABLES: [Variable; 1] = [Variable::new("x", "")];
        &VARIABLES
    }

    fn inputs(&self) -> &[Variable] {
        static VARIABLES: [Variable; 1] = [Variable::new("u", "")];
        &VARIABLES
    }

    fn outputs(&self) -> &[Variable] {
        static VARIABLES: [Variable; 2] = [Variable::new("y1", ""), Variable::new("y2", "")];
        &VARIABLES[..self.outputs.len()]
    }

    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        dx[0] = (u[0] - x[0]) * self.rate;
    }

    fn output<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], y: &mut [S]) {
        for (y, &(c, adds)) in y.iter_mut().zip(self.outputs) {
            *y = if adds { x[0] * c + u[0] } else { x[0] * c };
        }
    }
}

/// x\[k+1\] = A x\[k\] + B u\[k\]
#[derive(Clone, Debug)]
pub(crate) struct Linear {
    pub(crate) dims: Dims,
    pub(crate) a: Vec<f64>,
    pub(crate) b: Vec<f64>,
}

impl Linear {
    /// One state, one input.
    pub(crate) fn scalar(a: f64, b: f64) -> Self {
        let dims = Dims::new(1, 1);
        Self { dims, a: vec![a], b: vec![b] }
    }
}

impl Model for Linear {
    fn dims(&self) -> Dims {
        self.dims
    }

    fn sample_time_s(&self) -> f64 {
        1.0
    }

    fn step(&mut self, x: &[f64], u: &[f64], _p: &[f64], next: &mut [f64]) {
        let a = self.a.chunks_exact(x.len());
        let b = self.b.chunks_exact(u.len());
        for ((next, a), b) in next.iter_mut().zip(a).zip(b) {
            let product =
                |row: &[f64], v: &[f64]| -> f64 { row.iter().zip(v).map(|(row, v)| row * v).sum() };
            *next = product(a, x) + product(b, u);
        }
    }

    fn linearize(&mut self, at: Stages<'_>, mut out: Linearization<'_>) {
        for k in 0..at.count(self.dims) {
            let (at, out) = (at.point(k, self.dims), out.point(k, self.dims));
            self.step(at.x, at.u, at.p, out.next);
            out.a.copy_from_slice(&self.a);
            out.b.copy_from_slice(&self.b);
        }
    }
}

/// A problem with one state and one input, no bounds, q = 2 and r = 3.
pub(crate) fn scalar_problem(last: usize, control: usize) -> NmpcProblem {
    let weights = Weights::uniform(vec![2.0], vec![3.0]);
    NmpcProblem { control_horizon: control, ..NmpcProblem::new(Dims::new(1, 1), last, weights) }
}
