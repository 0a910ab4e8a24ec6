//! The model of a controller that knows the disturbances.

use crate::disturbed::{BLOCK, Disturbed};
use crate::{Augmentation, Disturbance, EstimateError, Measured};
use pinc_mpc::{NmpcProblem, Weights};
use pinc_ode::{Dims, Linearization, Model, OutputLinearization, Stages};

/// A model whose parameters are the estimated disturbances and parameters and the known parameters,
/// w = (d, theta, known): what a controller predicts with, while an estimator of the
/// [`Augmented`](crate::Augmented) model says what d and theta are.
///
/// A disturbance of a measured state is part of the state here: the controller sees x + d, which is
/// what follows references and is bounded, and the model is x + d -> F(x, u) + d. Disturbances of
/// other outputs are added to these. Disturbances of other states are what a step adds, whatever its
/// length, so that the models of a horizon must be of one length. [`Augmentation::read`] takes x + d and w from an estimate;
/// [`Compensated::problem`] begins the control problem of this model.
///
/// ```
/// use pinc_estimate::{Augmentation, Compensated, Disturbance, Measured};
/// use pinc_ode::{Model, Rk4};
/// use pinc_plants::VanDerPol;
///
/// let load = Augmentation {
///     disturbance: Disturbance::Input,
///     ..Augmentation::measured(Measured::states([0]))
/// };
/// let oscillator = || Rk4::new(VanDerPol::default(), 0.5, 4);
/// let mut model = Compensated::new(Box::new(oscillator()), load)?;
/// let (mut found, mut expected) = ([0.0; 2], [0.0; 2]);
/// model.step(&[1.0, 0.0], &[0.5], &[-0.125], &mut found);
/// oscillator().step(&[1.0, 0.0], &[0.375], &[], &mut expected);
/// assert_eq!(found, expected);
/// # Ok::<(), pinc_estimate::EstimateError>(())
/// ```
#[derive(Debug)]
pub struct Compensated {
    inner: Disturbed,
    /// Measured states that have a disturbance, each with the place of that in w.
    shifted: Vec<(usize, usize)>,
    /// Measured outputs that have one.
    outputs: Vec<(usize, usize)>,
    /// States without their disturbances, of a block.
    x: Vec<f64>,
}

impl Compensated {
    /// `model`, with the disturbances and parameters that `augmentation` names as its parameters.
    ///
    /// # Errors
    ///
    /// [`EstimateError`] if the augmentation does not suit the model.
    pub fn new(model: Box<dyn Model>, augmentation: Augmentation) -> Result<Self, EstimateError> {
        let inner = Disturbed::new(model, augmentation)?;
        let disturbed = *inner.disturbance() == Disturbance::Output;
        let (mut shifted, mut outputs) = (Vec::new(), Vec::new());
        for (place, measured) in inner.measured().iter().enumerate().filter(|_| disturbed) {
            match *measured {
                Measured::State(state) => shifted.push((state, place)),
                Measured::Output(output) => outputs.push((output, place)),
            }
        }
        let x = vec![0.0; BLOCK * inner.dims().nx];
        Ok(Self { inner, shifted, outputs, x })
    }

    /// The control problem of this model, as [`NmpcProblem::new`] has it: until an estimator says
    /// otherwise, there are no disturbances, and the parameters have the values of
    /// [`Augmentation::parameters`].
    #[must_use]
    pub fn problem(&self, horizon: usize, weights: Weights) -> NmpcProblem {
        let parameters = self.inner.nominal();
        NmpcProblem { parameters, ..NmpcProblem::new(self.dims(), horizon, weights) }
    }

    /// Takes the disturbances off the states of some points.
    fn unshift(&mut self, x: &[f64], w: &[f64]) {
        let (nx, nw) = (self.inner.dims().nx, self.inner.width());
        self.x[..x.len()].copy_from_slice(x);
        for (k, x) in self.x[..x.len()].chunks_exact_mut(nx).enumerate() {
            for &(state, place) in &self.shifted {
                x[state] -= w[k * nw + place];
            }
        }
    }

    fn linearize_block(&mut self, at: Stages<'_>, out: Linearization<'_>) {
        let (nx, nw) = (self.inner.dims().nx, self.inner.width());
        self.unshift(at.x, at.p);
        let Linearization { next, a, b, e } = out;
        self.inner.linearize(
            Stages { x: &self.x[..at.x.len()], ..at },
            Linearization { next: &mut *next, a: &mut *a, b, e: &mut *e },
        );
        for (k, next) in next.chunks_exact_mut(nx).enumerate() {
            for &(state, place) in &self.shifted {
                next[state] += at.p[k * nw + place];
                for (i, e) in e.chunks_exact_mut(nw).skip(k * nx).take(nx).enumerate() {
                    let own = if i == state { 1.0 } else { 0.0 };
                    e[place] = own - a[(k * nx + i) * nx + state];
                }
            }
        }
    }
}

impl Model for Compensated {
    fn dims(&self) -> Dims {
        self.inner.dims().with_parameters(self.inner.width())
    }

    fn sample_time_s(&self) -> f64 {
        self.inner.sample_time_s()
    }

    fn step(&mut self, x: &[f64], u: &[f64], p: &[f64], next: &mut [f64]) {
        self.unshift(x, p);
        self.inner.step(Stages { x: &self.x[..x.len()], u, p }, next);
        for &(state, place) in &self.shifted {
            next[state] += p[place];
        }
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
        self.unshift(x, p);
        self.inner.all_outputs(Stages { x: &self.x[..x.len()], u, p }, y);
        for &(output, place) in &self.outputs {
            y[output] += p[place];
        }
    }

    fn feedthrough(&self) -> Vec<bool> {
        self.inner.feedthrough()
    }

    fn linearize_output(&mut self, at: Stages<'_>, mut out: OutputLinearization<'_>) {
        let dims = self.dims();
        let count = at.count(dims);
        out.check(count, dims);
        for k in 0..count {
            let point = at.point(k, dims);
            let OutputLinearization { y, c, d, e } = out.point(k, dims);
            self.unshift(point.x, point.p);
            let here = Stages { x: &self.x[..dims.nx], ..point };
            let results = OutputLinearization { y: &mut *y, c: &mut *c, d, e: &mut *e };
            self.inner.linearize_all_outputs(here, results);
            for &(output, place) in &self.outputs {
                y[output] += point.p[place];
                if let Some(e) = e.get_mut(output * dims.np + place) {
                    *e = 1.0;
                }
            }
            for &(state, place) in &self.shifted {
                for (e, c) in e.chunks_exact_mut(dims.np).zip(c.chunks_exact(dims.nx)) {
                    e[place] = -c[state];
                }
            }
        }
    }
}
