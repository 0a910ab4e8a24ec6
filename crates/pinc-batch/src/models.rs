//! One model, many steps.

use crate::rows::{Rows, count};
use crate::share::{share, threads};
use pinc_mpc::MpcError;
use pinc_ode::Model;

/// Copies of a model, one per thread.
///
/// ```
/// use pinc_batch::ModelBatch;
/// use pinc_ode::Rk4;
/// use pinc_plants::VanDerPol;
///
/// let mut batch = ModelBatch::new(2, || Box::new(Rk4::new(VanDerPol::default(), 0.5, 4)));
/// // Three steps under the input 0 from each of two states.
/// let states = batch.rollouts(&[0.5, 0.0, -0.2, 0.1], &[0.0; 3], &[])?;
/// assert_eq!(states.len(), 2 * 3 * 2);
/// # Ok::<(), pinc_mpc::MpcError>(())
/// ```
#[derive(Debug)]
pub struct ModelBatch {
    workers: Vec<Box<dyn Model>>,
}

impl ModelBatch {
    /// Makes one model for each of `threads` threads, 0: one per core. All must be the same.
    #[must_use]
    pub fn new(threads: usize, mut make: impl FnMut() -> Box<dyn Model>) -> Self {
        Self { workers: (0..self::threads(threads)).map(|_| make()).collect() }
    }

    /// Returns F(x, u, p) for each state, `[steps, n]`.
    ///
    /// # Shapes
    ///
    /// `x`: `[steps, n]`; `u`: `[steps, m]` or `[m]`; `p`: `[steps, np]` or `[np]`.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if a list is of the wrong length.
    pub fn steps(&mut self, x: &[f64], u: &[f64], p: &[f64]) -> Result<Vec<f64>, MpcError> {
        self.advance(x, u, p, 1)
    }

    /// Returns the states after each step of the model under a sequence of inputs, `[rollouts, K,
    /// n]`, with K from the length of `u`, which is the same for all rollouts.
    ///
    /// # Shapes
    ///
    /// `x`: `[rollouts, n]`; `u`: `[K, m]`; `p`: `[rollouts, np]` or `[np]`.
    ///
    /// # Errors
    ///
    /// [`MpcError`] if a list is of the wrong length.
    pub fn rollouts(&mut self, x: &[f64], u: &[f64], p: &[f64]) -> Result<Vec<f64>, MpcError> {
        let steps = count("u", u, self.workers[0].dims().nu)?;
        self.advance(x, u, p, steps)
    }

    /// `steps` steps from each state.
    fn advance(
        &mut self,
        x: &[f64],
        u: &[f64],
        p: &[f64],
        steps: usize,
    ) -> Result<Vec<f64>, MpcError> {
        let dims = self.workers[0].dims();
        let items = count("x", x, dims.nx)?;
        let x = Rows::new("x", x, dims.nx, items)?;
        let u = Rows::new("u", u, steps * dims.nu, items)?;
        let p = Rows::new("p", p, dims.np, items)?;
        let states = share(
            &mut self.workers,
            items,
            || false,
            |model, k| {
                let mut states = x.at(k).to_vec();
                for (step, u) in u.at(k).chunks_exact(dims.nu.max(1)).enumerate() {
                    states.resize((step + 2) * dims.nx, 0.0);
                    let (before, next) = states.split_at_mut((step + 1) * dims.nx);
                    model.step(&before[step * dims.nx..], u, p.at(k), next);
                }
                states.split_off(dims.nx)
            },
        );
        Ok(states.concat())
    }
}
