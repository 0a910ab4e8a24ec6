//! A controller for many states at once.

use crate::arrays::{Array, Given, array, values, whole};
use crate::controller::{GivenModel, Origin, OriginParts};
use crate::errors::{input, of_mpc, of_run};
use crate::gradient::{Layout, by_name};
use crate::work::{interrupted, lock, watched};
use numpy::{PyArrayDyn, PyUntypedArrayMethods};
use pinc_batch::{LoopTrace, Situations};
use pinc_config::MOST_THREADS;
use pinc_mpc::Reference;
use pinc_runs::BatchController;
use pinc_sensitivity::ProblemDerivative;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::sync::{Mutex, MutexGuard};

#[doc = doc!("NmpcBatch")]
#[pyclass(module = "pinc_nmpc", frozen)]
#[derive(Debug)]
pub(crate) struct NmpcBatch {
    controller: Mutex<BatchController>,
    origin: Origin,
    threads: usize,
}

#[doc = doc!("StepBatch")]
#[pyclass(module = "pinc_nmpc", frozen, get_all)]
#[derive(Debug, FromPyObject)]
pub(crate) struct StepBatch {
    #[doc = doc!("StepBatch.u")]
    u: Py<PyArrayDyn<f64>>,
    #[doc = doc!("StepBatch.inputs")]
    inputs: Py<PyArrayDyn<f64>>,
    #[doc = doc!("StepBatch.status")]
    status: Vec<String>,
    #[doc = doc!("StepBatch.sqp_iterations")]
    sqp_iterations: Vec<usize>,
    #[doc = doc!("StepBatch.kkt")]
    kkt: Py<PyArrayDyn<f64>>,
}

#[doc = doc!("GradientBatch")]
#[pyclass(module = "pinc_nmpc", frozen, get_all)]
#[derive(Debug, FromPyObject)]
pub(crate) struct GradientBatch {
    #[doc = doc!("GradientBatch.steps")]
    steps: Py<StepBatch>,
    #[doc = doc!("GradientBatch.regularity")]
    regularity: Vec<String>,
    #[doc = doc!("GradientBatch.values")]
    values: Py<PyDict>,
}

#[doc = doc!("LoopBatch")]
#[pyclass(module = "pinc_nmpc", frozen, get_all)]
#[derive(Debug, FromPyObject)]
pub(crate) struct LoopBatch {
    #[doc = doc!("LoopBatch.states")]
    states: Py<PyArrayDyn<f64>>,
    #[doc = doc!("LoopBatch.inputs")]
    inputs: Py<PyArrayDyn<f64>>,
    #[doc = doc!("LoopBatch.status")]
    status: Vec<Vec<String>>,
    #[doc = doc!("LoopBatch.iae")]
    iae: Py<PyArrayDyn<f64>>,
    #[doc = doc!("LoopBatch.max_violation")]
    max_violation: Py<PyArrayDyn<f64>>,
    #[doc = doc!("LoopBatch.error")]
    error: Vec<Option<String>>,
}

/// The arguments of a batch of steps.
struct Arguments {
    x: Vec<f64>,
    reference: Vec<f64>,
    u_before: Vec<f64>,
    parameters: Vec<f64>,
    steps: usize,
}

impl Arguments {
    fn at(&self) -> Situations<'_> {
        Situations {
            x: &self.x,
            reference: &self.reference,
            u_before: &self.u_before,
            parameters: &self.parameters,
        }
    }
}

impl NmpcBatch {
    fn make(origin: Origin, threads: usize) -> PyResult<Self> {
        let mut controller = origin.make(|experiment, model, only| {
            BatchController::new(experiment, model, only, threads, "pinc.NmpcBatch")
        })?;
        controller.batch_mut().ask_to_stop(interrupted);
        Ok(Self { controller: Mutex::new(controller), origin, threads })
    }

    fn lock(&self) -> MutexGuard<'_, BatchController> {
        lock(&self.controller)
    }

    /// m
    fn input_count(&self) -> usize {
        self.lock().batch().nmpc().model().dims().nu
    }

    fn layout(&self) -> Layout {
        let controller = self.lock();
        let outputs = controller.batch().nmpc().problem().tracked.len();
        let measured = &controller.spec().measured_parameters;
        Layout::new(outputs, controller.parameter_names(), measured)
    }

    /// Reads the arguments of a batch of steps.
    fn arguments(
        &self,
        x: &Given<'_>,
        reference: &Given<'_>,
        u_before: Option<&Given<'_>>,
        parameters: Option<&Given<'_>>,
    ) -> PyResult<Arguments> {
        let layout = self.layout();
        let controller = self.lock();
        let nmpc = controller.batch().nmpc();
        let (dims, problem) = (nmpc.model().dims(), nmpc.problem());
        let steps = rows(x, "x", dims.nx)?;
        let (stages, outputs) = (problem.horizon, problem.tracked.len());
        let values_of = values(reference);
        let reference = match *reference.shape() {
            [width] if width == outputs => values_of.repeat(stages),
            [count, width] if count == steps && width == outputs => {
                // A controller that tracks nothing has rows without numbers.
                values_of.chunks_exact(outputs.max(1)).flat_map(|row| row.repeat(stages)).collect()
            }
            [count, n2, width] if count == steps && n2 == stages && width == outputs => values_of,
            _ => {
                return Err(input(format!(
                    "reference: expected {outputs} numbers, or an array of shape ({steps}, \
                     {outputs}) or ({steps}, {stages}, {outputs})"
                )));
            }
        };
        let u_before = match u_before {
            None => controller.initial_input(),
            Some(u_before) if problem.delay > 1 => {
                under_way(u_before, [problem.delay, dims.nu], steps)?
            }
            Some(u_before) => shared_rows(u_before, "u_before", dims.nu, steps)?,
        };
        let width = layout.parameters.len();
        if width == 0 && parameters.is_some_and(|p| !values(p).is_empty()) {
            let problem = "parameters: the model has none; a net of a family has those of \
                           control.measured_parameters";
            return Err(input(problem));
        }
        let given = parameters.map(|p| shared_rows(p, "parameters", width, steps)).transpose()?;
        let own = &problem.parameters;
        let parameters = given.map_or_else(|| own.clone(), |given| layout.insert(&given, own));
        Ok(Arguments { x: values(x), reference, u_before, parameters, steps })
    }
}

#[pymethods]
impl NmpcBatch {
    #[new]
    #[pyo3(signature = (config, model=None, only=None, overrides=None, threads=0))]
    fn new(
        config: &Bound<'_, PyAny>,
        model: Option<GivenModel<'_>>,
        only: Option<&str>,
        overrides: Option<&Bound<'_, PyAny>>,
        threads: i64,
    ) -> PyResult<Self> {
        let threads = whole("threads", threads, 0, MOST_THREADS)?;
        Self::make(Origin::of(config, overrides, model.as_ref(), only)?, threads)
    }

    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let (of, py) = (slf.get(), slf.py());
        let make = py.import("pinc_nmpc._native")?.getattr("restore_batch")?;
        Ok((make, (of.origin.parts(), of.threads).into_pyobject(py)?))
    }

    #[doc = doc!("NmpcBatch.steps")]
    #[pyo3(signature = (x, reference, u_before=None, parameters=None))]
    fn steps(
        &self,
        py: Python<'_>,
        x: Given<'_>,
        reference: Given<'_>,
        u_before: Option<Given<'_>>,
        parameters: Option<Given<'_>>,
    ) -> PyResult<StepBatch> {
        let given = self.arguments(&x, &reference, u_before.as_ref(), parameters.as_ref())?;
        let steps = watched(py, || Ok(self.lock().for_steps()?.steps(given.at())))?;
        let steps = steps.map_err(|error| of_run(&error))?.map_err(of_mpc)?;
        step_batch(py, steps, [given.steps, self.input_count()])
    }

    #[doc = doc!("NmpcBatch.gradients")]
    #[pyo3(signature = (x, reference, by_inputs, u_before=None, parameters=None, smoothing=None))]
    #[expect(clippy::too_many_arguments, reason = "the arguments of a step, by name in Python")]
    fn gradients(
        &self,
        py: Python<'_>,
        x: Given<'_>,
        reference: Given<'_>,
        by_inputs: Given<'_>,
        u_before: Option<Given<'_>>,
        parameters: Option<Given<'_>>,
        smoothing: Option<f64>,
    ) -> PyResult<GradientBatch> {
        let given = self.arguments(&x, &reference, u_before.as_ref(), parameters.as_ref())?;
        let seeds = match *by_inputs.shape() {
            [_] => values(&by_inputs).repeat(given.steps),
            [count, ..] if count == given.steps => values(&by_inputs),
            _ => {
                return Err(input(format!(
                    "by_inputs: expected a vector, or an array whose first dimension is {}",
                    given.steps
                )));
            }
        };
        let found =
            watched(py, || Ok(self.lock().for_steps()?.gradients(given.at(), &seeds, smoothing)))?;
        let found = found.map_err(|error| of_run(&error))?.map_err(of_mpc)?;
        let one = ProblemDerivative::zeros(self.lock().batch().nmpc());
        let values = by_name(py, (&found.gradients, &one), &self.layout(), Some(given.steps))?;
        let (m, under_way) = (self.input_count(), found.by_under_way);
        let each = under_way.len() / (given.steps * m).max(1);
        if each > 1 {
            let by_under_way = array(py, under_way, Some(given.steps), &[each, m])?;
            values.bind(py).set_item("applied_input", by_under_way)?;
        }
        Ok(GradientBatch {
            values,
            regularity: found.regularities.iter().map(ToString::to_string).collect(),
            steps: Py::new(py, step_batch(py, found.steps, [given.steps, m])?)?,
        })
    }

    #[doc = doc!("NmpcBatch.loops")]
    #[pyo3(signature = (x, references, u_before=None))]
    fn loops(
        &self,
        py: Python<'_>,
        x: Given<'_>,
        references: Given<'_>,
        u_before: Option<Given<'_>>,
    ) -> PyResult<LoopBatch> {
        let controller = self.lock();
        let nmpc = controller.batch().nmpc();
        let (dims, outputs) = (nmpc.model().dims(), nmpc.problem().tracked.len());
        let loops = rows(&x, "x", dims.nx)?;
        let numbers = values(&references);
        let (count, steps) = match *references.shape() {
            [steps, width] if steps > 0 && width == outputs => (1, steps),
            [count, steps, width] if count == loops && steps > 0 && width == outputs => {
                (count, steps)
            }
            _ => {
                return Err(input(format!(
                    "references: expected an array of shape (steps, {outputs}) or ({loops}, \
                     steps, {outputs})"
                )));
            }
        };
        let references = (0..count).map(|k| match outputs {
            0 => Ok(Reference::none(steps)),
            _ => {
                let size = steps * outputs;
                Reference::new(numbers[k * size..(k + 1) * size].to_vec(), outputs)
            }
        });
        let references: Vec<_> = references.collect::<Result<_, _>>().map_err(of_mpc)?;
        let u_before = match &u_before {
            None => controller.initial_input(),
            Some(u_before) => shared_rows(u_before, "u_before", dims.nu, loops)?,
        };
        let x = values(&x);
        drop(controller);
        let traces = watched(py, || self.lock().loops(&x, &references, &u_before))?;
        let traces = traces.map_err(|error| of_run(&error))?;
        loop_batch(py, &traces, [steps, dims.nx, dims.nu])
    }

    #[doc = doc!("NmpcBatch.states")]
    #[getter]
    fn states(&self) -> Vec<String> {
        self.lock().variables().state_names()
    }

    #[doc = doc!("NmpcBatch.inputs")]
    #[getter]
    fn inputs(&self) -> Vec<String> {
        self.lock().variables().input_names()
    }

    #[doc = doc!("NmpcBatch.controlled")]
    #[getter]
    fn controlled(&self) -> Vec<String> {
        self.lock().spec().controlled.clone()
    }

    #[doc = doc!("NmpcBatch.parameters")]
    #[getter]
    fn parameters(&self) -> Vec<String> {
        self.layout().names()
    }

    #[doc = doc!("NmpcBatch.delay_steps")]
    #[getter]
    fn delay_steps(&self) -> usize {
        self.lock().batch().nmpc().problem().delay
    }

    #[doc = doc!("NmpcBatch.horizon")]
    #[getter]
    fn horizon(&self) -> usize {
        self.lock().spec().n2
    }

    #[doc = doc!("NmpcBatch.sample_time_s")]
    #[getter]
    fn sample_time_s(&self) -> f64 {
        self.lock().batch().nmpc().model().sample_time_s()
    }
}

/// A batch of what another one was made from.
#[pyfunction]
pub(crate) fn restore_batch(origin: OriginParts, threads: usize) -> PyResult<NmpcBatch> {
    NmpcBatch::make(Origin::from_parts(origin)?, threads)
}

/// How many rows of `width` numbers there are.
fn rows(given: &Given<'_>, name: &str, width: usize) -> PyResult<usize> {
    match *given.shape() {
        [rows, found] if found == width => Ok(rows),
        _ => Err(input(format!("{name}: expected an array of shape (rows, {width})"))),
    }
}

/// Rows of `width` numbers, as many as `count` or one for all.
fn shared_rows(given: &Given<'_>, name: &str, width: usize, count: usize) -> PyResult<Vec<f64>> {
    match *given.shape() {
        [found] if found == width => Ok(values(given)),
        [rows, found] if found == width && rows == count => Ok(values(given)),
        _ => Err(input(format!(
            "{name}: expected {width} numbers, or an array of shape ({count}, {width})"
        ))),
    }
}

/// All inputs under way in each of `steps` steps, given for each or once for all.
fn under_way(given: &Given<'_>, [delay, m]: [usize; 2], steps: usize) -> PyResult<Vec<f64>> {
    match *given.shape() {
        [found, width] if found == delay && width == m => Ok(values(given).repeat(steps)),
        [rows, found, width] if rows == steps && found == delay && width == m => Ok(values(given)),
        _ => Err(input(format!(
            "u_before: expected an array of shape ({delay}, {m}) or ({steps}, {delay}, {m}): with \
             control.delay_steps = {delay} all inputs under way, the next to act first"
        ))),
    }
}

fn step_batch(
    py: Python<'_>,
    found: pinc_batch::StepBatch,
    [steps, m]: [usize; 2],
) -> PyResult<StepBatch> {
    let controls = found.inputs.len() / (steps * m).max(1);
    Ok(StepBatch {
        u: array(py, found.u, Some(steps), &[m])?.unbind(),
        inputs: array(py, found.inputs, Some(steps), &[controls, m])?.unbind(),
        status: found.statuses.iter().map(ToString::to_string).collect(),
        sqp_iterations: found.sqp_iterations,
        kkt: array(py, found.kkt, Some(steps), &[])?.unbind(),
    })
}

/// Loops that ended early have NaN for what is missing.
fn loop_batch(
    py: Python<'_>,
    traces: &[LoopTrace],
    [steps, n, m]: [usize; 3],
) -> PyResult<LoopBatch> {
    let padded =
        |numbers: fn(&LoopTrace) -> &[f64], rows: usize, width: usize| -> PyResult<Array<'_>> {
            let mut all = Vec::new();
            for trace in traces {
                all.extend_from_slice(numbers(trace));
                let missing = rows * width - numbers(trace).len();
                all.extend(std::iter::repeat_n(f64::NAN, missing));
            }
            array(py, all, Some(traces.len()), &[rows, width])
        };
    let one = |number: fn(&LoopTrace) -> f64| -> PyResult<Py<PyArrayDyn<f64>>> {
        let numbers = traces.iter().map(number).collect();
        Ok(array(py, numbers, Some(traces.len()), &[])?.unbind())
    };
    let status = |trace: &LoopTrace| trace.statuses.iter().map(ToString::to_string).collect();
    Ok(LoopBatch {
        states: padded(|trace| &trace.states, steps + 1, n)?.unbind(),
        inputs: padded(|trace| &trace.inputs, steps, m)?.unbind(),
        status: traces.iter().map(status).collect(),
        iae: one(|trace| trace.iae)?,
        max_violation: one(|trace| trace.max_violation)?,
        error: traces.iter().map(|trace| trace.error.as_ref().map(ToString::to_string)).collect(),
    })
}
