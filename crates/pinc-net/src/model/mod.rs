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

/// The control interface f^(y, u, p) = `f_w`(T, y, u, p) of a net, Eq. (interface) of the paper,
/// with its Jacobians by forward differentiation.
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

    /// The control interface of `net` for steps of `t` seconds, in (0, T], in which the net is
    /// asked for its state at `t`: f^(y, u, p) = `f_w`(t, y, u, p).
    ///
    /// # Errors
    ///
    /// [`NetError::OneScenario`] for a conventional PINN; [`NetError::Time`] for another `t`, or
    /// one that a distilled net does not know.
    pub fn at(net: &PincNet, t: f64) -> Result<Self, NetError> {
        Self::folded(net, t, Isa::detect())
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
        Self::folded(net, net.sample_time_s, isa)
    }

    fn folded(net: &PincNet, t: f64, isa: Isa) -> Result<Self, NetError> {
        let dims = net.dims();
        let layout = Layout::new(FoldedNet::at(net, t)?, isa.lanes());
        let tangents = dims.nx + dims.nu + dims.np;
        let columns = Columns::new(layout.longest(), tangents);
        let cells = Cells::new(layout.widest(), tangents, isa.lanes());
        Ok(Self { dims, sample_time_s: t, isa, layout, columns, cells })
    }

    /// Runs the net from one (x, u, p), or from [`SIDE_BY_SIDE`] of them, with the tangents of the
    /// first `tangents` of their numbers; the results are in the columns returned.
    fn run(&mut self, at: Stages<'_>, tangents: usize) -> &Columns {
        let Self { dims, layout, columns, isa, .. } = self;
        columns.set_tangents(tangents);
        let points = at.x.len() / dims.nx;
        for point in 0..points {
            let Stages { x, u, p } = at.point(point, *dims);
            columns.start(point, [x, u, p]);
        }
        match points {
            1 => isa.dispatch(Step::<1> { layout, columns }),
            _ => isa.dispatch(Step::<SIDE_BY_SIDE> { layout, columns }),
        }
        columns
    }

    /// Copies the results at `point`, whose state is `x`.
    fn results(&self, point: usize, x: &[f64], out: Linearization<'_>) {
        let (Dims { nx: n, nu: m, np, .. }, columns) = (self.dims, &self.columns);
        let Linearization { next, a, b, e } = out;
        next.copy_from_slice(&columns.value(point)[..n]);
        let np = if e.is_empty() { 0 } else { np };
        let mut first = 0;
        for (matrix, width) in [(&mut *a, n), (b, m), (e, np)] {
            for j in 0..width {
                for (i, derivative) in columns.tangent(point, first + j)[..n].iter().enumerate() {
                    matrix[i * width + j] = *derivative;
                }
            }
            first += width;
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

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        let Dims { nx: n, nu: m, np, .. } = self.dims;
        assert!(x.len() == n && next.len() == n, "lengths of x and next");
        assert!(u.len() == m && p.len() == np, "lengths of u and p");
        let from_x = self.layout.adds_initial_state();
        next.copy_from_slice(&self.run(Stages { x, u, p }, 0).value(0)[..n]);
        if from_x {
            for (next, x) in next.iter_mut().zip(x) {
                *next += x;
            }
        }
    }

    fn feedthrough(&self) -> Vec<bool> {
        vec![false; self.dims.ny]
    }

    fn linearize(&mut self, at: Stages<'_>, mut out: Linearization<'_>) {
        let Dims { nx: n, nu: m, np, .. } = self.dims;
        let count = at.count(self.dims);
        out.check(count, self.dims);
        let tangents = n + m + if out.e.is_empty() { 0 } else { np };
        let mut first = 0;
        let lanes = self.isa.lanes();
        while first < count {
            let left = count - first;
            let points = match left {
                left if left >= lanes / 2 => left.min(lanes),
                left if left < SIDE_BY_SIDE => 1,
                _ => SIDE_BY_SIDE,
            };
            let range = first..first + points;
            let here = at.points(range.clone(), self.dims);
            if left >= lanes / 2 {
                let out = out.points(range, self.dims);
                let Self { layout, cells, dims, isa, .. } = self;
                isa.dispatch(Batched { layout, cells, dims: *dims, tangents, at: here, out });
            } else {
                self.run(here, tangents);
                for point in 0..points {
                    let x = here.point(point, self.dims).x;
                    self.results(point, x, out.point(first + point, self.dims));
                }
            }
            first += points;
        }
    }
}
