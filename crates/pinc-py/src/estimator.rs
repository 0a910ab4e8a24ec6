//! The estimator of a config, step by step.

use crate::arrays::{Array, Given, array, vector};
use crate::controller::{GivenModel, Origin, OriginParts};
use crate::errors::input;
use crate::work::lock;
use pinc_ode::Memory;
use pinc_runs::ConfigEstimator;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::sync::{Mutex, MutexGuard};

#[doc = doc!("Estimator")]
#[pyclass(module = "pinc_nmpc", frozen)]
#[derive(Debug)]
pub(crate) struct Estimator {
    estimator: Mutex<ConfigEstimator>,
    origin: Origin,
}

#[doc = doc!("Correction")]
#[pyclass(module = "pinc_nmpc", frozen, get_all)]
#[derive(Debug, FromPyObject)]
pub(crate) struct Correction {
    #[doc = doc!("Correction.status")]
    status: String,
    #[doc = doc!("Correction.nis")]
    nis: f64,
    #[doc = doc!("Correction.measured")]
    measured: usize,
    #[doc = doc!("Correction.rejected")]
    rejected: usize,
}

#[pymethods]
impl Correction {
    fn __repr__(&self) -> String {
        format!("<pinc.Correction: {}, NIS {:.3}>", self.status, self.nis)
    }
}

impl Estimator {
    fn make(origin: Origin) -> PyResult<Self> {
        let estimator = Self { estimator: Mutex::new(origin.make(pinc_runs::estimator)?), origin };
        estimator.reset(None)?;
        Ok(estimator)
    }

    fn lock(&self) -> MutexGuard<'_, ConfigEstimator> {
        lock(&self.estimator)
    }
}

/// An estimator of what another one was made from, in its state.
#[pyfunction]
pub(crate) fn restore_estimator(origin: OriginParts, state: Given<'_>) -> PyResult<Estimator> {
    let estimator = Estimator::make(Origin::from_parts(origin)?)?;
    estimator.set_state(state)?;
    Ok(estimator)
}

/// Reads a vector with a number per each of `names`.
fn numbers(given: &Given<'_>, name: &str, names: &[String]) -> PyResult<Vec<f64>> {
    let found = vector(given, name)?;
    match found.len() == names.len() {
        true => Ok(found),
        false => Err(input(format!(
            "{name}: {} numbers given, expected {} ({})",
            found.len(),
            names.len(),
            names.join(", ")
        ))),
    }
}

/// Like [`numbers`], none of which is missing.
fn finite(given: &Given<'_>, name: &str, names: &[String]) -> PyResult<Vec<f64>> {
    let found = numbers(given, name, names)?;
    match found.iter().all(|number| number.is_finite()) {
        true => Ok(found),
        false => Err(input(format!("{name}: expected finite numbers"))),
    }
}

#[pymethods]
impl Estimator {
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
        let make = py.import("pinc_nmpc._native")?.getattr("restore_estimator")?;
        Ok((make, (of.origin.parts(), of.state(py)?).into_pyobject(py)?))
    }

    #[doc = doc!("Estimator.reset")]
    #[pyo3(signature = (u=None))]
    fn reset(&self, u: Option<Given<'_>>) -> PyResult<()> {
        let mut of = self.lock();
        let inputs = of.variables.input_names();
        let given = u.map(|u| finite(&u, "u", &inputs)).transpose()?;
        let u = given.or_else(|| of.initial_input.clone());
        of.filter.reset_input(&u.unwrap_or_else(|| vec![0.0; inputs.len()]));
        Ok(())
    }

    #[doc = doc!("Estimator.correct")]
    #[pyo3(signature = (y, parameters=None))]
    fn correct(
        &self,
        py: Python<'_>,
        y: Given<'_>,
        parameters: Option<Given<'_>>,
    ) -> PyResult<Correction> {
        let (measured, known) = (self.measured(), self.parameters());
        let y = numbers(&y, "y", &measured)?;
        let told = parameters.map(|p| finite(&p, "parameters", &known)).transpose()?;
        let of = py.detach(|| {
            let mut of = self.lock();
            if let Some(p) = &told {
                of.filter.set_parameters(p);
            }
            of.filter.correct(&y)
        });
        Ok(Correction {
            status: of.status.to_string(),
            nis: of.nis,
            measured: of.measured,
            rejected: of.rejected,
        })
    }

    #[doc = doc!("Estimator.predict")]
    fn predict(&self, py: Python<'_>, u: Given<'_>) -> PyResult<String> {
        let inputs = self.lock().variables.input_names();
        let u = numbers(&u, "u", &inputs)?;
        Ok(py.detach(|| self.lock().filter.predict(&u)).to_string())
    }

    #[doc = doc!("Estimator.estimate")]
    #[getter]
    fn estimate<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let estimate = self.lock().filter.estimate().to_vec();
        let n = estimate.len();
        array(py, estimate, None, &[n])
    }

    #[doc = doc!("Estimator.covariance")]
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let of = self.lock();
        let n = of.filter.dims().nx;
        array(py, of.filter.covariance().to_vec(), None, &[n, n])
    }

    #[doc = doc!("Estimator.sd")]
    #[getter]
    fn sd<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let of = self.lock();
        let n = of.filter.dims().nx;
        let sd = of.filter.covariance().iter().step_by(n + 1).map(|v| v.sqrt()).collect();
        array(py, sd, None, &[n])
    }

    #[doc = doc!("Estimator.innovation")]
    #[getter]
    fn innovation<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let innovation = self.lock().filter.innovation().to_vec();
        let n = innovation.len();
        array(py, innovation, None, &[n])
    }

    #[doc = doc!("Estimator.names")]
    #[getter]
    fn names(&self) -> Vec<String> {
        self.lock().names.clone()
    }

    #[doc = doc!("Estimator.measured")]
    #[getter]
    fn measured(&self) -> Vec<String> {
        self.lock().measured.clone()
    }

    #[doc = doc!("Estimator.parameters")]
    #[getter]
    fn parameters(&self) -> Vec<String> {
        self.lock().known.clone()
    }

    #[doc = doc!("Estimator.inputs")]
    #[getter]
    fn inputs(&self) -> Vec<String> {
        self.lock().variables.input_names()
    }

    #[doc = doc!("Estimator.sample_time_s")]
    #[getter]
    fn sample_time_s(&self) -> f64 {
        self.lock().sample_time_s
    }

    #[doc = doc!("Estimator.state")]
    fn state<'py>(&self, py: Python<'py>) -> PyResult<Array<'py>> {
        let mut numbers = Vec::new();
        self.lock().filter.remember(&mut Memory::save(&mut numbers));
        let n = numbers.len();
        array(py, numbers, None, &[n])
    }

    #[doc = doc!("Estimator.set_state")]
    fn set_state(&self, state: Given<'_>) -> PyResult<()> {
        let state = vector(&state, "state")?;
        let mut of = self.lock();
        let mut before = Vec::new();
        of.filter.remember(&mut Memory::save(&mut before));
        let mut memory = Memory::restore(&state);
        of.filter.remember(&mut memory);
        if memory.is_complete() {
            return Ok(());
        }
        of.filter.remember(&mut Memory::restore(&before));
        Err(input("state: of another estimator, or damaged"))
    }
}
