//! The net as a model for control.

mod layout;
mod step;

use crate::PincNet;
use layout::Layout;
use pinc_ad::simd::Isa;
use pinc_ode::{Dims, Predictor};
use step::{Columns, Step};

/// The control interface f^(y, u) = `f_w`(T, y, u) of a net, Eq. (interface) of the paper, with its
/// Jacobians by forward differentiation.
///
/// It is the net compiled for one purpose: t = T, both normalizers and the ansatz are folded into
/// weights and biases, and the neurons of a layer lie across the lanes of vectors. It agrees with
/// [`PincNet::evaluate`] to rounding. Neither method allocates.
#[derive(Clone, Debug)]
pub struct PincPredictor {
    dims: Dims,
    horizon_s: f64,
    isa: Isa,
    layout: Layout,
    columns: Columns,
}

impl PincPredictor {
    /// The control interface of `net`, in the machine's fastest instruction set.
    #[must_use]
    pub fn new(net: &PincNet) -> Self {
        Self::with_isa(net, Isa::detect())
    }

    /// The control interface of `net` in the instruction set `isa`.
    ///
    /// # Panics
    ///
    /// On use, if the machine does not have it.
    #[must_use]
    pub fn with_isa(net: &PincNet, isa: Isa) -> Self {
        let dims = net.dims();
        let layout = Layout::new(net, isa.lanes());
        let columns = Columns::new(layout.longest(), 1 + dims.states + dims.inputs);
        Self { dims, horizon_s: net.horizon_s, isa, layout, columns }
    }

    /// Runs the net from (x, u), with the tangents of the first `tangents` of them; the results are in
    /// the columns that are returned.
    fn run(&mut self, x: &[f64], u: &[f64], tangents: usize) -> &Columns {
        let Dims { states: n, inputs: m } = self.dims;
        assert!(x.len() == n && u.len() == m, "lengths of x and u");
        self.columns.start(x, u);
        let Self { layout, columns, .. } = self;
        self.isa.dispatch(Step { layout, columns, tangents });
        columns
    }
}

impl Predictor for PincPredictor {
    fn dims(&self) -> Dims {
        self.dims
    }

    fn horizon_s(&self) -> f64 {
        self.horizon_s
    }

    fn predict(&mut self, x: &[f64], u: &[f64], next: &mut [f64]) {
        assert_eq!(next.len(), self.dims.states, "length of next");
        let from_x = self.layout.adds_initial_state();
        next.copy_from_slice(&self.run(x, u, 0).value()[..x.len()]);
        if from_x {
            for (next, x) in next.iter_mut().zip(x) {
                *next += x;
            }
        }
    }

    fn linearize(&mut self, x: &[f64], u: &[f64], next: &mut [f64], a: &mut [f64], b: &mut [f64]) {
        let Dims { states: n, inputs: m } = self.dims;
        assert!(next.len() == n && a.len() == n * n && b.len() == n * m, "lengths of next, a, b");
        let from_x = self.layout.adds_initial_state();
        let columns = self.run(x, u, n + m);
        next.copy_from_slice(&columns.value()[..n]);
        for j in 0..n {
            for (i, derivative) in columns.tangent(j)[..n].iter().enumerate() {
                a[i * n + j] = *derivative;
            }
        }
        for j in 0..m {
            for (i, derivative) in columns.tangent(n + j)[..n].iter().enumerate() {
                b[i * m + j] = *derivative;
            }
        }
        if from_x {
            for (i, x) in x.iter().enumerate() {
                next[i] += x;
                a[i * n + i] += 1.0;
            }
        }
    }
}
