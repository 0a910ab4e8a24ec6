//! A moving horizon estimator's memory of the last steps.

use pinc_ode::{Dims, Memory, Stages};

/// The states, inputs and measurements of a window of up to N steps, and what was expected of each
/// state before it was measured. It grows until it is full, and then moves on.
#[derive(Clone, Debug)]
pub(crate) struct Window {
    dims: Dims,
    /// N
    most: usize,
    /// The number of steps in it; there is one state more.
    pub(crate) steps: usize,
    /// The states, `[N + 1, n]`.
    pub(crate) x: Vec<f64>,
    /// The normalized noises, beginning with the first state's, `[N + 1, n]`.
    pub(crate) v: Vec<f64>,
    /// The inputs that led to the states, the first one too, `[N + 1, m]`, with room for one more.
    pub(crate) u: Vec<f64>,
    /// The known parameters from each state on, `[N + 1, np]`.
    pub(crate) p: Vec<f64>,
    /// `[N + 1, ny]`, NaN where nothing was measured.
    pub(crate) y: Vec<f64>,
    /// The states expected, `[N + 1, n]`, and their covariances, `[N + 1, n, n]`.
    prior: Vec<f64>,
    prior_covariance: Vec<f64>,
}

impl Window {
    pub(crate) fn new(dims: Dims, most: usize) -> Self {
        let points = |width: usize| vec![0.0; (most + 1) * width];
        Self {
            dims,
            most,
            steps: 0,
            x: points(dims.nx),
            v: points(dims.nx),
            u: vec![0.0; (most + 2) * dims.nu],
            p: points(dims.np),
            y: points(dims.ny),
            prior: points(dims.nx),
            prior_covariance: points(dims.nx * dims.nx),
        }
    }

    /// Begins anew with a state that is expected to be `x`, with covariance `covariance`, and the
    /// known parameters `p`. No input led there.
    pub(crate) fn reset(&mut self, x: &[f64], covariance: &[f64], p: &[f64]) {
        self.steps = 0;
        self.u.fill(0.0);
        self.begin_last(x, covariance);
        self.know(p);
    }

    /// Takes `u` for the input that led to the first state.
    pub(crate) fn begin_under(&mut self, u: &[f64]) {
        self.u[..self.dims.nu].copy_from_slice(u);
    }

    /// The steps' states, inputs and known parameters.
    pub(crate) fn at_steps(&self) -> Stages<'_> {
        let Dims { nx, nu, np, .. } = self.dims;
        let steps = self.steps;
        let (x, p) = (&self.x[..steps * nx], &self.p[..steps * np]);
        Stages { x, u: &self.u[nu..(steps + 1) * nu], p }
    }

    /// All states with the inputs that led there, and with the known parameters: what is measured is
    /// read before the input changes.
    pub(crate) fn at_measurements(&self) -> Stages<'_> {
        let Dims { nx, nu, np, .. } = self.dims;
        let states = self.steps + 1;
        Stages { x: &self.x[..states * nx], u: &self.u[..states * nu], p: &self.p[..states * np] }
    }

    /// Takes `p` for the known parameters from the last state on.
    pub(crate) fn know(&mut self, p: &[f64]) {
        let np = self.dims.np;
        self.p[self.steps * np..(self.steps + 1) * np].copy_from_slice(p);
    }

    /// Adds a step under the input `u` that leads to a state that is expected to be `x`, with
    /// covariance `p`. Returns whether the window was shifted, without its oldest state.
    pub(crate) fn push(&mut self, u: &[f64], x: &[f64], p: &[f64]) -> bool {
        let Dims { nx, nu, np, ny, .. } = self.dims;
        self.u[(self.steps + 1) * nu..(self.steps + 2) * nu].copy_from_slice(u);
        let moves = self.steps == self.most;
        if moves {
            self.x.copy_within(nx.., 0);
            self.v.copy_within(nx.., 0);
            self.u.copy_within(nu.., 0);
            self.p.copy_within(np.., 0);
            self.y.copy_within(ny.., 0);
            self.prior.copy_within(nx.., 0);
            self.prior_covariance.copy_within(nx * nx.., 0);
        } else {
            self.steps += 1;
            self.p.copy_within((self.steps - 1) * np..self.steps * np, self.steps * np);
        }
        self.begin_last(x, p);
        moves
    }

    fn begin_last(&mut self, x: &[f64], p: &[f64]) {
        let Dims { nx, ny, .. } = self.dims;
        let last = self.steps;
        self.x[last * nx..(last + 1) * nx].copy_from_slice(x);
        self.v[last * nx..(last + 1) * nx].fill(0.0);
        self.y[last * ny..(last + 1) * ny].fill(f64::NAN);
        self.prior[last * nx..(last + 1) * nx].copy_from_slice(x);
        self.prior_covariance[last * nx * nx..(last + 1) * nx * nx].copy_from_slice(p);
    }

    /// Saves or restores it.
    pub(crate) fn remember(&mut self, memory: &mut Memory<'_>) {
        memory.count(&mut self.steps, self.most);
        let Self { x, v, u, p, y, prior, prior_covariance, .. } = self;
        let parts = [x, v, u, p, y, prior, prior_covariance];
        parts.into_iter().for_each(|part| memory.numbers(part));
    }

    /// The last state, which is the current one.
    pub(crate) fn last(&self) -> &[f64] {
        let nx = self.dims.nx;
        &self.x[self.steps * nx..(self.steps + 1) * nx]
    }

    pub(crate) fn last_mut(&mut self) -> &mut [f64] {
        let nx = self.dims.nx;
        &mut self.x[self.steps * nx..(self.steps + 1) * nx]
    }

    /// What is measured now.
    pub(crate) fn measure(&mut self, y: &[f64]) {
        let ny = self.dims.ny;
        self.y[self.steps * ny..(self.steps + 1) * ny].copy_from_slice(y);
    }

    /// Drops what is measured now where there is no innovation.
    pub(crate) fn reject(&mut self, innovation: &[f64]) {
        let ny = self.dims.ny;
        let now = &mut self.y[self.steps * ny..(self.steps + 1) * ny];
        for (y, _) in now.iter_mut().zip(innovation).filter(|(_, v)| v.is_nan()) {
            *y = f64::NAN;
        }
    }

    /// Drops all but the last state and what is measured there, and takes `p` for the covariance of
    /// what was expected of it.
    pub(crate) fn restart(&mut self, p: &[f64]) {
        let Dims { nx, nu, np, ny, .. } = self.dims;
        let last = self.steps;
        self.u.copy_within(last * nu..(last + 1) * nu, 0);
        self.p.copy_within(last * np..(last + 1) * np, 0);
        self.x.copy_within(last * nx..(last + 1) * nx, 0);
        self.y.copy_within(last * ny..(last + 1) * ny, 0);
        self.prior.copy_within(last * nx..(last + 1) * nx, 0);
        self.prior_covariance[..nx * nx].copy_from_slice(p);
        self.v[..nx].fill(0.0);
        self.steps = 0;
    }

    /// What was expected of the first state, and its covariance: the arrival cost.
    pub(crate) fn arrival(&self) -> (&[f64], &[f64]) {
        let nx = self.dims.nx;
        (&self.prior[..nx], &self.prior_covariance[..nx * nx])
    }
}
