//! Problems and a model whose plans are differentiated.

use pinc_mpc::{Bounds, NmpcProblem, Tracked, Weights};
use pinc_ode::{Dims, Linearization, Model, Stages};

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

/// The paper's problem for the Van der Pol oscillator.
pub(crate) fn van_der_pol() -> NmpcProblem {
    let weights = Weights::uniform(vec![10.0; 2], vec![1.0]);
    NmpcProblem {
        state_bounds: Bounds { low: vec![-1.0; 2], high: vec![1.0; 2] },
        input_bounds: Bounds { low: vec![-1.0], high: vec![1.0] },
        ..NmpcProblem::new(Dims::new(2, 1), 5, weights)
    }
}

/// The paper's problem for the four tanks.
pub(crate) fn four_tanks() -> NmpcProblem {
    let weights = Weights::uniform(vec![10.0; 2], vec![1.0; 2]);
    NmpcProblem {
        tracked: Tracked::states([0, 1]),
        state_bounds: Bounds { low: vec![2.0, 2.0, 0.6, 0.6], high: vec![20.0, 20.0, 5.5, 5.5] },
        input_bounds: Bounds { low: vec![0.0; 2], high: vec![5.0; 2] },
        ..NmpcProblem::new(Dims::new(4, 2), 5, weights)
    }
}
