//! The one interface between models and what uses them: controllers, estimators, experiments.

use std::fmt::Debug;
use std::ops::Range;

/// The sizes of a plant or of a model of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub struct Dims {
    /// n, the number of states.
    pub nx: usize,
    /// m, the number of inputs.
    pub nu: usize,
    /// The number of parameters that may change from call to call.
    pub np: usize,
    /// The number of outputs.
    pub ny: usize,
}

impl Dims {
    /// `nx` states and `nu` inputs, no parameters; the outputs are the states.
    #[must_use]
    pub const fn new(nx: usize, nu: usize) -> Self {
        Self { nx, nu, np: 0, ny: nx }
    }

    /// The same with `np` parameters.
    #[must_use]
    pub const fn with_parameters(self, np: usize) -> Self {
        Self { np, ..self }
    }

    /// The same with `ny` outputs.
    #[must_use]
    pub const fn with_outputs(self, ny: usize) -> Self {
        Self { ny, ..self }
    }
}

/// Points at which a model is linearized, as the stages of a prediction horizon.
///
/// # Shapes
///
/// `x`: `[points, nx]`; `u`: `[points, nu]`; `p`: `[points, np]`; all row by row.
#[derive(Clone, Copy, Debug)]
pub struct Stages<'a> {
    /// States.
    pub x: &'a [f64],
    /// Inputs.
    pub u: &'a [f64],
    /// Parameters.
    pub p: &'a [f64],
}

impl<'a> Stages<'a> {
    /// Point `k` alone.
    #[must_use]
    pub fn point(&self, k: usize, dims: Dims) -> Stages<'a> {
        self.points(k..k + 1, dims)
    }

    /// The points of these numbers.
    #[must_use]
    pub fn points(&self, of: Range<usize>, dims: Dims) -> Stages<'a> {
        let part = |values: &'a [f64], width: usize| &values[of.start * width..of.end * width];
        Stages { x: part(self.x, dims.nx), u: part(self.u, dims.nu), p: part(self.p, dims.np) }
    }

    /// The first `points` points, and the others.
    #[must_use]
    pub fn split(self, dims: Dims, points: usize) -> (Self, Self) {
        let (x, x_rest) = self.x.split_at(points * dims.nx);
        let (u, u_rest) = self.u.split_at(points * dims.nu);
        let (p, p_rest) = self.p.split_at(points * dims.np);
        (Self { x, u, p }, Self { x: x_rest, u: u_rest, p: p_rest })
    }

    /// The number of points.
    ///
    /// # Panics
    ///
    /// If a length does not fit the number of points and the dimensions `dims`.
    #[must_use]
    pub fn count(&self, dims: Dims) -> usize {
        let points = self.x.len() / dims.nx;
        assert!(self.x.len() == points * dims.nx, "length of x");
        assert!(self.u.len() == points * dims.nu, "length of u");
        assert!(self.p.len() == points * dims.np, "length of p");
        points
    }
}

/// Where a linearization goes: F(x, u, p) and its Jacobians at each point.
///
/// # Shapes
///
/// `next`: `[points, nx]`; `a`: `[points, nx, nx]`, `a[k][i][j] = dF_i/dx_j`; `b`: `[points, nx,
/// nu]`, by u; `e`: `[points, nx, np]`, by p, or empty where it is not wanted; all row by row.
#[derive(Debug)]
pub struct Linearization<'a> {
    /// F(x, u, p).
    pub next: &'a mut [f64],
    /// dF/dx.
    pub a: &'a mut [f64],
    /// dF/du.
    pub b: &'a mut [f64],
    /// dF/dp, or empty.
    pub e: &'a mut [f64],
}

impl Linearization<'_> {
    /// Where the results of point `k` go.
    pub fn point(&mut self, k: usize, dims: Dims) -> Linearization<'_> {
        self.points(k..k + 1, dims)
    }

    /// Where the results of the points of these numbers go.
    pub fn points(&mut self, of: Range<usize>, dims: Dims) -> Linearization<'_> {
        let Dims { nx, nu, np, .. } = dims;
        let part = |width: usize| of.start * width..of.end * width;
        let e = if self.e.is_empty() { 0..0 } else { part(nx * np) };
        Linearization {
            next: &mut self.next[part(nx)],
            a: &mut self.a[part(nx * nx)],
            b: &mut self.b[part(nx * nu)],
            e: &mut self.e[e],
        }
    }

    /// Checks the lengths for `points` points of a model of dimensions `dims`.
    ///
    /// # Panics
    ///
    /// If one is wrong.
    pub fn check(&self, points: usize, dims: Dims) {
        assert!(self.next.len() == points * dims.nx, "length of next");
        assert!(self.a.len() == points * dims.nx * dims.nx, "length of a");
        assert!(self.b.len() == points * dims.nx * dims.nu, "length of b");
        let e = points * dims.nx * dims.np;
        assert!(self.e.is_empty() || self.e.len() == e, "length of e");
    }
}

/// Where the linearized outputs go: h(x, u, p) and its Jacobians at each point.
///
/// # Shapes
///
/// `y`: `[points, ny]`; `c`: `[points, ny, nx]`, dh/dx; `d`: `[points, ny, nu]`, dh/du; `e`:
/// `[points, ny, np]`, dh/dp, or empty where it is not wanted; all row by row.
#[derive(Debug)]
pub struct OutputLinearization<'a> {
    /// h(x, u, p).
    pub y: &'a mut [f64],
    /// dh/dx.
    pub c: &'a mut [f64],
    /// dh/du.
    pub d: &'a mut [f64],
    /// dh/dp, or empty.
    pub e: &'a mut [f64],
}

impl OutputLinearization<'_> {
    /// Where the results of point `k` go.
    pub fn point(&mut self, k: usize, dims: Dims) -> OutputLinearization<'_> {
        self.points(k..k + 1, dims)
    }

    /// Where the results of the points of these numbers go.
    pub fn points(&mut self, of: Range<usize>, dims: Dims) -> OutputLinearization<'_> {
        let Dims { nx, nu, np, ny } = dims;
        let part = |width: usize| of.start * width..of.end * width;
        let e = if self.e.is_empty() { 0..0 } else { part(ny * np) };
        OutputLinearization {
            y: &mut self.y[part(ny)],
            c: &mut self.c[part(ny * nx)],
            d: &mut self.d[part(ny * nu)],
            e: &mut self.e[e],
        }
    }

    /// Checks the lengths for `points` points of a model of dimensions `dims`.
    ///
    /// # Panics
    ///
    /// If one is wrong.
    pub fn check(&self, points: usize, dims: Dims) {
        assert!(self.y.len() == points * dims.ny, "length of y");
        assert!(self.c.len() == points * dims.ny * dims.nx, "length of c");
        assert!(self.d.len() == points * dims.ny * dims.nu, "length of d");
        let e = points * dims.ny * dims.np;
        assert!(self.e.is_empty() || self.e.len() == e, "length of e");
    }

    /// Writes the derivative of a row (counted through all points) in a column of (x, u, p).
    #[inline(always)]
    pub(crate) fn set(&mut self, dims: Dims, row: usize, column: usize, derivative: f64) {
        let Dims { nx, nu, np, .. } = dims;
        if column < nx {
            self.c[row * nx + column] = derivative;
        } else if column < nx + nu {
            self.d[row * nu + column - nx] = derivative;
        } else if !self.e.is_empty() {
            self.e[row * np + column - nx - nu] = derivative;
        }
    }

    /// Writes outputs that are the states, at states `x`, `[points, nx]`.
    pub(crate) fn set_states(self, x: &[f64], nx: usize) {
        for part in [&mut *self.c, self.d, self.e] {
            part.fill(0.0);
        }
        self.y.copy_from_slice(x);
        for c in self.c.chunks_exact_mut(nx * nx) {
            c.iter_mut().step_by(nx + 1).for_each(|diagonal| *diagonal = 1.0);
        }
    }
}

/// Numbers for a [`Linearization`] at some points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LinearizationBuffer {
    /// F(x, u, p), `[points, nx]`.
    pub next: Vec<f64>,
    /// dF/dx, `[points, nx, nx]`.
    pub a: Vec<f64>,
    /// dF/du, `[points, nx, nu]`.
    pub b: Vec<f64>,
    /// dF/dp, `[points, nx, np]`.
    pub e: Vec<f64>,
}

impl LinearizationBuffer {
    /// Room for `points` points of a model of dimensions `dims`.
    #[must_use]
    pub fn new(dims: Dims, points: usize) -> Self {
        let zeros = |width: usize| vec![0.0; points * dims.nx * width];
        Self { next: zeros(1), a: zeros(dims.nx), b: zeros(dims.nu), e: zeros(dims.np) }
    }

    /// The numbers, for [`Model::linearize`] to write.
    pub fn as_mut(&mut self) -> Linearization<'_> {
        let Self { next, a, b, e } = self;
        Linearization { next, a, b, e }
    }

    /// Writes the gradients of w'F(x, u, p) at some points, by [`Model::pull_back`] or else by the
    /// Jacobians, for which it makes more room if it has to.
    ///
    /// # Shapes
    ///
    /// `weights`: `[points, nx]`.
    pub fn gradients(
        &mut self,
        model: &mut dyn Model,
        at: Stages<'_>,
        weights: &[f64],
        out: Gradients<'_>,
    ) {
        let Gradients { x, u, p } = out;
        if model.pull_back(at, weights, Gradients { x: &mut *x, u: &mut *u, p: &mut *p }) {
            return;
        }
        let dims @ Dims { nx, nu, np, .. } = model.dims();
        let points = at.count(dims);
        let Self { next, a, b, e } = self;
        let by_p = if p.is_empty() { 0 } else { np };
        for (numbers, width) in [(&mut *next, 1), (&mut *a, nx), (&mut *b, nu), (&mut *e, by_p)] {
            numbers.resize(points * nx * width, 0.0);
        }
        model.linearize(at, Linearization { next, a, b, e });
        for (to, jacobians, width) in [(x, a, nx), (u, b, nu), (p, e, np)] {
            if to.is_empty() {
                continue;
            }
            to.fill(0.0);
            let rows = jacobians.chunks_exact(width).zip(weights).enumerate();
            // A row without weight may have no derivative.
            for (row, (derivatives, weight)) in rows.filter(|(_, (_, weight))| **weight != 0.0) {
                let to = &mut to[row / nx * width..][..width];
                to.iter_mut().zip(derivatives).for_each(|(to, entry)| *to += weight * entry);
            }
        }
    }
}

/// Numbers for an [`OutputLinearization`] at some points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OutputLinearizationBuffer {
    /// h(x, u, p), `[points, ny]`.
    pub y: Vec<f64>,
    /// dh/dx, `[points, ny, nx]`.
    pub c: Vec<f64>,
    /// dh/du, `[points, ny, nu]`.
    pub d: Vec<f64>,
    /// dh/dp, `[points, ny, np]`.
    pub e: Vec<f64>,
}

impl OutputLinearizationBuffer {
    /// Room for `points` points of a model of dimensions `dims`.
    #[must_use]
    pub fn new(dims: Dims, points: usize) -> Self {
        let zeros = |width: usize| vec![0.0; points * dims.ny * width];
        Self { y: zeros(1), c: zeros(dims.nx), d: zeros(dims.nu), e: zeros(dims.np) }
    }

    /// The numbers, for [`Model::linearize_output`] to write.
    pub fn as_mut(&mut self) -> OutputLinearization<'_> {
        let Self { y, c, d, e } = self;
        OutputLinearization { y, c, d, e }
    }
}

/// Where gradients of w'F(x, u, p) at some points go.
///
/// # Shapes
///
/// `x`: `[points, nx]`; `u`: `[points, nu]`; `p`: `[points, np]`, or empty where it is not wanted; all
/// row by row.
#[derive(Debug)]
pub struct Gradients<'a> {
    /// By x.
    pub x: &'a mut [f64],
    /// By u.
    pub u: &'a mut [f64],
    /// By p, or empty.
    pub p: &'a mut [f64],
}

impl Gradients<'_> {
    /// Checks the lengths for `points` points of a model of dimensions `dims`.
    ///
    /// # Panics
    ///
    /// If one is wrong.
    pub fn check(&self, points: usize, dims: Dims) {
        assert!(self.x.len() == points * dims.nx, "length of x");
        assert!(self.u.len() == points * dims.nu, "length of u");
        assert!(self.p.is_empty() || self.p.len() == points * dims.np, "length of p");
    }

    /// The places of the first `points` points, and those of the others.
    #[must_use]
    pub fn split(self, dims: Dims, points: usize) -> (Self, Self) {
        let np = if self.p.is_empty() { 0 } else { dims.np };
        let (x, x_rest) = self.x.split_at_mut(points * dims.nx);
        let (u, u_rest) = self.u.split_at_mut(points * dims.nu);
        let (p, p_rest) = self.p.split_at_mut(points * np);
        (Self { x, u, p }, Self { x: x_rest, u: u_rest, p: p_rest })
    }
}

/// A discrete-time model x\[k+1\] = F(x\[k\], u\[k\], p) with u held over the step, the control
/// interface of the paper, Eq. (interface), and its outputs y = h(x, u, p).
///
/// A model owns its workspace: no method allocates, and the same arguments give the same bits.
/// Where the model has no value it gives NaN; it does not panic on it.
///
/// Slices of lengths other than stated are a programming error and panic.
///
/// ```
/// use pinc_ode::{Dims, Linearization, Model, Stages};
///
/// /// A tank that is filled: x[k+1] = p x[k] + u[k].
/// #[derive(Debug)]
/// struct Leaky;
///
/// impl Model for Leaky {
///     fn dims(&self) -> Dims {
///         Dims::new(1, 1).with_parameters(1)
///     }
///     fn sample_time_s(&self) -> f64 {
///         1.0
///     }
///     fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
///         next[0] = p[0] * x[0] + u[0];
///     }
///     fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
///         for k in 0..at.count(self.dims()) {
///             out.next[k] = at.p[k] * at.x[k] + at.u[k];
///             (out.a[k], out.b[k]) = (at.p[k], 1.0);
///             if let Some(e) = out.e.get_mut(k) {
///                 *e = at.x[k];
///             }
///         }
///     }
/// }
/// ```
pub trait Model: Debug + Send {
    /// The sizes.
    fn dims(&self) -> Dims;

    /// The length T of one step, in s.
    fn sample_time_s(&self) -> f64;

    /// Writes F(x, u, p) into `next`.
    ///
    /// # Shapes
    ///
    /// `x`, `next`: `nx`; `u`: `nu`; `p`: `np`.
    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]);

    /// Linearizes F at any number of points. Up to rounding, the results at a point do not depend on
    /// the other points, and the values equal the result of [`Model::step`].
    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>);

    /// Writes the gradients of w'F(x, u, p) at any number of points, with weights w of their own, if
    /// the model can follow its steps backwards, which takes about as long as a few steps whatever
    /// the number of variables. Returns whether it can; [`LinearizationBuffer::gradients`] does it
    /// with every model.
    ///
    /// # Shapes
    ///
    /// `weights`: `[points, nx]`.
    fn pull_back(&mut self, at: Stages<'_>, weights: &[f64], out: Gradients<'_>) -> bool {
        let _ = (at, weights, out);
        false
    }

    /// Writes h(x, u, p) into `y`: the states, if a model has no other outputs.
    ///
    /// An output that depends on the input jumps when the input changes, so that it has two values
    /// at x\[k+1\]: h(x\[k+1\], u\[k\], p) at the end of an interval, before the change, and
    /// h(x\[k+1\], u\[k+1\], p) at the start of the next, after it. Everywhere in this workspace
    /// what is tracked, measured and reported is the reading at the end of the interval. A bound
    /// holds at both ends of every interval with the interval's input, from h(x\[k\], u\[k\], p)
    /// of the input that is applied now on. At x\[k\] an output without feedthrough (see
    /// [`Model::feedthrough`]) cannot be changed any more, and its bound starts at x\[k+1\].
    ///
    /// # Shapes
    ///
    /// `x`: `nx`; `u`: `nu`; `p`: `np`; `y`: `ny`.
    fn output(&mut self, x: &[f64], u: &[f64], p: &[f64], y: &mut [f64]) {
        let _ = (u, p);
        y.copy_from_slice(x);
    }

    /// Returns for each output whether it may depend on the input, `ny`. `false` promises that
    /// neither h nor its other derivatives change with u, and halves the work on a bounded output;
    /// the default, `true` for all, is always right.
    fn feedthrough(&self) -> Vec<bool> {
        vec![true; self.dims().ny]
    }

    /// Linearizes h at any number of points; by default y = x, dh/dx = I.
    fn linearize_output(&mut self, at: Stages<'_>, out: OutputLinearization<'_>) {
        out.check(at.count(self.dims()), self.dims());
        out.set_states(at.x, self.dims().nx);
    }
}
