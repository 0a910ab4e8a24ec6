//! The exported parts of a controller, and the refusal of others.

use crate::ExportError;
use crate::error_c::NetError;
use crate::feedback_c::Estimation;
use crate::guard_c::ErrorGuard;
use crate::open::Open;
use crate::runge_kutta_c::RungeKuttaModel;
use crate::tube_c::ExportedTube;
use pinc_expr::PlantEquations;
use pinc_mpc::{
    Bounds, NmpcProblem, PerStage, ProblemUnits, QpMethod, Reference, SqpConfig, SqpHessian,
    Tracked, Weight,
};
use pinc_net::{PincModel, PincNet};
use pinc_ode::{Dims, Integrator, Model, WithOutputs};

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
    /// The plant's equations, where a net is the model and outputs of the plant are tracked,
    /// bounded or measured.
    pub equations: Option<&'a PlantEquations>,
    /// Whether there is a function for the estimated error of the net's step; for C only.
    pub estimates_error: bool,
    /// What watches the estimated error of the net, if anything does.
    pub guard: Option<ErrorGuard<'a>>,
    /// Where the self-test begins.
    pub initial_state: &'a [f64],
    /// The input before the first step, if it is known.
    pub initial_input: Option<&'a [f64]>,
    /// The reference that it follows.
    pub reference: &'a Reference,
    /// Whether it knows later values of the reference in advance.
    pub preview: bool,
    /// How long a step may take by a clock that the caller provides, in us.
    pub budget_us: Option<f64>,
    /// The estimator that tells it the state, if there is one; its disturbances and the parameters
    /// that it estimates are the problem's parameters.
    pub estimator: Option<Estimation<'a>>,
    /// What tightens its bounds, if anything does.
    pub tube: Option<&'a ExportedTube>,
}

/// The source of a controller's model.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub enum ModelSource<'a> {
    /// A net.
    Net(&'a PincNet),
    /// An integrator of equations.
    RungeKutta(RungeKuttaModel<'a>),
}

impl<'a> Controller<'a> {
    /// Length T of a step, in s.
    pub(crate) fn sample_time_s(&self) -> f64 {
        match self.model {
            ModelSource::Net(net) => net.sample_time_s(),
            ModelSource::RungeKutta(model) => model.sample_time_s,
        }
    }

    /// The model, as the library has it, with the outputs that are used.
    pub(crate) fn library_model(&self) -> Result<Box<dyn Model>, ExportError> {
        let net = match self.model {
            ModelSource::Net(net) => PincModel::new(net)?,
            ModelSource::RungeKutta(model) => return model.library(),
        };
        Ok(match self.outputs()? {
            None => Box::new(net),
            Some((equations, names)) => {
                let names: Vec<&str> = names.iter().map(String::as_str).collect();
                let plant = equations.compile_with(&names)?.into_dyn();
                let outputs = plant.model(Integrator::Rk4, self.sample_time_s(), 1)?;
                Box::new(WithOutputs::new(net, outputs))
            }
        })
    }

    /// The input before the first step; 0 if unknown.
    pub(crate) fn first_input(&self, dims: Dims) -> Vec<f64> {
        self.initial_input.map_or_else(|| vec![0.0; dims.nu], <[f64]>::to_vec)
    }

    /// Writes what step `k` follows, by the rule of the closed loop.
    pub(crate) fn window(&self, k: usize, window: &mut [f64]) {
        if self.preview {
            self.reference.preview(k + self.problem.delay, window);
        } else {
            let now = self.reference.at(k);
            window.chunks_exact_mut(now.len()).for_each(|row| row.copy_from_slice(now));
        }
    }

    /// What is measured in the initial state.
    pub(crate) fn measured_at_start(&self) -> Result<Vec<f64>, ExportError> {
        let Some(estimation) = self.estimator else { return Ok(self.initial_state.to_vec()) };
        let mut model = self.library_model()?;
        let dims = model.dims();
        let mut outputs = vec![0.0; dims.ny];
        let p = &estimation.augmentation.parameters;
        model.output(self.initial_state, &self.first_input(dims), p, &mut outputs);
        let all = [self.initial_state, &outputs].concat();
        Ok(estimation.measured(dims)?.into_iter().map(|place| all[place]).collect())
    }

    /// What is tracked, by the places of states, and of outputs behind them.
    pub(crate) fn tracked(&self, dims: Dims) -> Result<Vec<usize>, ExportError> {
        let place = |tracked: &Tracked| match *tracked {
            Tracked::State(state) => Ok(state),
            Tracked::Output(output) => Ok(dims.nx + output),
            Tracked::Input(_) => Err(ExportError::Feature {
                feature: "tracked inputs",
                instead: "states or outputs",
            }),
        };
        self.problem.tracked.iter().map(place).collect()
    }

    /// Whether outputs are tracked.
    pub(crate) fn tracks_outputs(&self) -> bool {
        self.problem.tracked.iter().any(|tracked| matches!(tracked, Tracked::Output(_)))
    }

    /// Whether the optimization looks at outputs.
    pub(crate) fn optimizes_outputs(&self) -> bool {
        self.tracks_outputs() || self.problem.output_bounds.is_some()
    }

    /// The equations of the outputs, with the names of their parameters, if any are used.
    pub(crate) fn outputs(&self) -> Result<Option<(&'a PlantEquations, Vec<String>)>, ExportError> {
        let measured = self.estimator.is_some_and(|of| of.measures_outputs());
        if !measured && !self.optimizes_outputs() {
            return Ok(None);
        }
        match (self.model, self.equations) {
            (ModelSource::RungeKutta(model), _) => {
                Ok(Some((model.equations, model.parameters.to_vec())))
            }
            (ModelSource::Net(net), Some(equations)) => {
                Ok(Some((equations, net.parameter_names().map(str::to_owned).collect())))
            }
            (ModelSource::Net(_), None) => Err(ExportError::Feature {
                feature: "outputs of a plant that another program simulates",
                instead: "states, or a plant whose equations are known",
            }),
        }
    }

    /// The estimate of the model's error, if it is asked for or watched.
    pub(crate) fn net_error(&self) -> Result<Option<NetError<'a>>, ExportError> {
        let refuse = |feature, instead| Err(ExportError::Feature { feature, instead });
        match (self.model, self.equations) {
            _ if !self.estimates_error && self.guard.is_none() => Ok(None),
            (ModelSource::Net(net), Some(equations)) => {
                Ok(Some(NetError { net, equations, open: self.open() }))
            }
            (ModelSource::Net(_), None) => refuse(
                "estimated error without the plant's equation",
                "a plant whose equation is known",
            ),
            (ModelSource::RungeKutta(_), _) => {
                refuse("estimated error of an integrator", "a net as the model, or `pinc certify`")
            }
        }
    }

    /// The parameters that are arguments of the generated model.
    pub(crate) fn open(&self) -> Open<'a> {
        self.estimator.map_or_else(Open::default, |of| Open::of(of.augmentation))
    }

    /// The units in which the optimization computes: those of the first step.
    pub(crate) fn units(&self, dims: Dims) -> ProblemUnits {
        let mut references = vec![0.0; self.problem.horizon * self.problem.tracked.len()];
        self.window(0, &mut references);
        let seen = [self.initial_state, &self.first_input(dims), &references];
        self.problem.units(dims, Some(seen))
    }

    /// Whether the bounds of states and inputs are the same along the horizon, so that a running
    /// controller can be given others.
    pub(crate) fn has_steady_bounds(&self, dims: Dims) -> bool {
        let Bounds { low, .. } = &self.problem.state_bounds;
        low.len() <= dims.nx && self.problem.input_bounds.low.len() <= dims.nu
    }

    /// The diagonals q and r, if the config's weights are such and the same in all stages.
    pub(crate) fn steady_weights(&self) -> Option<[&[f64]; 2]> {
        let diagonal = |of: &'a PerStage<Weight>| match of {
            PerStage::Same(Weight::Diagonal(diagonal)) => Some(&diagonal[..]),
            _ => None,
        };
        let weights = &self.problem.weights;
        Some([diagonal(&weights.q)?, diagonal(&weights.r)?])
    }

    /// Refuses what the generated controller does not have.
    pub(crate) fn check(&self, dims: Dims) -> Result<(), ExportError> {
        let Self { problem, config, .. } = self;
        let refuse = |feature, instead| Err(ExportError::Feature { feature, instead });
        if problem.scenarios.is_some() {
            return refuse("control.scenarios", "`pinc serve`, or a config without the table");
        }
        if problem.constraints.is_some() {
            return refuse(
                "constraints h and g",
                "bounds on states, outputs, inputs and increments",
            );
        }
        if self.estimator.is_none() && !problem.parameters.is_empty() {
            return refuse(
                "parameters of the model",
                "constants, or parameters that are estimated",
            );
        }
        if self.estimator.is_some_and(|of| !of.augmentation.known.is_empty()) {
            return refuse("known parameters", "constants, or parameters that are estimated");
        }
        if config.real_time {
            return refuse("real-time iterations", "sqp.real_time = false and a budget");
        }
        if config.hessian.resolve(problem) == SqpHessian::Adaptive {
            let feature = match problem.leaves_inputs_free() {
                true => {
                    "an input without a weight in r beside fewer controlled quantities than inputs"
                }
                false => "sqp.hessian = \"adaptive\"",
            };
            return refuse(feature, "sqp.hessian = \"gauss-newton\"");
        }
        if config.starts > 1 {
            return refuse("sqp.starts", "sqp.starts = 1");
        }
        let inputs = problem.control_horizon * dims.nu;
        let coupled = problem.weights.input_sequence.is_some();
        let method = match config.qp {
            QpMethod::Auto if coupled || inputs <= MOST_INPUTS => QpMethod::Condensed,
            method => method,
        };
        if method != QpMethod::Condensed {
            return refuse(
                "QP method other than condensed, which is taken for up to 40 free inputs",
                "sqp.qp = \"condensed\", or a shorter control horizon",
            );
        }
        Ok(())
    }

    /// The largest multipliers of the states' bounds, over all stages.
    pub(crate) fn penalties(&self, dims: Dims) -> Vec<f64> {
        let all = 0..self.problem.horizon * dims.nx;
        let last = self.problem.horizon - 1;
        all.map(|v| self.problem.state_penalty(v % dims.nx, v / dims.nx == last)).collect()
    }
}
