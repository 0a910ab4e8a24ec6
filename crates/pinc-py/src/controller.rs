//! A controller, step by step.

use crate::arrays::{Array, Given, array, values, vector};
use crate::config::experiment;
use crate::errors::{input, of_mpc, of_run};
use crate::gradient::{PlanChange, PlanGradient, read_change};
use crate::model::Model;
use numpy::{PyArrayDyn, PyUntypedArrayMethods};
use pinc_config::ModelKind;
use pinc_runs::{Follow, LiveController, LiveState, ModelFile};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The controller of a config, with its estimator if the config has one.
#[pyclass(module = "pinc", frozen)]
#[derive(Debug)]
pub(crate) struct Nmpc {
    controller: Mutex<LiveController>,
}

impl Nmpc {
    fn lock(&self) -> MutexGuard<'_, LiveController> {
        self.controller.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What came of a control step.
#[pyclass(module = "pinc", frozen, get_all)]
#[derive(Debug)]
pub(crate) struct ControlStep {
    /// The input to apply.
    u: Py<PyArrayDyn<f64>>,
    /// How the optimization ended.
    status: String,
    /// The state that the controller took the plant to be in.
    x: Py<PyArrayDyn<f64>>,
    /// The estimated disturbances and parameters.
    unknowns: Py<PyArrayDyn<f64>>,
    /// How the estimator's correction ended, or None.
    estimator: Option<String>,
    /// How many quadratic programs were solved.
    sqp_iterations: usize,
    /// The KKT residual that the optimization ended with.
    kkt: f64,
    /// The plan's cost with `control.cost`, or None.
    cost: Option<f64>,
    /// Whether negative curvature was dropped.
    curvature_dropped: bool,
    /// How long the step took, in us.
    step_us: f64,
    /// Whether the net was trusted in the plan's first step, or None without a tolerance.
    trust: Option<String>,
    /// The estimated error of the net in that step; empty without a tolerance.
    model_error: Py<PyArrayDyn<f64>>,
}

#[pymethods]
impl ControlStep {
    fn __repr__(&self, py: Python<'_>) -> String {
        let Self { u, status, .. } = self;
        format!("<pinc.ControlStep: u = {}, {status}>", u.bind(py))
    }
}

/// What is given for the model of a controller.
#[derive(FromPyObject)]
pub(crate) enum GivenModel<'py> {
    Model(Bound<'py, Model>),
    Path(PathBuf),
}

impl GivenModel<'_> {
    /// Calls `make` with the model.
    pub(crate) fn with<T>(
        given: Option<&Self>,
        make: impl FnOnce(Option<ModelFile<'_>>) -> T,
    ) -> T {
        match given {
            None => make(None),
            Some(Self::Path(path)) => make(Some(ModelFile::At(path))),
            Some(Self::Model(model)) => make(Some(ModelFile::Content(&model.get().bytes()))),
        }
    }
}

#[pymethods]
impl Nmpc {
    #[new]
    #[pyo3(signature = (config, model=None, only=None, overrides=None))]
    fn new(
        config: &Bound<'_, PyAny>,
        model: Option<GivenModel<'_>>,
        only: Option<&str>,
        overrides: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let experiment = experiment(config, overrides)?;
        let only = only.map(kind).transpose()?;
        let controller = GivenModel::with(model.as_ref(), |model| {
            LiveController::new(&experiment, model, only, "pinc.Nmpc")
        });
        let controller = controller.map_err(|error| of_run(&error))?;
        Ok(Self { controller: Mutex::new(controller) })
    }

    /// Chooses the input for a plant of which y was measured.
    #[pyo3(signature = (y, reference=None, u_applied=None, parameters=None, budget_us=None))]
    fn step(
        &self,
        py: Python<'_>,
        y: Given<'_>,
        reference: Option<Given<'_>>,
        u_applied: Option<Given<'_>>,
        parameters: Option<Given<'_>>,
        budget_us: Option<f64>,
    ) -> PyResult<ControlStep> {
        let y = vector(&y, "y")?;
        let u_applied = u_applied.map(|u| vector(&u, "u_applied")).transpose()?;
        let wanted = reference.map(|reference| Reference::read(&reference)).transpose()?;
        let follow = match &wanted {
            None => Follow::Config,
            Some(Reference::Held(row)) => Follow::Held(row),
            Some(Reference::Stages(rows)) => Follow::Stages(rows),
        };
        let parameters = parameters.map(|p| vector(&p, "parameters")).transpose()?;
        let mut controller = self.lock();
        let before = parameters.map(|p| controller.set_measured_parameters(&p)).transpose();
        let before = before.map_err(|error| of_run(&error))?;
        let budget_us = budget_us.or(controller.spec().budget_us);
        let step = match controller.step_within(&y, follow, u_applied.as_deref(), budget_us) {
            Ok(step) => step,
            Err(error) => {
                if let Some(before) = before {
                    let restored = controller.set_measured_parameters(&before);
                    restored.map_err(|error| of_run(&error))?;
                }
                return Err(of_run(&error));
            }
        };
        let vector = |values: &[f64]| -> PyResult<Py<PyArrayDyn<f64>>> {
            Ok(array(py, values.to_vec(), None, &[values.len()])?.unbind())
        };
        let done = ControlStep {
            u: vector(step.u)?,
            status: step.status.to_string(),
            x: vector(step.x)?,
            unknowns: vector(step.unknowns)?,
            estimator: step.estimator.map(|status| status.to_string()),
            sqp_iterations: step.sqp_iterations,
            kkt: step.kkt,
            cost: step.cost,
            curvature_dropped: step.curvature_dropped,
            step_us: step.step_us,
            trust: (!step.model_error.is_empty()).then(|| step.trust.to_string()),
            model_error: vector(step.model_error)?,
        };
        controller.prepare();
        Ok(done)
    }

    /// The gradient of a function of the last plan in all that its problem is given.
    #[pyo3(signature = (by_inputs=None, by_states=None, smoothing=None))]
    fn adjoint(
        &self,
        py: Python<'_>,
        by_inputs: Option<Given<'_>>,
        by_states: Option<Given<'_>>,
        smoothing: Option<f64>,
    ) -> PyResult<PlanGradient> {
        let [by_inputs, by_states] =
            [by_inputs, by_states].map(|seed| seed.map_or(Vec::new(), |seed| values(&seed)));
        let mut controller = self.lock();
        let mut sensitivity = controller.sensitivity(smoothing).map_err(|e| of_run(&e))?;
        let gradient = sensitivity.adjoint(&by_states, &by_inputs).map_err(of_mpc)?;
        PlanGradient::new(py, sensitivity.regularity(), &gradient)
    }

    /// By how much the last plan changes with what its problem is given.
    #[pyo3(signature = (change, smoothing=None))]
    fn sensitivity(
        &self,
        py: Python<'_>,
        change: &Bound<'_, PyDict>,
        smoothing: Option<f64>,
    ) -> PyResult<PlanChange> {
        let mut controller = self.lock();
        let dims = controller.nmpc().model().dims();
        let mut sensitivity = controller.sensitivity(smoothing).map_err(|e| of_run(&e))?;
        let mut numbers = sensitivity.no_change();
        read_change(change, &mut numbers)?;
        let moved = sensitivity.forward(&numbers).map_err(of_mpc)?;
        let parts = [(moved.states(), dims.nx), (moved.inputs(), dims.nu)];
        PlanChange::new(py, sensitivity.regularity(), parts)
    }

    /// Forgets everything: the next step is again the first.
    fn reset(&self) -> PyResult<()> {
        self.lock().reset().map_err(|error| of_run(&error))
    }

    /// What the next step starts from, as JSON.
    fn state(&self) -> String {
        self.lock().state().to_json()
    }

    /// Goes on from the state of another controller of the same config.
    fn set_state(&self, state: &str) -> PyResult<()> {
        let state = LiveState::from_json(state).map_err(|error| of_run(&error))?;
        self.lock().set_state(&state).map_err(|error| of_run(&error))
    }

    /// The states of the last plan at the ends of the steps ahead.
    #[getter]
    fn predicted_states<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let controller = self.lock();
        let (plan, nx) = (controller.nmpc().plan(), controller.nmpc().model().dims().nx);
        let states = plan.states().to_vec();
        let rows = states.len() / nx;
        array(py, states, Some(rows), &[nx])
    }

    /// The inputs of the last plan, the one chosen first.
    #[getter]
    fn planned_inputs<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let controller = self.lock();
        let (plan, nu) = (controller.nmpc().plan(), controller.nmpc().model().dims().nu);
        let inputs = plan.inputs().to_vec();
        let rows = inputs.len() / nu;
        array(py, inputs, Some(rows), &[nu])
    }

    /// Names of what is measured: the argument y of a step.
    #[getter]
    fn measured(&self) -> Vec<String> {
        self.lock().measured()
    }

    /// Names of the states.
    #[getter]
    fn states(&self) -> Vec<String> {
        self.lock().variables().state_names()
    }

    /// Names of the inputs.
    #[getter]
    fn inputs(&self) -> Vec<String> {
        self.lock().variables().input_names()
    }

    /// Names of what is controlled: the columns of a reference.
    #[getter]
    fn controlled(&self) -> Vec<String> {
        self.lock().spec().controlled.clone()
    }

    /// Names of the disturbances and parameters that are estimated.
    #[getter]
    fn unknowns(&self) -> Vec<String> {
        self.lock().unknowns().to_vec()
    }

    /// N2, the number of steps ahead.
    #[getter]
    fn horizon(&self) -> usize {
        self.lock().spec().n2
    }

    /// Length T of a step in s.
    #[getter]
    fn sample_time_s(&self) -> f64 {
        self.lock().nmpc().model().sample_time_s()
    }

    fn __repr__(&self) -> String {
        let controller = self.lock();
        format!(
            "<pinc.Nmpc: measured {}; inputs {}; controlled {}>",
            controller.measured().join(", "),
            controller.variables().input_names().join(", "),
            controller.spec().controlled.join(", ")
        )
    }
}

/// A reference as it is given: for the whole horizon, or a row per step ahead.
enum Reference {
    Held(Vec<f64>),
    Stages(Vec<Vec<f64>>),
}

impl Reference {
    fn read(given: &Given<'_>) -> PyResult<Self> {
        match *given.shape() {
            [_] => Ok(Self::Held(values(given))),
            [rows, width] => {
                let values = values(given);
                let row = |k: usize| values[k * width..(k + 1) * width].to_vec();
                Ok(Self::Stages((0..rows).map(row).collect()))
            }
            ref found => Err(input(format!(
                "reference: an array of {} dimensions given, expected a number per controlled \
                 quantity, or a row of them per step of the horizon",
                found.len()
            ))),
        }
    }
}

/// The model of this name.
pub(crate) fn kind(name: &str) -> PyResult<ModelKind> {
    ModelKind::from_name(name).ok_or_else(|| {
        let names = ModelKind::NAMES.join(", ");
        input(format!("only: {name:?} given, expected one of {names}"))
    })
}
