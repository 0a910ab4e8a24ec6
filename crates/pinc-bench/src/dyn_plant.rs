//! A plant whose type is forgotten: what runs, examinations and measurements ask of one.

use faer::Mat;
use pinc_net::{
    BatchLoss, Domain, LossWeights, NetConfig, NetError, PincNet, Scenario, Trainer,
    TrainingConfig, ValidationConfig, ValidationSet, Workers,
};
use pinc_ode::{Dims, Dopri5, Model, Plant, Rk4, Rk5, Rodas4, Variable};
use std::fmt::Debug;

/// All that is made from a plant. Its equation is compiled into each of these things, so that this is
/// where code exists once per plant; everything above it exists once.
pub(crate) trait DynPlant: Debug + Send + Sync {
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
    /// The accurate integrator.
    fn truth(&self, tolerance: f64) -> Dopri5;
    /// RK4 over steps of T.
    fn rk4(&self, sample_time_s: f64, substeps: usize) -> Box<dyn Model>;
    /// The Runge-Kutta method of order 5 over steps of T.
    fn rk5(&self, sample_time_s: f64, substeps: usize) -> Box<dyn Model>;
    /// The linearly implicit method over steps of T.
    fn rosenbrock(&self, sample_time_s: f64, substeps: usize) -> Box<dyn Model>;
    /// An untrained net.
    fn net(&self, config: &NetConfig, domain: &Domain, seed: u64) -> Result<PincNet, NetError>;
    /// The loss of such a net.
    fn loss(&self, net: &PincNet, weights: &LossWeights, workers: &Workers) -> BatchLoss;
    /// Scenarios for a net, with their truth.
    fn scenarios(
        &self,
        sample_time_s: f64,
        config: &ValidationConfig,
        seed: u64,
    ) -> Result<ValidationSet, NetError>;
    /// The one scenario of a conventional PINN, with its truth.
    fn scenario(
        &self,
        sample_time_s: f64,
        config: &ValidationConfig,
        scenario: &Scenario,
    ) -> Result<ValidationSet, NetError>;
    /// The training of a net.
    fn trainer(&self, training: Training<'_>) -> Result<Trainer, NetError>;
}

/// The arguments of [`Trainer::new`] besides the plant.
pub(crate) struct Training<'a> {
    pub(crate) net: &'a NetConfig,
    pub(crate) domain: &'a Domain,
    pub(crate) config: &'a TrainingConfig,
    pub(crate) validation: ValidationSet,
    pub(crate) seed: u64,
    pub(crate) threads: usize,
}

impl<P: Plant> DynPlant for P {
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
        self.rhs(x, u, &[], &mut velocity);
        velocity
    }

    fn jacobian(&self, x: &[f64], u: &[f64]) -> Mat<f64> {
        let (n, all) = (x.len(), [x, u].concat());
        let j = pinc_ad::jacobian(|v, dx| self.rhs(&v[..n], &v[n..], &[], dx), &all, n);
        Mat::from_fn(n, all.len(), |row, column| j[row * all.len() + column])
    }

    fn truth(&self, tolerance: f64) -> Dopri5 {
        Dopri5::new(self.clone(), tolerance)
    }

    fn rk4(&self, sample_time_s: f64, substeps: usize) -> Box<dyn Model> {
        Box::new(Rk4::new(self.clone(), sample_time_s, substeps))
    }

    fn rk5(&self, sample_time_s: f64, substeps: usize) -> Box<dyn Model> {
        Box::new(Rk5::new(self.clone(), sample_time_s, substeps))
    }

    fn rosenbrock(&self, sample_time_s: f64, substeps: usize) -> Box<dyn Model> {
        Box::new(Rodas4::new(self.clone(), sample_time_s, substeps))
    }

    fn net(&self, config: &NetConfig, domain: &Domain, seed: u64) -> Result<PincNet, NetError> {
        PincNet::new(self, config, domain, seed)
    }

    fn loss(&self, net: &PincNet, weights: &LossWeights, workers: &Workers) -> BatchLoss {
        BatchLoss::new(self, net, weights, workers)
    }

    fn scenarios(
        &self,
        sample_time_s: f64,
        config: &ValidationConfig,
        seed: u64,
    ) -> Result<ValidationSet, NetError> {
        ValidationSet::generate(self, sample_time_s, config, seed)
    }

    fn scenario(
        &self,
        sample_time_s: f64,
        config: &ValidationConfig,
        scenario: &Scenario,
    ) -> Result<ValidationSet, NetError> {
        ValidationSet::of_scenario(self, sample_time_s, config, scenario)
    }

    fn trainer(&self, training: Training<'_>) -> Result<Trainer, NetError> {
        let Training { net, domain, config, validation, seed, threads } = training;
        Trainer::new(self, net, domain, config, validation, seed, threads)
    }
}
