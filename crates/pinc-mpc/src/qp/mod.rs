//! The quadratic program of one SQP iteration.

mod clarabel;

pub(crate) use self::clarabel::ClarabelQp;

use crate::Bounds;
use crate::cost::{Cost, Targets};
use crate::solution::{Shape, Solution};
use pinc_ode::Predictor;

/// The control problem linearised at a point z, in the unknown step `d = (dx_1, .., du_0, ..)`:
///
/// ```text
/// min  g'd + d'H d / 2
/// s.t. dx_{j+1} = A_j dx_j + B_j du_j + c_j,    dx_0 = 0,    c_j = f(x_j, u_j) - x_{j+1}
///      low <= d <= high
/// ```
///
/// H, the Hessian of the cost, is that of Gauss and Newton: it leaves out the curvature of the
/// dynamics. The cost being quadratic, H is constant and not stored here.
#[derive(Clone, Debug)]
pub(crate) struct Qp {
    pub(crate) shape: Shape,
    /// `A_j`, `[N, n, n]`.
    pub(crate) a: Vec<f64>,
    /// `B_j`, `[N, n, m]`.
    pub(crate) b: Vec<f64>,
    /// `c_j`, `[N, n]`.
    pub(crate) c: Vec<f64>,
    /// g, as long as z.
    pub(crate) gradient: Vec<f64>,
    /// The bounds less z.
    pub(crate) room: Bounds,
}

/// How the solution of a [`Qp`] ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum QpStatus {
    Solved,
    Infeasible,
    Failed,
}

impl Qp {
    pub(crate) fn new(shape: Shape) -> Self {
        let Shape { states, inputs, stages, .. } = shape;
        Self {
            shape,
            a: vec![0.0; stages * states * states],
            b: vec![0.0; stages * states * inputs],
            c: vec![0.0; stages * states],
            gradient: vec![0.0; shape.unknowns()],
            room: Bounds::none(shape.unknowns()),
        }
    }

    /// `A_j`, `[n, n]`.
    pub(crate) fn a(&self, j: usize) -> &[f64] {
        let size = self.shape.states * self.shape.states;
        &self.a[j * size..(j + 1) * size]
    }

    /// `B_j`, `[n, m]`.
    pub(crate) fn b(&self, j: usize) -> &[f64] {
        let size = self.shape.states * self.shape.inputs;
        &self.b[j * size..(j + 1) * size]
    }

    /// Linearises the problem of a plant measured to be at `x0` at the point `at`.
    pub(crate) fn linearize(
        &mut self,
        model: &mut dyn Predictor,
        cost: &Cost,
        bounds: &Bounds,
        x0: &[f64],
        targets: Targets<'_>,
        at: &Solution,
    ) {
        self.linearize_dynamics(model, x0, &at.z);
        cost.gradient(&at.z, targets, &mut self.gradient);
        for (v, &z) in at.z.iter().enumerate() {
            self.room.low[v] = bounds.low[v] - z;
            self.room.high[v] = bounds.high[v] - z;
        }
    }

    fn linearize_dynamics(&mut self, model: &mut dyn Predictor, x0: &[f64], z: &[f64]) {
        let shape = self.shape;
        let stages = self.a.chunks_exact_mut(shape.states * shape.states);
        let stages = stages.zip(self.b.chunks_exact_mut(shape.states * shape.inputs));
        let stages = stages.zip(self.c.chunks_exact_mut(shape.states));
        for (j, ((a, b), c)) in stages.enumerate() {
            let x = shape.state(j).map_or(x0, |range| &z[range]);
            let u = &z[shape.input(shape.acting(j))];
            model.linearize(x, u, c, a, b);
            for (c, next) in c.iter_mut().zip(&z[shape.next_state(j)]) {
                *c -= next;
            }
        }
    }
}
