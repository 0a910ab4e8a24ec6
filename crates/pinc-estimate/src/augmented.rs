//! The model whose state an estimator estimates.

use crate::disturbed::{BLOCK, Disturbed};
use crate::{Augmentation, Disturbance, EstimateError, Measured};
use pinc_ode::{Dims, Linearization, Model, OutputLinearization, Stages};

/// A model whose state is z = (x, d, theta): the state of the plant, constant disturbances, and
/// unknown parameters,
///
/// ```text
/// x+ = F(x, u, p, d),  d+ = d,  theta+ = theta,  y = what is measured
/// ```
///
/// and whose outputs are what is measured. Its parameters are the known ones.
///
/// ```
/// use pinc_estimate::{Augmentation, Augmented, Disturbance, Measured};
/// use pinc_ode::{Model, Rk4};
/// use pinc_plants::FourTanks;
///
/// let tanks = Rk4::new(FourTanks::antonelo(), 10.0, 4);
/// let two_sensors = Augmentation {
///     disturbance: Disturbance::Input,
///     ..Augmentation::measured(Measured::states([0, 1]))
/// };
/// let model = Augmented::new(Box::new(tanks), two_sensors)?;
/// assert_eq!((model.dims().nx, model.dims().ny), (6, 2));
/// # Ok::<(), pinc_estimate::EstimateError>(())
/// ```
#[derive(Debug)]
pub struct Augmented {
    inner: Disturbed,
    x: Vec<f64>,
    w: Vec<f64>,
    next: Vec<f64>,
    a: Vec<f64>,
    e: Vec<f64>,
    by_x: Vec<f64>,
    by_w: Vec<f64>,
}

impl Augmented {
    /// `model`, augmented.
    ///
    /// # Errors
    ///
    /// [`EstimateError`] if the augmentation does not suit the model.
    pub fn new(model: Box<dyn Model>, augmentation: Augmentation) -> Result<Self, EstimateError> {
        let inner = Disturbed::new(model, augmentation)?;
        let (nx, nw, ny) = (inner.dims().nx, inner.width(), inner.measured().len());
        Ok(Self {
            x: vec![0.0; BLOCK * nx],
            w: vec![0.0; BLOCK * nw],
            next: vec![0.0; BLOCK * nx],
            a: vec![0.0; BLOCK * nx * nx],
            e: vec![0.0; BLOCK * nx * nw],
            by_x: vec![0.0; ny * nx],
            by_w: vec![0.0; ny * nw],
            inner,
        })
    }

    /// The number of disturbances, which come next to the states of the plant.
    #[must_use]
    pub fn disturbances(&self) -> usize {
        let measured = self.inner.measured().len();
        self.inner.disturbance().count(self.inner.dims().nu, measured)
    }

    /// The known parameters until an estimator is told others, `np`.
    #[must_use]
    pub fn known_values(&self) -> Vec<f64> {
        self.inner.known_values()
    }

    /// Returns the measured quantities.
    #[must_use]
    pub fn measured(&self) -> &[Measured] {
        self.inner.measured()
    }

    /// Where disturbances enter.
    #[must_use]
    pub fn disturbance(&self) -> &Disturbance {
        self.inner.disturbance()
    }

    /// Linearizes at one block of points, at most.
    fn linearize_block(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        let Dims { nx, nu, .. } = self.inner.dims();
        let (nz, nw, known) = (nx + self.inner.unknowns(), self.inner.width(), self.inner.known());
        if nw == 0 {
            return self.inner.linearize(at, out);
        }
        let count = at.x.len() / nz;
        for (k, z) in at.x.chunks_exact(nz).enumerate() {
            self.x[k * nx..(k + 1) * nx].copy_from_slice(&z[..nx]);
            let (unknowns, told) = self.w[k * nw..(k + 1) * nw].split_at_mut(nz - nx);
            unknowns.copy_from_slice(&z[nx..]);
            told.copy_from_slice(&at.p[k * known..(k + 1) * known]);
        }
        // The Jacobian by u has zeros below, but the rows of a point are contiguous all the same.
        let Linearization { next, a, b, e: by_known } = out;
        let inner_b = &mut b[..count * nx * nu];
        self.inner.linearize(
            Stages { x: &self.x[..count * nx], u: at.u, p: &self.w[..count * nw] },
            Linearization {
                next: &mut self.next[..count * nx],
                a: &mut self.a[..count * nx * nx],
                b: inner_b,
                e: &mut self.e[..count * nx * nw],
            },
        );
        // From behind, so that nothing is overwritten before it is moved.
        for k in (0..count).rev() {
            b.copy_within(k * nx * nu..(k + 1) * nx * nu, k * nz * nu);
            b[(k * nz + nx) * nu..(k + 1) * nz * nu].fill(0.0);
            let next = &mut next[k * nz..(k + 1) * nz];
            next[..nx].copy_from_slice(&self.next[k * nx..(k + 1) * nx]);
            next[nx..].copy_from_slice(&at.x[k * nz + nx..(k + 1) * nz]);
            let a = &mut a[k * nz * nz..(k + 1) * nz * nz];
            for (i, row) in a.chunks_exact_mut(nz).enumerate() {
                if i < nx {
                    let at = k * nx + i;
                    row[..nx].copy_from_slice(&self.a[at * nx..(at + 1) * nx]);
                    row[nx..].copy_from_slice(&self.e[at * nw..at * nw + nz - nx]);
                } else {
                    row.fill(0.0);
                    row[i] = 1.0;
                }
            }
        }
        by_known.fill(0.0);
        for (at, row) in by_known.chunks_exact_mut(known.max(1)).enumerate() {
            let (k, i) = (at / nz, at % nz);
            if i < nx {
                let from = (k * nx + i + 1) * nw;
                row.copy_from_slice(&self.e[from - known..from]);
            }
        }
    }
}

/// w of a point: its unknowns, in `room` before the known parameters `p` if there are any.
fn with_known<'w>(room: &'w mut [f64], unknowns: &'w [f64], p: &[f64]) -> &'w [f64] {
    if p.is_empty() {
        return unknowns;
    }
    let w = &mut room[..unknowns.len() + p.len()];
    w[..unknowns.len()].copy_from_slice(unknowns);
    w[unknowns.len()..].copy_from_slice(p);
    w
}

impl Model for Augmented {
    fn dims(&self) -> Dims {
        let Dims { nx, nu, .. } = self.inner.dims();
        Dims::new(nx + self.inner.unknowns(), nu)
            .with_parameters(self.inner.known())
            .with_outputs(self.inner.measured().len())
    }

    fn sample_time_s(&self) -> f64 {
        self.inner.sample_time_s()
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        let nx = self.inner.dims().nx;
        let (x, unknowns) = x.split_at(nx);
        let w = with_known(&mut self.w, unknowns, p);
        self.inner.step(Stages { x, u, p: w }, &mut next[..nx]);
        next[nx..].copy_from_slice(unknowns);
    }

    fn linearize(&mut self, at: Stages<'_>, mut out: Linearization<'_>) {
        let dims = self.dims();
        let count = at.count(dims);
        out.check(count, dims);
        for first in (0..count).step_by(BLOCK) {
            let block = first..count.min(first + BLOCK);
            self.linearize_block(at.points(block.clone(), dims), out.points(block, dims));
        }
    }

    fn output(&mut self, x: &[f64], u: &[f64], p: &[f64], y: &mut [f64]) {
        let (x, unknowns) = x.split_at(self.inner.dims().nx);
        self.inner.measure(Stages { x, u, p: with_known(&mut self.w, unknowns, p) }, y);
    }

    fn linearize_output(&mut self, at: Stages<'_>, mut out: OutputLinearization<'_>) {
        let dims = self.dims();
        let count = at.count(dims);
        out.check(count, dims);
        let (nx, nw, known) = (self.inner.dims().nx, self.inner.width(), self.inner.known());
        for k in 0..count {
            let point = at.point(k, dims);
            let OutputLinearization { y, c: by_z, d, e: by_known } = out.point(k, dims);
            if nw == 0 {
                let out = OutputLinearization { y, c: by_z, d, e: by_known };
                self.inner.linearize_measurement(point, out);
                continue;
            }
            let (x, unknowns) = point.x.split_at(nx);
            let w = with_known(&mut self.w, unknowns, point.p);
            self.inner.linearize_measurement(
                Stages { x, u: point.u, p: w },
                OutputLinearization { y, c: &mut self.by_x, d, e: &mut self.by_w },
            );
            for (i, row) in by_z.chunks_exact_mut(dims.nx).enumerate() {
                row[..nx].copy_from_slice(&self.by_x[i * nx..(i + 1) * nx]);
                row[nx..].copy_from_slice(&self.by_w[i * nw..(i + 1) * nw - known]);
            }
            for (i, row) in by_known.chunks_exact_mut(known.max(1)).enumerate() {
                row.copy_from_slice(&self.by_w[(i + 1) * nw - known..(i + 1) * nw]);
            }
        }
    }
}
