//! A controller, step by step.

use crate::arrays::{Array, Given, array, values, vector};
use crate::config::{Parts, Source};
use crate::errors::{input, of_mpc, of_run};
use crate::gradient::{Layout, PlanChange, PlanGradient, read_change};
use crate::model::Model;
use crate::work::lock;
use numpy::{PyArrayDyn, PyUntypedArrayMethods};
use pinc_config::{Experiment, ModelKind};
use pinc_estimate::EstimatorStatus;
use pinc_mpc::{SqpStatus, Trust};
use pinc_runs::{Follow, LiveController, LiveState, ModelFile, RunError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard};

#[doc = doc!("Nmpc")]
#[pyclass(module = "pinc_nmpc", frozen)]
#[derive(Debug)]
pub(crate) struct Nmpc {
    controller: Mutex<LiveController>,
    origin: Origin,
}

/// What a controller was made from, to be made again from it.
#[derive(Debug)]
pub(crate) struct Origin {
    source: Source,
    experiment: Experiment,
    /// The content of the model file.
    pub(crate) model: Option<Vec<u8>>,
    pub(crate) only: Option<String>,
}

/// Config, model file and name of the model.
pub(crate) type OriginParts = (Parts, Option<Vec<u8>>, Option<String>);

impl Origin {
    pub(crate) fn of(
        config: &Bound<'_, PyAny>,
        overrides: Option<&Bound<'_, PyAny>>,
        model: Option<&GivenModel<'_>>,
        only: Option<&str>,
    ) -> PyResult<Self> {
        let source = Source::of(config, overrides)?;
        let experiment = source.experiment()?;
        let model = model.map(GivenModel::bytes).transpose()?;
        Ok(Self { source, experiment, model, only: only.map(str::to_owned) })
    }

    pub(crate) fn from_parts((source, model, only): OriginParts) -> PyResult<Self> {
        let source = Source::from_parts(source);
        Ok(Self { experiment: source.experiment()?, source, model, only })
    }

    /// With every value spelled out: files of the config, those of schedules too, may be gone or others
    /// later.
    pub(crate) fn parts(&self) -> OriginParts {
        (self.source.parts_of(&self.experiment), self.model.clone(), self.only.clone())
    }

    /// Calls `make` with the experiment, the model file and the model's kind.
    pub(crate) fn make<T>(
        &self,
        make: impl FnOnce(&Experiment, Option<ModelFile<'_>>, Option<ModelKind>) -> Result<T, RunError>,
    ) -> PyResult<T> {
        let only = self.only.as_deref().map(kind).transpose()?;
        let model = self.model.as_deref().map(ModelFile::Content);
        make(&self.experiment, model, only).map_err(|error| of_run(&error))
    }
}

impl Nmpc {
    fn make(origin: Origin) -> PyResult<Self> {
        let controller = origin.make(|experiment, model, only| {
            LiveController::new(experiment, model, only, "pinc.Nmpc")
        })?;
        Ok(Self { controller: Mutex::new(controller), origin })
    }

    fn lock(&self) -> MutexGuard<'_, LiveController> {
        lock(&self.controller)
    }

    fn layout(&self) -> Layout {
        let controller = self.lock();
        let outputs = controller.nmpc().problem().tracked.len();
        let measured = &controller.spec().measured_parameters;
        Layout::new(outputs, controller.parameter_names(), measured)
    }
}

#[doc = doc!("ControlStep")]
#[pyclass(module = "pinc_nmpc", frozen, get_all)]
#[derive(Debug, FromPyObject)]
pub(crate) struct ControlStep {
    #[doc = doc!("ControlStep.u")]
    u: Py<PyArrayDyn<f64>>,
    #[doc = doc!("ControlStep.status")]
    status: String,
    #[doc = doc!("ControlStep.x")]
    x: Py<PyArrayDyn<f64>>,
    #[doc = doc!("ControlStep.unknowns")]
    unknowns: Py<PyArrayDyn<f64>>,
    #[doc = doc!("ControlStep.estimator")]
    estimator: Option<String>,
    #[doc = doc!("ControlStep.sqp_iterations")]
    sqp_iterations: usize,
    #[doc = doc!("ControlStep.kkt")]
    kkt: f64,
    #[doc = doc!("ControlStep.cost")]
    cost: Option<f64>,
    #[doc = doc!("ControlStep.curvature_dropped")]
    curvature_dropped: bool,
    #[doc = doc!("ControlStep.start")]
    start: Option<usize>,
    #[doc = doc!("ControlStep.target_found")]
    target_found: Option<bool>,
    #[doc = doc!("ControlStep.in_tube")]
    in_tube: Option<bool>,
    #[doc = doc!("ControlStep.step_us")]
    step_us: f64,
    #[doc = doc!("ControlStep.trust")]
    trust: Option<String>,
    #[doc = doc!("ControlStep.model_error")]
    model_error: Py<PyArrayDyn<f64>>,
}

#[pymethods]
impl ControlStep {
    fn __repr__(&self, py: Python<'_>) -> String {
        let Self { u, status, .. } = self;
        format!("<pinc.ControlStep: u = {}, {status}>", u.bind(py))
    }
}

/// What came of a control step, before it belongs to Python.
struct Taken {
    vectors: [Vec<f64>; 4],
    status: SqpStatus,
    estimator: Option<EstimatorStatus>,
    sqp_iterations: usize,
    kkt: f64,
    cost: Option<f64>,
    curvature_dropped: bool,
    start: Option<usize>,
    target_found: Option<bool>,
    in_tube: Option<bool>,
    step_us: f64,
    trust: Trust,
}

/// What a step is given beside the measurement: reference, applied input, parameters, budget.
type Beside<'a> = (Follow<'a>, Option<&'a [f64]>, Option<&'a [f64]>, Option<f64>);

impl Taken {
    /// Takes the step; one that is refused leaves the parameters as they were.
    fn by(
        controller: &mut LiveController,
        y: &[f64],
        (follow, u_applied, parameters, budget_us): Beside<'_>,
    ) -> Result<Self, RunError> {
        let before = parameters.map(|p| controller.set_measured_parameters(p)).transpose()?;
        let budget_us = budget_us.or(controller.spec().budget_us);
        let taken = controller.step_within(y, follow, u_applied, budget_us).map(|step| Self {
            vectors: [step.u, step.x, step.unknowns, step.model_error].map(<[f64]>::to_vec),
            status: step.status,
            estimator: step.estimator,
            sqp_iterations: step.sqp_iterations,
            kkt: step.kkt,
            cost: step.cost,
            curvature_dropped: step.curvature_dropped,
            start: step.start,
            target_found: step.target_found,
            in_tube: step.in_tube,
            step_us: step.step_us,
            trust: step.trust,
        });
        if let (Err(_), Some(before)) = (&taken, before) {
            controller.set_measured_parameters(&before)?;
        }
        taken
    }

    fn into_step(self, py: Python<'_>) -> PyResult<ControlStep> {
        let vector = |values: Vec<f64>| -> PyResult<Py<PyArrayDyn<f64>>> {
            let n = values.len();
            Ok(array(py, values, None, &[n])?.unbind())
        };
        let [u, x, unknowns, model_error] = self.vectors;
        Ok(ControlStep {
            trust: (!model_error.is_empty()).then(|| self.trust.to_string()),
            u: vector(u)?,
            status: self.status.to_string(),
            x: vector(x)?,
            unknowns: vector(unknowns)?,
            estimator: self.estimator.map(|status| status.to_string()),
            sqp_iterations: self.sqp_iterations,
            kkt: self.kkt,
            cost: self.cost,
            curvature_dropped: self.curvature_dropped,
            start: self.start,
            target_found: self.target_found,
            in_tube: self.in_tube,
            step_us: self.step_us,
            model_error: vector(model_error)?,
        })
    }
}

/// What is given for the model of a controller.
#[derive(FromPyObject)]
pub(crate) enum GivenModel<'py> {
    Model(Bound<'py, Model>),
    Path(PathBuf),
}

impl GivenModel<'_> {
    /// The content of the model file.
    fn bytes(&self) -> PyResult<Vec<u8>> {
        match self {
            Self::Path(path) => Ok(Model::load(path.clone())?.bytes()),
            Self::Model(model) => Ok(model.get().bytes()),
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
        Self::make(Origin::of(config, overrides, model.as_ref(), only)?)
    }

    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let (of, py) = (slf.get(), slf.py());
        let make = py.import("pinc_nmpc._native")?.getattr("restore_nmpc")?;
        Ok((make, (of.origin.parts(), of.state()).into_pyobject(py)?))
    }

    #[doc = doc!("Nmpc.step")]
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
        let taken = py.detach(|| {
            let mut controller = self.lock();
            let taken = Taken::by(
                &mut controller,
                &y,
                (follow, u_applied.as_deref(), parameters.as_deref(), budget_us),
            );
            if taken.is_ok() {
                controller.prepare();
            }
            taken
        });
        taken.map_err(|error| of_run(&error))?.into_step(py)
    }

    #[doc = doc!("Nmpc.adjoint")]
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
        let layout = self.layout();
        let mut controller = self.lock();
        let mut sensitivity = controller.sensitivity(smoothing).map_err(|e| of_run(&e))?;
        let gradient = sensitivity.adjoint(&by_states, &by_inputs).map_err(of_mpc)?;
        PlanGradient::new(py, sensitivity.regularity(), (&gradient, &layout))
    }

    #[doc = doc!("Nmpc.sensitivity")]
    #[pyo3(signature = (change, smoothing=None))]
    fn sensitivity(
        &self,
        py: Python<'_>,
        change: &Bound<'_, PyDict>,
        smoothing: Option<f64>,
    ) -> PyResult<PlanChange> {
        let layout = self.layout();
        let mut controller = self.lock();
        let dims = controller.nmpc().model().dims();
        let mut sensitivity = controller.sensitivity(smoothing).map_err(|e| of_run(&e))?;
        let mut numbers = sensitivity.no_change();
        read_change(change, &layout, &mut numbers)?;
        let moved = sensitivity.forward(&numbers).map_err(of_mpc)?;
        let parts = [(moved.states(), dims.nx), (moved.inputs(), dims.nu)];
        PlanChange::new(py, sensitivity.regularity(), parts)
    }

    #[doc = doc!("Nmpc.reset")]
    fn reset(&self) -> PyResult<()> {
        self.lock().reset().map_err(|error| of_run(&error))
    }

    #[doc = doc!("Nmpc.state")]
    fn state(&self) -> String {
        self.lock().state().to_json()
    }

    #[doc = doc!("Nmpc.set_state")]
    fn set_state(&self, state: &str) -> PyResult<()> {
        let state = LiveState::from_json(state).map_err(|error| of_run(&error))?;
        self.lock().set_state(&state).map_err(|error| of_run(&error))
    }

    #[doc = doc!("Nmpc.predicted_states")]
    #[getter]
    fn predicted_states<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let controller = self.lock();
        let (plan, nx) = (controller.plan(), controller.nmpc().model().dims().nx);
        let states = plan.states().to_vec();
        let rows = states.len() / nx;
        array(py, states, Some(rows), &[nx])
    }

    #[doc = doc!("Nmpc.planned_inputs")]
    #[getter]
    fn planned_inputs<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let controller = self.lock();
        let (plan, nu) = (controller.plan(), controller.nmpc().model().dims().nu);
        let inputs = plan.inputs().to_vec();
        let rows = inputs.len() / nu;
        array(py, inputs, Some(rows), &[nu])
    }

    #[doc = doc!("Nmpc.measured")]
    #[getter]
    fn measured(&self) -> Vec<String> {
        self.lock().measured()
    }

    #[doc = doc!("Nmpc.states")]
    #[getter]
    fn states(&self) -> Vec<String> {
        self.lock().variables().state_names()
    }

    #[doc = doc!("Nmpc.inputs")]
    #[getter]
    fn inputs(&self) -> Vec<String> {
        self.lock().variables().input_names()
    }

    #[doc = doc!("Nmpc.controlled")]
    #[getter]
    fn controlled(&self) -> Vec<String> {
        self.lock().spec().controlled.clone()
    }

    #[doc = doc!("Nmpc.unknowns")]
    #[getter]
    fn unknowns(&self) -> Vec<String> {
        self.lock().unknowns().to_vec()
    }

    #[doc = doc!("Nmpc.parameters")]
    #[getter]
    fn parameters(&self) -> Vec<String> {
        self.layout().names()
    }

    #[doc = doc!("Nmpc.horizon")]
    #[getter]
    fn horizon(&self) -> usize {
        self.lock().spec().n2
    }

    #[doc = doc!("Nmpc.sample_time_s")]
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

/// A controller of what another one was made from, in its state.
#[pyfunction]
pub(crate) fn restore_nmpc(origin: OriginParts, state: &str) -> PyResult<Nmpc> {
    let nmpc = Nmpc::make(Origin::from_parts(origin)?)?;
    nmpc.set_state(state)?;
    Ok(nmpc)
}

/// A reference as it is given: for the whole horizon, or a row per step ahead.
enum Reference {
    Held(Vec<f64>),
    Stages(Vec<Vec<f64>>),
}

impl Reference {
    fn read(given: &Given<'_>) -> PyResult<Self> {
        match *given.shape() {
            [] | [_] => Ok(Self::Held(values(given))),
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
