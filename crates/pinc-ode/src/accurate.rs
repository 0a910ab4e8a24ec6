//! The truth: the integrator that models are compared with, explicit or implicit by the plant.

use crate::dopri5::Dopri5;
use crate::seulex::Seulex;
use crate::{Dims, DynRhs, OdeError, Plant};
use std::sync::Arc;

/// Steps that stability has limited before the plant counts as stiff, beside one per state: a
/// Jacobian costs about as many evaluations as there are states.
const LIMITED_STEPS: usize = 15;

/// An accurate integrator that finds out whether the plant is stiff.
///
/// It begins as [`Dopri5`]. Once stability and no longer accuracy has limited the size of 15 steps
/// and one more per state, it goes on by an extrapolated linearly implicit Euler method of variable
/// order, whose steps no fast mode limits. The tolerance is the same: the estimated local error of
/// component i is kept below `tolerance * (1 + |x_i|)`. On a plant that is not stiff it takes the
/// steps of [`Dopri5`], bit for bit.
///
/// ```
/// use pinc_ode::AccurateIntegrator;
/// use pinc_plants::VanDerPol;
///
/// let mut truth = AccurateIntegrator::new(VanDerPol::default(), 1e-12);
/// let mut x = [1.0, 0.0];
/// truth.integrate(&mut x, &[0.5], 0.5)?;
/// assert!(!truth.is_implicit());
/// # Ok::<(), pinc_ode::OdeError>(())
/// ```
#[derive(Clone, Debug)]
pub struct AccurateIntegrator {
    explicit: Dopri5,
    implicit: Option<Seulex>,
}

impl AccurateIntegrator {
    /// An integrator of `plant` with this local error tolerance, absolute and relative.
    ///
    /// # Panics
    ///
    /// If `tolerance` is not positive.
    #[must_use]
    pub fn new<P: Plant>(plant: P, tolerance: f64) -> Self {
        Self::shared(Arc::new(plant), tolerance)
    }

    /// Like [`Self::new`], for a plant whose type is erased.
    ///
    /// # Panics
    ///
    /// If `tolerance` is not positive.
    #[must_use]
    pub fn shared(plant: Arc<dyn DynRhs>, tolerance: f64) -> Self {
        Dopri5::shared(plant, tolerance).into()
    }

    /// The plant's sizes.
    #[must_use]
    pub fn dims(&self) -> Dims {
        self.explicit.dims()
    }

    /// Whether the plant has turned out to be stiff.
    #[must_use]
    pub fn is_implicit(&self) -> bool {
        self.implicit.is_some()
    }

    /// Integrates with the parameters `p` (shape `np`) from now on. A plant with parameters needs
    /// them before the first call of [`AccurateIntegrator::integrate`].
    ///
    /// # Panics
    ///
    /// If `p` is not of this length.
    pub fn set_parameters(&mut self, p: &[f64]) {
        self.explicit.set_parameters(p);
    }

    /// The parameters that are set; empty if none are.
    pub(crate) fn parameters(&self) -> &[f64] {
        self.explicit.parameters()
    }

    /// Writes the plant's outputs h(x, u, p) into `y`.
    ///
    /// # Shapes
    ///
    /// `x`: `nx`; `u`: `nu`; `y`: `ny`.
    pub fn output(&self, x: &[f64], u: &[f64], y: &mut [f64]) {
        self.explicit.output(x, u, y);
    }

    /// Advances `x` (shape `nx`) by `duration` seconds under the constant input `u` (shape `nu`). A
    /// duration of 0 leaves `x` as it is.
    ///
    /// # Errors
    ///
    /// As [`Dopri5::integrate`].
    ///
    /// # Panics
    ///
    /// As [`Dopri5::integrate`].
    pub fn integrate(&mut self, x: &mut [f64], u: &[f64], duration: f64) -> Result<(), OdeError> {
        self.explicit.check(x, u, duration);
        let mut reached = 0.0;
        if self.implicit.is_none() {
            let limited = LIMITED_STEPS + self.dims().nx;
            reached = self.explicit.integrate_until_stiff(x, u, duration, Some(limited))?;
        }
        if reached >= duration {
            return Ok(());
        }
        let Dopri5 { plant, tolerance, p, .. } = &self.explicit;
        let implicit =
            self.implicit.get_or_insert_with(|| Seulex::new(Arc::clone(plant), *tolerance));
        implicit.integrate(x, (u, p), reached, duration)
    }
}

impl From<Dopri5> for AccurateIntegrator {
    /// The same integrator, which turns to the implicit method where it finds the plant stiff.
    fn from(explicit: Dopri5) -> Self {
        Self { explicit, implicit: None }
    }
}
