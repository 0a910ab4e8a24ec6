//! A cost integrated along a model that does not integrate.

use pinc_ode::{
    Dims, Linearization, LinearizationBuffer, Model, OutputLinearization,
    OutputLinearizationBuffer, Stages,
};

/// The states that follow the plant's: the time and the cost.
const ADDED: usize = 2;

/// A model of a plant's states, as a net is one, extended by the time and by a cost that is
/// integrated along it: (x, t, J) -> (F(x, u, p), t + T, J + integral of l).
///
/// With y(s) for the state that the model gives after s seconds, the integral is the Gauss-Legendre
/// rule of three points, which is exact for polynomials of degree 5:
///
/// ```text
/// T sum_i w_i l(y(c_i T), u, p, t + c_i T),   c = 1/2 - sqrt(15)/10, 1/2, 1/2 + sqrt(15)/10
///                                             w = 5/18, 8/18, 5/18
/// ```
#[derive(Debug)]
pub struct Quadrature {
    end: Box<dyn Model>,
    nodes: [Node; 3],
    /// A model of (x, t, J), whose last output but one is l.
    rate: Box<dyn Model>,
    /// `(y, t, J)` at a node.
    at: Vec<f64>,
    found: LinearizationBuffer,
    /// The outputs at a node.
    outputs: OutputLinearizationBuffer,
}

#[derive(Debug)]
struct Node {
    model: Box<dyn Model>,
    /// Its time and its weight in parts of T.
    part: f64,
    weight: f64,
}

impl Quadrature {
    /// The extension of the model of a step of `length_s` seconds by the cost that is the last output
    /// but one of `rate`, a model of (x, t, J). `after` gives the model of the states after so many
    /// seconds.
    ///
    /// # Errors
    ///
    /// That of `after`.
    pub fn new<E>(
        length_s: f64,
        after: impl Fn(f64) -> Result<Box<dyn Model>, E>,
        rate: Box<dyn Model>,
    ) -> Result<Self, E> {
        let node = |part: f64, weight: f64| -> Result<Node, E> {
            Ok(Node { model: after(part * length_s)?, part, weight: weight / 18.0 })
        };
        let offset = 0.15_f64.sqrt();
        let nodes = [node(0.5 - offset, 5.0)?, node(0.5, 8.0)?, node(0.5 + offset, 5.0)?];
        let end = after(length_s)?;
        let (inner, outer) = (end.dims(), rate.dims());
        Ok(Self {
            nodes,
            at: vec![0.0; outer.nx],
            found: LinearizationBuffer::new(inner, 1),
            outputs: OutputLinearizationBuffer::new(outer, 1),
            end,
            rate,
        })
    }

    /// Writes the linearization at one point.
    fn linearize_point(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        let Dims { nx, nu, np, ny, .. } = self.rate.dims();
        let (n, length) = (nx - ADDED, self.end.sample_time_s());
        let Linearization { next, a, b, e } = out;
        [&mut *a, &mut *b, &mut *e].into_iter().for_each(|part| part.fill(0.0));
        let states = Stages { x: &at.x[..n], ..at };
        self.end.linearize(states, self.found.as_mut());
        let LinearizationBuffer { next: state, a: by_x, b: by_u, e: by_p } = &self.found;
        next[..n].copy_from_slice(state);
        next[n] = at.x[n] + length;
        next[n + 1] = at.x[n + 1];
        for i in 0..n {
            a[i * nx..i * nx + n].copy_from_slice(&by_x[i * n..(i + 1) * n]);
            b[i * nu..(i + 1) * nu].copy_from_slice(&by_u[i * nu..(i + 1) * nu]);
            if !e.is_empty() {
                e[i * np..(i + 1) * np].copy_from_slice(&by_p[i * np..(i + 1) * np]);
            }
        }
        (a[n * nx + n], a[(n + 1) * nx + n + 1]) = (1.0, 1.0);
        let row = ny - ADDED;
        for Node { model, part, weight } in &mut self.nodes {
            let weight = *weight * length;
            model.linearize(states, self.found.as_mut());
            let LinearizationBuffer { next: state, a: by_x, b: by_u, e: by_p } = &self.found;
            self.at[..n].copy_from_slice(state);
            (self.at[n], self.at[n + 1]) = (at.x[n] + *part * length, at.x[n + 1]);
            let point = Stages { x: &self.at, ..at };
            self.rate.linearize_output(point, self.outputs.as_mut());
            let OutputLinearizationBuffer { y, c, d, e: by } = &self.outputs;
            next[n + 1] += weight * y[row];
            let slopes = &c[row * nx..(row + 1) * nx];
            a[(n + 1) * nx + n] += weight * slopes[n];
            for (wide, jacobian, own) in [
                (&mut a[(n + 1) * nx..(n + 1) * nx + n], by_x, None),
                (&mut b[(n + 1) * nu..], by_u, Some(&d[row * nu..(row + 1) * nu])),
            ] {
                add_row(wide, weight, slopes, jacobian, own);
            }
            if !e.is_empty() {
                add_row(
                    &mut e[(n + 1) * np..],
                    weight,
                    slopes,
                    by_p,
                    Some(&by[row * np..(row + 1) * np]),
                );
            }
        }
    }
}

/// Adds `weight (slopes J + own)`, where J has as many columns as `to`.
fn add_row(to: &mut [f64], weight: f64, slopes: &[f64], jacobian: &[f64], own: Option<&[f64]>) {
    for (slope, row) in slopes.iter().zip(jacobian.chunks_exact(to.len().max(1))) {
        to.iter_mut().zip(row).for_each(|(to, entry)| *to += weight * slope * entry);
    }
    for (to, own) in to.iter_mut().zip(own.into_iter().flatten()) {
        *to += weight * own;
    }
}

impl Model for Quadrature {
    fn dims(&self) -> Dims {
        self.rate.dims()
    }

    fn sample_time_s(&self) -> f64 {
        self.end.sample_time_s()
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        let (n, length) = (x.len() - ADDED, self.end.sample_time_s());
        let row = self.rate.dims().ny - ADDED;
        let mut cost = x[n + 1];
        for Node { model, part, weight } in &mut self.nodes {
            model.step(&x[..n], u, p, &mut self.at[..n]);
            (self.at[n], self.at[n + 1]) = (x[n] + *part * length, x[n + 1]);
            self.rate.output(&self.at, u, p, &mut self.outputs.y);
            cost += *weight * length * self.outputs.y[row];
        }
        self.end.step(&x[..n], u, p, &mut next[..n]);
        (next[n], next[n + 1]) = (x[n] + length, cost);
    }

    fn linearize(&mut self, at: Stages<'_>, mut out: Linearization<'_>) {
        let dims = self.dims();
        let count = at.count(dims);
        out.check(count, dims);
        for k in 0..count {
            self.linearize_point(at.point(k, dims), out.point(k, dims));
        }
    }

    fn output(&mut self, x: &[f64], u: &[f64], p: &[f64], y: &mut [f64]) {
        self.rate.output(x, u, p, y);
    }

    fn feedthrough(&self) -> Vec<bool> {
        self.rate.feedthrough()
    }

    fn linearize_output(&mut self, at: Stages<'_>, out: OutputLinearization<'_>) {
        self.rate.linearize_output(at, out);
    }
}
