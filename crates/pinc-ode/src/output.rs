//! Outputs of a plant with their exact Jacobians.

use crate::{Dims, OutputLinearization, Plant, Stages};
use pinc_ad::Dual;

/// Directions of differentiation that go through the outputs together.
const DIRECTIONS: usize = 4;

/// Numbers for the outputs of a plant and their Jacobians.
#[derive(Clone, Debug)]
pub(crate) struct OutputWorkspace {
    /// x, u and p, one after the other.
    variables: Vec<Dual<f64, DIRECTIONS>>,
    y: Vec<Dual<f64, DIRECTIONS>>,
}

impl OutputWorkspace {
    pub(crate) fn new(dims: Dims) -> Self {
        let zeros = |len| vec![Dual::lift(0.0); len];
        Self { variables: zeros(dims.nx + dims.nu + dims.np), y: zeros(dims.ny) }
    }

    /// See [`Model::linearize_output`](crate::Model::linearize_output).
    pub(crate) fn linearize<P: Plant>(
        &mut self,
        plant: &P,
        at: Stages<'_>,
        mut out: OutputLinearization<'_>,
    ) {
        let dims = plant.dims();
        let count = at.count(dims);
        out.check(count, dims);
        for k in 0..count {
            self.linearize_point(plant, at.point(k, dims), &mut out.point(k, dims));
        }
    }

    fn linearize_point<P: Plant>(
        &mut self,
        plant: &P,
        at: Stages<'_>,
        out: &mut OutputLinearization<'_>,
    ) {
        let dims = plant.dims();
        let Dims { nx, nu, np, .. } = dims;
        let columns = nx + nu + if out.e.is_empty() { 0 } else { np };
        for first in (0..columns).step_by(DIRECTIONS) {
            let values = at.x.iter().chain(at.u).chain(at.p);
            for (j, (to, &value)) in self.variables.iter_mut().zip(values).enumerate() {
                *to = Dual::variable(value, j.checked_sub(first).unwrap_or(DIRECTIONS));
            }
            let (x, rest) = self.variables.split_at(nx);
            let (u, p) = rest.split_at(nu);
            plant.output(x, u, p, &mut self.y);
            for (i, y) in self.y.iter().enumerate() {
                out.y[i] = y.re;
                for (column, &derivative) in (first..columns).zip(&y.eps) {
                    out.set(dims, i, column, derivative);
                }
            }
        }
    }
}
