//! The plant's state in time, as exact as possible: the truth of all comparisons.

use crate::{AccurateIntegrator, BlackBox, Dims, Dopri5, DynRhs, OdeError};

/// A plant in time: an equation is integrated accurately, a [`BlackBox`] asked.
#[derive(Clone, Debug)]
pub struct Simulator(Kind);

#[derive(Clone, Debug)]
enum Kind {
    Equation(Box<AccurateIntegrator>),
    BlackBox(Box<BlackBox>),
}

impl From<AccurateIntegrator> for Simulator {
    fn from(integrator: AccurateIntegrator) -> Self {
        Self(Kind::Equation(Box::new(integrator)))
    }
}

impl From<Dopri5> for Simulator {
    fn from(integrator: Dopri5) -> Self {
        AccurateIntegrator::from(integrator).into()
    }
}

impl Simulator {
    /// Returns the simulator of `plant`, whose equation is integrated with this local error tolerance,
    /// absolute and relative; a black box has its own accuracy.
    ///
    /// # Panics
    ///
    /// If `tolerance` is not positive.
    #[must_use]
    pub fn new(plant: &dyn DynRhs, tolerance: f64) -> Self {
        match plant.black_box() {
            None => AccurateIntegrator::shared(plant.to_shared(), tolerance).into(),
            Some(black_box) => Self(Kind::BlackBox(Box::new(black_box.clone()))),
        }
    }

    /// The plant's sizes.
    #[must_use]
    pub fn dims(&self) -> Dims {
        match &self.0 {
            Kind::Equation(integrator) => integrator.dims(),
            Kind::BlackBox(plant) => plant.dims(),
        }
    }

    /// Lets the plant have the parameters `p` (shape `np`) from now on. One with parameters needs
    /// them before the first call of [`Simulator::integrate`]; a black box has none.
    ///
    /// # Panics
    ///
    /// If `p` is not of this length.
    pub fn set_parameters(&mut self, p: &[f64]) {
        match &mut self.0 {
            Kind::Equation(integrator) => integrator.set_parameters(p),
            Kind::BlackBox(plant) => assert_eq!(p.len(), plant.dims().np, "length of p"),
        }
    }

    /// Returns the parameters that are set; empty if none are.
    #[must_use]
    pub fn parameters(&self) -> &[f64] {
        match &self.0 {
            Kind::Equation(integrator) => integrator.parameters(),
            Kind::BlackBox(_) => &[],
        }
    }

    /// Writes the plant's outputs h(x, u, p) into `y`.
    ///
    /// # Shapes
    ///
    /// `x`: `nx`; `u`: `nu`; `y`: `ny`.
    pub fn output(&self, x: &[f64], u: &[f64], y: &mut [f64]) {
        match &self.0 {
            Kind::Equation(integrator) => integrator.output(x, u, y),
            Kind::BlackBox(plant) => plant.output(x, u, &[], y),
        }
    }

    /// Moves `x` (shape `nx`) on by `duration` seconds under the constant input `u` (shape `nu`).
    /// A duration of 0 leaves `x` as it is.
    ///
    /// # Errors
    ///
    /// See [`AccurateIntegrator::integrate`]; [`OdeError::External`] and
    /// [`OdeError::NotFinite`] for what a black box does not answer with numbers.
    ///
    /// # Panics
    ///
    /// As [`AccurateIntegrator::integrate`].
    pub fn integrate(&mut self, x: &mut [f64], u: &[f64], duration: f64) -> Result<(), OdeError> {
        match &mut self.0 {
            Kind::Equation(integrator) => integrator.integrate(x, u, duration),
            Kind::BlackBox(plant) => {
                assert!(
                    duration >= 0.0 && duration.is_finite(),
                    "the duration must be finite and not negative"
                );
                let Dims { nx, nu, .. } = plant.dims();
                assert_eq!((x.len(), u.len()), (nx, nu), "lengths of x and u");
                if duration == 0.0 {
                    return Ok(());
                }
                let state = x.to_vec();
                plant.flow.advance(x, u, duration)?;
                match x.iter().all(|x| x.is_finite()) {
                    true => Ok(()),
                    false => Err(OdeError::NotFinite { t: 0.0, state }),
                }
            }
        }
    }
}
