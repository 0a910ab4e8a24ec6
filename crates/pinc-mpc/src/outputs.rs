//! The model's outputs along a plan.

use crate::horizon::Horizon;
use pinc_ode::{Dims, OutputLinearization, Stages};
use pinc_qp::OcpDims;

/// y = h(x, u, p), linearized at `x_1` .. `x_N` with the inputs that act there.
#[derive(Debug)]
pub(crate) struct Outputs {
    model: Dims,
    /// `[N, ny]`
    y: Vec<f64>,
    /// C, `[N, ny, n]`.
    c: Vec<f64>,
    /// D, `[N, ny, m]`.
    d: Vec<f64>,
}

impl Outputs {
    pub(crate) fn new(dims: OcpDims, model: Dims) -> Self {
        let zeros = |width: usize| vec![0.0; dims.horizon * model.ny * width];
        Self { model, y: zeros(1), c: zeros(model.nx), d: zeros(model.nu) }
    }

    /// Linearizes along the plan `z`.
    #[inline(never)]
    pub(crate) fn follow(&mut self, horizon: &mut Horizon, dims: OcpDims, z: &[f64], p: &[f64]) {
        let Dims { nx, nu, ny, .. } = self.model;
        for j in 1..=dims.horizon {
            let part = |width: usize| (j - 1) * ny * width..j * ny * width;
            let (x, u) = (&z[dims.next_state(j - 1)], &z[dims.input(dims.acting(j))]);
            let out = OutputLinearization {
                y: &mut self.y[part(1)],
                c: &mut self.c[part(nx)],
                d: &mut self.d[part(nu)],
                e: &mut [],
            };
            horizon.at(j).linearize_output(Stages { x, u, p }, out);
        }
    }

    /// The outputs at stage `j`, from 1 on.
    pub(crate) fn y(&self, j: usize) -> &[f64] {
        &self.y[(j - 1) * self.model.ny..j * self.model.ny]
    }

    /// Row `i` of C and of D at stage `j`.
    pub(crate) fn rows(&self, j: usize, i: usize) -> [&[f64]; 2] {
        let Dims { nx, nu, ny, .. } = self.model;
        let row = (j - 1) * ny + i;
        [&self.c[row * nx..(row + 1) * nx], &self.d[row * nu..(row + 1) * nu]]
    }
}
