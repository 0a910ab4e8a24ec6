//! What is exported of a controller, and what cannot be.

use crate::ExportError;
use crate::feedback_c::Estimation;
use crate::rk4_c::Rk4Model;
use pinc_mpc::{Nmpc, NmpcProblem, QpMethod, Reference, Softness, SqpConfig, Tracked};
use pinc_net::{PincModel, PincNet};
use pinc_ode::{Dims, Model};

/// Up to so many free inputs the automatic choice of the QP method is exported, as condensing: the
/// only method there is in C, and fast enough for them.
const MOST_INPUTS: usize = 40;

/// A controller, with what its self-test goes along.
#[derive(Clone, Copy, Debug)]
pub struct Controller<'a> {
    /// The control problem.
    pub problem: &'a NmpcProblem,
    /// The choices of the optimization.
    pub config: &'a SqpConfig,
    /// The model.
    pub model: ModelSource<'a>,
    /// Where the self-test begins.
    pub initial_state: &'a [f64],
    /// What it follows.
    pub reference: &'a Reference,
    /// The estimator that tells it the state, if there is one; its disturbances are the problem's
    /// parameters.
    pub estimator: Option<Estimation<'a>>,
}

/// What the model of a controller is made from.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum ModelSource<'a> {
    /// A net.
    Net(&'a PincNet),
    /// An integrator of equations.
    Rk4(Rk4Model<'a>),
}

impl Controller<'_> {
    /// Length T of a step, in s.
    pub(crate) fn sample_time_s(&self) -> f64 {
        match self.model {
            ModelSource::Net(net) => net.sample_time_s(),
            ModelSource::Rk4(model) => model.sample_time_s,
        }
    }

    /// The model, as the library has it.
    pub(crate) fn library_model(&self) -> Result<Box<dyn Model>, ExportError> {
        Ok(match self.model {
            ModelSource::Net(net) => Box::new(PincModel::new(net)?),
            ModelSource::Rk4(Rk4Model { equations, sample_time_s, substeps }) => {
                equations.compile()?.into_dyn().rk4(sample_time_s, substeps)
            }
        })
    }

    /// The controller, as the library has it.
    pub(crate) fn library(&self) -> Result<Nmpc, ExportError> {
        let model = self.library_model()?;
        let model = match &self.estimator {
            None => model,
            Some(estimation) => estimation.compensated(model)?,
        };
        Ok(Nmpc::new(self.problem.clone(), model, *self.config)?)
    }

    /// What is tracked: states only.
    pub(crate) fn tracked(&self) -> Vec<usize> {
        let state = |tracked: &Tracked| match tracked {
            Tracked::State(state) => Some(*state),
            _ => None,
        };
        self.problem.tracked.iter().filter_map(state).collect()
    }

    /// Refuses what the generated controller does not have.
    pub(crate) fn check(&self, dims: Dims) -> Result<(), ExportError> {
        let Self { problem, config, .. } = self;
        let refuse = |feature, instead| Err(ExportError::Feature { feature, instead });
        if problem.constraints.is_some() {
            return refuse("constraints h and g", "bounds on states, inputs and increments");
        }
        if problem.output_bounds.is_some() || self.tracked().len() != problem.tracked.len() {
            return refuse("outputs that are tracked or bounded", "states");
        }
        if let Some(estimation) = &self.estimator {
            estimation.check()?;
        } else if !problem.parameters.is_empty() {
            return refuse("parameters of the model", "constants");
        }
        if config.real_time {
            return refuse("real-time iterations", "sqp.real_time = false and a budget");
        }
        let inputs = problem.control_horizon * dims.nu;
        let coupled = problem.weights.input_sequence.is_some();
        let method = match config.qp {
            QpMethod::Auto if coupled || inputs <= MOST_INPUTS => QpMethod::Condensed,
            method => method,
        };
        if method != QpMethod::Condensed {
            return refuse(
                "a QP method other than condensed, which is taken for up to 40 free inputs",
                "sqp.qp = \"condensed\", or a shorter control horizon",
            );
        }
        if !problem.is_of_ordinary_size(dims) {
            return refuse(
                "quantities or weights so large or small that the optimization scales them",
                "other units, in which bounds are between 0.1 and 1000",
            );
        }
        Ok(())
    }

    /// Of the states at all stages: the largest multipliers of their bounds.
    pub(crate) fn penalties(&self, dims: Dims) -> Vec<f64> {
        let penalty = |state: usize| match &self.problem.state_softness {
            Softness::Penalty(weights) => weights[state],
            _ => f64::INFINITY,
        };
        let all = 0..self.problem.horizon * dims.nx;
        all.map(|v| penalty(v % dims.nx)).collect()
    }
}
