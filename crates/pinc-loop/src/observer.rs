//! The source of the state, for a plant that is only measured.

use pinc_mpc::{MpcError, check_finite};
use pinc_ode::ArgumentError;
use std::fmt::Debug;

/// Sensors and an estimator between the plant of a [`ClosedLoop`](crate::ClosedLoop) and its
/// controller.
pub trait Observer: Debug {
    /// Writes what the controller is to take for the state of the plant in this step, and for the
    /// parameters of its model until the next.
    ///
    /// # Shapes
    ///
    /// `x`: as the model's states; `parameters`: as its parameters, with those in their places that
    /// the controller was told ([`ClosedLoop::set_model_parameters`](crate::ClosedLoop)).
    fn observe(&mut self, plant: PlantNow<'_>, x: &mut [f64], parameters: &mut [f64]);

    /// The covariance of the state and parameters that were given last, `[n + np, n + np]`, where it is
    /// known. It is asked for where the controller has a tube.
    fn covariance(&mut self) -> Option<&[f64]> {
        None
    }

    /// Moves what is followed in this step, `[N2, outputs]`, for a model with these parameters; by
    /// default not at all.
    fn aim(&mut self, parameters: &[f64], reference: &mut [f64]) {
        let _ = (parameters, reference);
    }

    /// Takes note of the input that acts on the plant in this step, `m`.
    fn advance(&mut self, u: &[f64]);
}

/// The plant at the beginning of a step.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct PlantNow<'a> {
    /// The step, counted from 0.
    pub step: usize,
    /// Its state, `n`.
    pub x: &'a [f64],
    /// Its outputs, under the input of the step before.
    pub y: &'a [f64],
}

/// An observer with the numbers that it last gave.
#[derive(Debug)]
pub(crate) struct Watch<'a> {
    observer: &'a mut dyn Observer,
    /// The step it was last asked in.
    asked: Option<usize>,
    pub(crate) x: Vec<f64>,
    pub(crate) parameters: Vec<f64>,
}

impl<'a> Watch<'a> {
    pub(crate) fn new(observer: &'a mut dyn Observer, nx: usize, parameters: Vec<f64>) -> Self {
        Self { observer, asked: None, x: vec![0.0; nx], parameters }
    }

    /// Takes `p` for the last of the parameters.
    pub(crate) fn tell(&mut self, p: &[f64]) -> Result<(), MpcError> {
        let Some(first) = self.parameters.len().checked_sub(p.len()) else {
            let (expected, found) = (self.parameters.len(), p.len());
            return Err(ArgumentError::Length { field: "parameters", expected, found }.into());
        };
        check_finite("parameters", p, p.len())?;
        self.parameters[first..].copy_from_slice(p);
        Ok(())
    }

    /// Asks the observer, once per step.
    pub(crate) fn observe(&mut self, plant: PlantNow<'_>) {
        if self.asked.replace(plant.step) != Some(plant.step) {
            self.observer.observe(plant, &mut self.x, &mut self.parameters);
        }
    }

    pub(crate) fn covariance(&mut self) -> Option<&[f64]> {
        self.observer.covariance()
    }

    pub(crate) fn aim(&mut self, reference: &mut [f64]) {
        self.observer.aim(&self.parameters, reference);
    }

    pub(crate) fn advance(&mut self, u: &[f64]) {
        self.observer.advance(u);
    }
}
