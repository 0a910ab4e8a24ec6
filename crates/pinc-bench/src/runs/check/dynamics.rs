//! A plant as examinations see it: they need no more than numbers.

use super::super::control;
use crate::BenchError;
use crate::spec::ControlSpec;
use faer::Mat;
use pinc_ode::{Adaptive, Dims, OdeError, Plant, Predictor, Rk4, Trajectory, Variable};

/// What can be asked of any plant, in plain numbers.
pub(super) trait Dynamics {
    /// Numbers of states and inputs.
    fn dims(&self) -> Dims;
    /// The states.
    fn states(&self) -> &[Variable];
    /// The inputs.
    fn inputs(&self) -> &[Variable];
    /// f(x, u).
    fn velocity(&self, x: &[f64], u: &[f64]) -> Vec<f64>;
    /// df/d(x, u), shape `[n, n + m]`.
    fn jacobian(&self, x: &[f64], u: &[f64]) -> Mat<f64>;
    /// Advances x by `duration_s` under u, to a local error of `tolerance`.
    fn integrate(
        &self,
        x: &mut [f64],
        u: &[f64],
        duration_s: f64,
        tolerance: f64,
    ) -> Result<(), OdeError>;
    /// RK4 over steps of T.
    fn rk4(&self, horizon_s: f64, substeps: usize) -> Box<dyn Predictor>;
    /// The plant's trajectory in the closed loop of `control` with RK4 as the model.
    fn controlled(&self, control: &ControlSpec, horizon_s: f64) -> Result<Trajectory, BenchError>;
}

impl<P: Plant + 'static> Dynamics for P {
    fn dims(&self) -> Dims {
        Plant::dims(self)
    }

    fn states(&self) -> &[Variable] {
        Plant::states(self)
    }

    fn inputs(&self) -> &[Variable] {
        Plant::inputs(self)
    }

    fn velocity(&self, x: &[f64], u: &[f64]) -> Vec<f64> {
        let mut velocity = vec![0.0; x.len()];
        self.rhs(x, u, &mut velocity);
        velocity
    }

    fn jacobian(&self, x: &[f64], u: &[f64]) -> Mat<f64> {
        let (n, all) = (x.len(), [x, u].concat());
        let j = pinc_ad::jacobian(|v, dx| self.rhs(&v[..n], &v[n..], dx), &all, n);
        Mat::from_fn(n, all.len(), |row, column| j[row * all.len() + column])
    }

    fn integrate(
        &self,
        x: &mut [f64],
        u: &[f64],
        duration_s: f64,
        tolerance: f64,
    ) -> Result<(), OdeError> {
        Adaptive::new(self.clone(), tolerance).integrate(x, u, duration_s)
    }

    fn rk4(&self, horizon_s: f64, substeps: usize) -> Box<dyn Predictor> {
        Box::new(Rk4::new(self.clone(), horizon_s, substeps))
    }

    fn controlled(&self, control: &ControlSpec, horizon_s: f64) -> Result<Trajectory, BenchError> {
        control::rehearse(self, control, horizon_s)
    }
}
