//! The exchange between a controller and its tube.

use pinc_ode::{Dims, Stages};
use std::fmt::Debug;

/// Says how far the plant may be from a plan, as its controller sees it.
pub trait Tube: Debug + Send {
    /// Writes how far each bound moves inwards. The controller neglects the derivatives of these
    /// numbers by the plan. It allocates nothing.
    fn write(&mut self, along: AlongPlan<'_>, back_offs: &mut BackOffs);

    /// Takes the covariance of the state that the next plan begins at and of the parameters of the
    /// controller's model, `[n + np, n + np]`.
    fn set_covariance(&mut self, covariance: &[f64]);

    /// How many of the first quadratic programs of a step have bounds that are tightened anew. The
    /// first one's are tightened along the plan of the step before, or if `is_first` there is none and
    /// they follow a guess; later ones' along their own.
    fn programs(&self, is_first: bool) -> usize {
        let _ = is_first;
        1
    }
}

/// A model along a plan.
#[derive(Clone, Copy, Debug)]
pub struct AlongPlan<'a> {
    stages: Stages<'a>,
    jacobians: [&'a [f64]; 2],
    dims: Dims,
    shift: usize,
}

impl<'a> AlongPlan<'a> {
    /// The model of dimensions `dims` at the N stages of a plan that is to be moved on by `shift`
    /// stages, of which the last takes the place of those that are missing.
    ///
    /// # Shapes
    ///
    /// A: `[N, n, n]`; B: `[N, n, m]`.
    #[must_use]
    pub fn new(stages: Stages<'a>, [a, b]: [&'a [f64]; 2], dims: Dims, shift: usize) -> Self {
        Self { stages, jacobians: [a, b], dims, shift }
    }

    /// N, the number of stages.
    #[must_use]
    pub fn stages(&self) -> usize {
        self.stages.x.len() / self.dims.nx
    }

    /// Where stage `j` begins, and A, `[n, n]`, and B, `[n, m]`, there.
    #[must_use]
    pub fn stage(&self, j: usize) -> (Stages<'a>, [&'a [f64]; 2]) {
        let (j, Dims { nx, nu, .. }) = ((j + self.shift).min(self.stages() - 1), self.dims);
        let [a, b] = self.jacobians;
        let b = &b[j * nx * nu..(j + 1) * nx * nu];
        (self.stages.point(j, self.dims), [&a[j * nx * nx..(j + 1) * nx * nx], b])
    }
}

/// How far bounds move inwards, 0 or more.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BackOffs {
    /// At the predicted states, `[N, n]`.
    pub states: Vec<f64>,
    /// At the free inputs, `[Nu, m]`.
    pub inputs: Vec<f64>,
    /// At the outputs of the predicted states, under the inputs that lead there, `[N, ny]`; empty if
    /// none has bounds.
    pub outputs: Vec<f64>,
    /// At the outputs where these inputs begin to act, `[N, ny]`; empty if no bound depends on them.
    pub starts: Vec<f64>,
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With a delay, stage j of the tube is a later one of the plan; the last one goes on.
    #[test]
    fn stages_are_shifted_and_end_with_the_last() {
        let stages = Stages { x: &[0.1, 0.2, 0.3], u: &[1.0, 2.0, 3.0], p: &[] };
        let (a, b) = ([4.0, 5.0, 6.0], [7.0, 8.0, 9.0]);
        let along = AlongPlan::new(stages, [&a, &b], Dims::new(1, 1), 1);
        for (j, at) in [(0, 1), (1, 2), (2, 2)] {
            let (point, [by_x, by_u]) = along.stage(j);
            let found = [point.x[0], point.u[0], by_x[0], by_u[0]];
            let expected = [stages.x[at], stages.u[at], a[at], b[at]];
            assert_eq!(found.map(f64::to_bits), expected.map(f64::to_bits), "{j}");
        }
    }
}
