//! The net as a model for control.

use crate::PincNet;
use crate::mlp::Layer;
use pinc_ad::Lanes;
use pinc_ode::{Dims, Predictor};

/// A value and up to seven tangents, which go through the net together.
type Cell = Lanes<8>;

/// Tangents that go through the net at once.
const DIRECTIONS: usize = 7;

/// The control interface f^(y, u) = `f_w`(T, y, u) of a net, Eq. (interface) of the paper, with its
/// Jacobians by forward differentiation. Owns copies of the weights; neither method allocates.
#[derive(Clone, Debug)]
pub struct PincPredictor {
    net: PincNet,
    layers: Vec<Layer>,
    input: Vec<Cell>,
    output: Vec<Cell>,
}

impl PincPredictor {
    /// The control interface of `net`.
    #[must_use]
    pub fn new(net: &PincNet) -> Self {
        let widest = net.mlp.widths().iter().copied().max().unwrap_or(0);
        let cells = vec![Cell::splat(0.0); widest];
        let layers = net.mlp.layers().collect();
        Self { net: net.clone(), layers, input: cells.clone(), output: cells }
    }

    /// Runs the net; tangents `first..` of the columns (x, u) go with it.
    fn run(&mut self, x: &[f64], u: &[f64], first: usize) {
        let Dims { states: n, inputs: m } = self.net.dims();
        assert!(x.len() == n && u.len() == m, "lengths of x and u");
        let normalizer = self.net.input.mean.iter().zip(&self.net.input.std);
        let values = std::iter::once(&self.net.horizon_s).chain(x).chain(u);
        for (i, ((&value, (mean, std)), cell)) in
            values.zip(normalizer).zip(&mut self.input).enumerate()
        {
            *cell = Cell::splat(0.0);
            cell.0[0] = (value - mean) / std;
            if let Some(column) = i.checked_sub(1 + first)
                && column < DIRECTIONS
            {
                cell.0[1 + column] = 1.0 / std;
            }
        }
        let parameters = self.net.mlp.parameters();
        let last = self.layers.len() - 1;
        for (l, layer) in self.layers.iter().enumerate() {
            let rows = parameters[layer.weight.clone()].chunks_exact(layer.inputs);
            let bias = &parameters[layer.bias.clone()];
            for ((row, &bias), cell) in rows.zip(bias).zip(&mut self.output) {
                let mut z = Cell::splat(0.0);
                z.0[0] = bias;
                for (&w, &a) in row.iter().zip(&self.input) {
                    z = z + a * w;
                }
                *cell = if l == last { z } else { activate(z) };
            }
            std::mem::swap(&mut self.input, &mut self.output);
        }
    }

    /// State i from the perceptron's output: its value, and the derivatives in the columns
    /// `first..first + DIRECTIONS` of (x, u).
    fn state(&self, i: usize, x: &[f64], first: usize) -> Cell {
        let PincNet { ansatz, horizon_s, output, .. } = &self.net;
        let mut d = self.input[i] * output.std[i];
        d.0[0] += output.mean[i];
        let mut y0 = Cell::splat(0.0);
        y0.0[0] = x[i];
        if let Some(column) = i.checked_sub(first)
            && column < DIRECTIONS
        {
            y0.0[1 + column] = 1.0;
        }
        ansatz.state(Cell::splat(*horizon_s), *horizon_s, y0, d)
    }
}

/// tanh of a cell: the value, and the tangents times 1 - tanh^2.
fn activate(z: Cell) -> Cell {
    let a = z.0[0].tanh();
    let mut result = z * (1.0 - a * a);
    result.0[0] = a;
    result
}

impl Predictor for PincPredictor {
    fn dims(&self) -> Dims {
        self.net.dims()
    }

    fn horizon_s(&self) -> f64 {
        self.net.horizon_s
    }

    fn predict(&mut self, x: &[f64], u: &[f64], next: &mut [f64]) {
        assert_eq!(next.len(), self.net.dims().states, "length of next");
        // Beyond the last column: no tangents.
        self.run(x, u, x.len() + u.len());
        for (i, next) in next.iter_mut().enumerate() {
            *next = self.state(i, x, x.len() + u.len()).0[0];
        }
    }

    fn linearize(&mut self, x: &[f64], u: &[f64], next: &mut [f64], a: &mut [f64], b: &mut [f64]) {
        let Dims { states: n, inputs: m } = self.net.dims();
        assert!(next.len() == n && a.len() == n * n && b.len() == n * m, "lengths of next, a, b");
        for first in (0..n + m).step_by(DIRECTIONS) {
            self.run(x, u, first);
            for i in 0..n {
                let y = self.state(i, x, first).0;
                next[i] = y[0];
                for (column, &derivative) in (first..n + m).zip(&y[1..]) {
                    if column < n {
                        a[i * n + column] = derivative;
                    } else {
                        b[i * m + column - n] = derivative;
                    }
                }
            }
        }
    }
}
