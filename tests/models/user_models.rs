//! Models written by a user.

use pinc_ode::{Dims, Linearization, Model, OutputLinearization, Stages};

/// A leaking tank with an unknown leak: x+ = p x + u.
#[derive(Debug)]
pub(crate) struct Leaky;

impl Model for Leaky {
    fn dims(&self) -> Dims {
        Dims::new(1, 1).with_parameters(1)
    }

    fn sample_time_s(&self) -> f64 {
        1.0
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        let ([x], [u], [p], [next]) = (x, u, p, next) else { panic!("lengths of x, u, p, next") };
        *next = p * x + u;
    }

    fn linearize(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        let count = at.count(self.dims());
        out.check(count, self.dims());
        for k in 0..count {
            out.next[k] = at.p[k] * at.x[k] + at.u[k];
            (out.a[k], out.b[k]) = (at.p[k], 1.0);
            if let Some(e) = out.e.get_mut(k) {
                *e = at.x[k];
            }
        }
    }
}

/// A model whose inputs are disturbed by parameters of its own: F(x, u + d, p), with p and d as the
/// parameters. It is what an estimator of input disturbances wraps a model in.
#[derive(Debug)]
pub(crate) struct Disturbed {
    inner: Box<dyn Model>,
    u: Vec<f64>,
    p: Vec<f64>,
    e: Vec<f64>,
}

impl Disturbed {
    pub(crate) fn new(inner: Box<dyn Model>) -> Self {
        let Dims { nx, nu, np, ny, .. } = inner.dims();
        let e = vec![0.0; nx.max(ny) * np];
        Self { inner, u: vec![0.0; nu], p: vec![0.0; np], e }
    }

    /// Sets the inner model's input and parameters.
    fn set(&mut self, u: &[f64], p: &[f64]) {
        let np = self.p.len();
        assert_eq!(p.len(), np + u.len(), "length of p");
        self.p.copy_from_slice(&p[..np]);
        self.u.copy_from_slice(u);
        self.u.iter_mut().zip(&p[np..]).for_each(|(u, d)| *u += d);
    }
}

/// Writes the Jacobians by p and d beside one another: those by d are those by u.
fn join(joined: &mut [f64], by_p: &[f64], by_u: &[f64], (np, nu): (usize, usize)) {
    for (i, row) in joined.chunks_exact_mut(np + nu).enumerate() {
        row[..np].copy_from_slice(&by_p[i * np..][..np]);
        row[np..].copy_from_slice(&by_u[i * nu..][..nu]);
    }
}

impl Model for Disturbed {
    fn dims(&self) -> Dims {
        let dims = self.inner.dims();
        dims.with_parameters(dims.np + dims.nu)
    }

    fn sample_time_s(&self) -> f64 {
        self.inner.sample_time_s()
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        self.set(u, p);
        self.inner.step(x, &self.u, &self.p, next);
    }

    fn linearize(&mut self, at: Stages<'_>, mut out: Linearization<'_>) {
        let (dims, inner) = (self.dims(), self.inner.dims());
        let count = at.count(dims);
        out.check(count, dims);
        for k in 0..count {
            let (at, out) = (at.point(k, dims), out.point(k, dims));
            self.set(at.u, at.p);
            let Linearization { next, a, b, e } = out;
            let by_p = &mut self.e[..inner.nx * inner.np];
            let at = Stages { x: at.x, u: &self.u, p: &self.p };
            self.inner.linearize(at, Linearization { next, a, b: &mut *b, e: &mut *by_p });
            join(e, by_p, b, (inner.np, inner.nu));
        }
    }

    fn output(&mut self, x: &[f64], u: &[f64], p: &[f64], y: &mut [f64]) {
        self.set(u, p);
        self.inner.output(x, &self.u, &self.p, y);
    }

    fn linearize_output(&mut self, at: Stages<'_>, mut out: OutputLinearization<'_>) {
        let (dims, inner) = (self.dims(), self.inner.dims());
        let count = at.count(dims);
        out.check(count, dims);
        for k in 0..count {
            let (at, out) = (at.point(k, dims), out.point(k, dims));
            self.set(at.u, at.p);
            let OutputLinearization { y, c, d, e } = out;
            let by_p = &mut self.e[..inner.ny * inner.np];
            let at = Stages { x: at.x, u: &self.u, p: &self.p };
            self.inner
                .linearize_output(at, OutputLinearization { y, c, d: &mut *d, e: &mut *by_p });
            join(e, by_p, d, (inner.np, inner.nu));
        }
    }
}
