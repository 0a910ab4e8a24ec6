//! The net as a model for control.

mod batched;
mod layout;
mod step;

use crate::{FoldedNet, NetError, PincNet};
use batched::{Batched, Cells};
use layout::Layout;
use pinc_ad::simd::Isa;
use pinc_ode::{Dims, Linearization, Model, Stages};
use step::{Columns, SIDE_BY_SIDE, Step};

/// The control interface f^(y, u) = `f_w`(T, y, u) of a net, Eq. (interface) of the paper, with its
/// Jacobians by forward differentiation.
///
/// It is the net compiled for one purpose: t = T, both normalizers and the ansatz are folded into
/// weights and biases, and the neurons of a layer lie across the lanes of vectors. It agrees with
/// [`PincNet::evaluate`] to rounding. Neither method allocates.
#[derive(Clone, Debug)]
pub struct PincModel {
    dims: Dims,
    sample_time_s: f64,
    isa: Isa,
    layout: Layout,
    columns: Columns,
    cells: Cells,
}

impl PincModel {
    /// The control interface of `net`, in the machine's fastest instruction set.
    ///
    /// # Errors
    ///
    /// [`NetError::OneScenario`] for a conventional PINN, whose state depends on neither x nor u.
    pub fn new(net: &PincNet) -> Result<Self, NetError> {
        Self::with_isa(net, Isa::detect())
    }

    /// The control interface of `net` in the instruction set `isa`.
    ///
    /// # Errors
    ///
    /// [`NetError::OneScenario`] for a conventional PINN.
    ///
    /// # Panics
    ///
    /// On use, if the machine does not have the instruction set.
    pub fn with_isa(net: &PincNet, isa: Isa) -> Result<Self, NetError> {
        let dims = net.dims();
        let layout = Layout::new(FoldedNet::new(net)?, isa.lanes());
        let columns = Columns::new(layout.longest(), dims.nx + dims.nu);
        let cells = Cells::new(layout.widest(), dims.nx + dims.nu, isa.lanes());
        Ok(Self { dims, sample_time_s: net.sample_time_s, isa, layout, columns, cells })
    }

    /// Runs the net from one (x, u), or from [`SIDE_BY_SIDE`] of them, with the tangents of the
    /// first `tangents` of their numbers; the results are in the columns returned.
    fn run(&mut self, x: &[f64], u: &[f64], tangents: usize) -> &Columns {
        let Dims { nx: n, nu: m, .. } = self.dims;
        let Self { layout, columns, isa, .. } = self;
        columns.set_tangents(tangents);
        let points = x.len() / n;
        for point in 0..points {
            let part = |width: usize| point * width..(point + 1) * width;
            columns.start(point, &x[part(n)], &u[part(m)]);
        }
        match points {
            1 => isa.dispatch(Step::<1> { layout, columns }),
            _ => isa.dispatch(Step::<SIDE_BY_SIDE> { layout, columns }),
        }
        columns
    }

    /// Copies the results at `point`, whose state is `x`.
    fn results(&self, point: usize, x: &[f64], next: &mut [f64], a: &mut [f64], b: &mut [f64]) {
        let (Dims { nx: n, nu: m, .. }, columns) = (self.dims, &self.columns);
        next.copy_from_slice(&columns.value(point)[..n]);
        for j in 0..n {
            for (i, derivative) in columns.tangent(point, j)[..n].iter().enumerate() {
                a[i * n + j] = *derivative;
            }
        }
        for j in 0..m {
            for (i, derivative) in columns.tangent(point, n + j)[..n].iter().enumerate() {
                b[i * m + j] = *derivative;
            }
        }
        if self.layout.adds_initial_state() {
            for (i, x) in x.iter().enumerate() {
                next[i] += x;
                a[i * n + i] += 1.0;
            }
        }
    }
}

impl Model for PincModel {
    fn dims(&self) -> Dims {
        self.dims
    }

    fn sample_time_s(&self) -> f64 {
        self.sample_time_s
    }

    fn step(&mut self, x: &[f64], u: &[f64], _p: &[f64], next: &mut [f64]) {
        let Dims { nx: n, nu: m, .. } = self.dims;
        assert!(x.len() == n && u.len() == m && next.len() == n, "lengths of x, u, next");
        let from_x = self.layout.adds_initial_state();
        next.copy_from_slice(&self.run(x, u, 0).value(0)[..n]);
        if from_x {
            for (next, x) in next.iter_mut().zip(x) {
                *next += x;
            }
        }
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        let Dims { nx: n, nu: m, .. } = self.dims;
        let count = at.count(self.dims);
        out.check(count, self.dims);
        let (Stages { x, u, .. }, Linearization { next, a, b, .. }) = (at, out);
        let mut first = 0;
        let lanes = self.isa.lanes();
        while first < count {
            let left = count - first;
            if left >= lanes / 2 {
                let points = left.min(lanes);
                let part = |width: usize| first * width..(first + points) * width;
                let Self { layout, cells, dims, isa, .. } = self;
                isa.dispatch(Batched {
                    layout,
                    cells,
                    dims: *dims,
                    x: &x[part(n)],
                    u: &u[part(m)],
                    next: &mut next[part(n)],
                    a: &mut a[part(n * n)],
                    b: &mut b[part(n * m)],
                });
                first += points;
                continue;
            }
            let points = if left < SIDE_BY_SIDE { 1 } else { SIDE_BY_SIDE };
            let part = |width: usize| first * width..(first + points) * width;
            self.run(&x[part(n)], &u[part(m)], n + m);
            for point in 0..points {
                let k = first + point;
                let of = |width: usize| k * width..(k + 1) * width;
                let (a, b) = (&mut a[of(n * n)], &mut b[of(n * m)]);
                self.results(point, &x[of(n)], &mut next[of(n)], a, b);
            }
            first += points;
        }
    }
}
