//! The plant of a config: its equation, its simulator, and integrators as models of it.

use crate::arrays::{Array, Given, Points, array, whole};
use crate::config::Source;
use crate::discrete::Discrete;
use crate::errors::input;
use crate::work::{interrupted, lock, watched};
use pinc_config::{Experiment, PlantSpec, Variables};
use pinc_ode::{DynPlant, Integrator, OdeError, Simulator};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

/// The local error tolerance of a simulation.
const TOLERANCE: f64 = 1e-10;

#[doc = doc!("Plant")]
#[expect(clippy::doc_markdown, reason = "a docstring of Python, which ends a line with two colons")]
#[pyclass(module = "pinc_nmpc", frozen)]
#[derive(Debug)]
pub(crate) struct Plant {
    source: Source,
    in_loop: bool,
    experiment: Experiment,
    plant: Arc<dyn DynPlant>,
    variables: Variables,
    parameters: BTreeMap<String, f64>,
    simulator: Mutex<Simulator>,
}

#[doc = doc!("IntegratorModel")]
#[pyclass(module = "pinc_nmpc", frozen)]
#[derive(Debug)]
pub(crate) struct IntegratorModel {
    discrete: Discrete,
    made: Made,
}

/// What an integrator was made from, to be made again from it.
#[derive(Clone, Debug)]
struct Made {
    source: Source,
    in_loop: bool,
    integrator: Integrator,
    step_s: f64,
    substeps: usize,
}

impl Plant {
    fn read(source: Source, in_loop: bool) -> PyResult<Self> {
        let experiment = source.experiment()?;
        let spec: &PlantSpec = match in_loop {
            true => experiment.plant_in_the_loop(),
            false => &experiment.plant,
        };
        let plant: Arc<dyn DynPlant> = spec.dyn_plant().into();
        let tolerance = experiment.control.as_ref().map_or(TOLERANCE, |of| of.plant_tolerance);
        Ok(Self {
            variables: Variables::of(&*plant),
            parameters: spec.parameters(),
            simulator: Mutex::new(Simulator::new(&*plant, tolerance)),
            source,
            in_loop,
            plant,
            experiment,
        })
    }

    /// Points for x and u, with one of each for all where it is given once.
    fn points(&self, x: &Given<'_>, u: &Given<'_>) -> PyResult<(Points, Points, usize)> {
        let x = Points::read(x, "x", &self.variables.state_names())?;
        let u = Points::read(u, "u", &self.variables.input_names())?;
        let count = x.rows.or(u.rows).unwrap_or(1);
        match [("x", &x), ("u", &u)].iter().find(|(_, of)| of.rows.is_some_and(|n| n != count)) {
            None => Ok((x, u, count)),
            Some((name, of)) => {
                Err(input(format!("{name}: {} rows given, expected {count}", of.count())))
            }
        }
    }

    /// What `of` makes of each point, so many numbers each.
    fn each<'py>(
        &self,
        py: Python<'py>,
        (x, u): (&Given<'py>, &Given<'py>),
        shape: &[usize],
        of: impl Fn(&[f64], &[f64], &mut [f64]),
    ) -> PyResult<Array<'py>> {
        let (x, u, count) = self.points(x, u)?;
        let rows = x.rows.or(u.rows);
        let (x, u, dims) = (x.repeated(count), u.repeated(count), self.plant.dims());
        let width: usize = shape.iter().product();
        let mut all = vec![0.0; count * width];
        for (k, to) in all.chunks_exact_mut(width).enumerate() {
            of(&x[k * dims.nx..(k + 1) * dims.nx], &u[k * dims.nu..(k + 1) * dims.nu], to);
        }
        array(py, all, rows, shape)
    }

    /// An error if there is no equation to be asked.
    fn equation(&self) -> PyResult<()> {
        match self.plant.black_box() {
            None => Ok(()),
            Some(_) => Err(input("the plant is a black box, which has no equation")),
        }
    }
}

impl IntegratorModel {
    fn make(plant: &Plant, made: Made) -> PyResult<Self> {
        let Made { integrator, step_s, substeps, .. } = made;
        let of = Arc::clone(&plant.plant);
        // That it can be made at all is seen here.
        of.model(integrator, step_s, substeps).map_err(no_model)?;
        let make = move || {
            of.model(integrator, step_s, substeps).expect("it was made from the same before")
        };
        let names = [plant.variables.state_names(), plant.variables.input_names(), Vec::new()];
        Ok(Self { discrete: Discrete::new(names, make), made })
    }
}

fn no_model(error: OdeError) -> PyErr {
    input(error.to_string())
}

#[pymethods]
impl Plant {
    #[new]
    #[pyo3(signature = (config, overrides=None, in_loop=false))]
    fn new(
        config: &Bound<'_, PyAny>,
        overrides: Option<&Bound<'_, PyAny>>,
        in_loop: bool,
    ) -> PyResult<Self> {
        Self::read(Source::of(config, overrides)?.pinned()?, in_loop)
    }

    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let (of, py) = (slf.get(), slf.py());
        let make = py.import("pinc_nmpc._native")?.getattr("restore_plant")?;
        Ok((make, (of.source.parts(), of.in_loop).into_pyobject(py)?))
    }

    fn __repr__(&self) -> String {
        format!(
            "<pinc.Plant: states {}; inputs {}>",
            self.variables.state_names().join(", "),
            self.variables.input_names().join(", ")
        )
    }

    #[doc = doc!("Plant.states")]
    #[getter]
    fn states(&self) -> Vec<String> {
        self.variables.state_names()
    }

    #[doc = doc!("Plant.inputs")]
    #[getter]
    fn inputs(&self) -> Vec<String> {
        self.variables.input_names()
    }

    #[doc = doc!("Plant.outputs")]
    #[getter]
    fn outputs(&self) -> Vec<String> {
        self.variables.output_names()
    }

    #[doc = doc!("Plant.units")]
    #[getter]
    fn units(&self) -> BTreeMap<String, String> {
        let Variables { states, inputs, outputs } = &self.variables;
        let all = states.iter().chain(inputs).chain(outputs);
        all.map(|of| (of.name.to_string(), of.unit.to_string())).collect()
    }

    #[doc = doc!("Plant.parameters")]
    #[getter]
    fn parameters(&self) -> BTreeMap<String, f64> {
        self.parameters.clone()
    }

    #[doc = doc!("Plant.sample_time_s")]
    #[getter]
    fn sample_time_s(&self) -> Option<f64> {
        self.experiment.sample_time_s()
    }

    #[doc = doc!("Plant.derivative")]
    fn derivative<'py>(
        &self,
        py: Python<'py>,
        x: Given<'py>,
        u: Given<'py>,
    ) -> PyResult<Array<'py>> {
        self.equation()?;
        let n = self.plant.dims().nx;
        self.each(py, (&x, &u), &[n], |x, u, to| self.plant.rhs(x, u, &[], to))
    }

    #[doc = doc!("Plant.jacobian")]
    fn jacobian<'py>(&self, py: Python<'py>, x: Given<'py>, u: Given<'py>) -> PyResult<Array<'py>> {
        self.equation()?;
        let dims = self.plant.dims();
        self.each(py, (&x, &u), &[dims.nx, dims.nx + dims.nu], |x, u, to| {
            to.copy_from_slice(&self.plant.jacobian(x, u, &[]));
        })
    }

    #[doc = doc!("Plant.output")]
    fn output<'py>(&self, py: Python<'py>, x: Given<'py>, u: Given<'py>) -> PyResult<Array<'py>> {
        let simulator = lock(&self.simulator);
        self.each(py, (&x, &u), &[self.variables.outputs.len()], |x, u, to| {
            simulator.output(x, u, to);
        })
    }

    #[doc = doc!("Plant.simulate")]
    #[pyo3(signature = (x, u, step_s=None))]
    fn simulate<'py>(
        &self,
        py: Python<'py>,
        x: Given<'py>,
        u: Given<'py>,
        step_s: Option<f64>,
    ) -> PyResult<Array<'py>> {
        let step_s = step(step_s.or(self.experiment.sample_time_s()))?;
        let (x, u, count) = self.points(&x, &u)?;
        if x.rows.is_some() {
            return Err(input("x: rows given, expected one state, where the simulation begins"));
        }
        let (u, dims) = (u.values, self.plant.dims());
        let mut states = x.values;
        states.reserve(count * dims.nx);
        let mut now = states.clone();
        watched(py, || {
            // A fresh copy has adapted no step size yet: the same bits whatever was simulated before.
            let mut simulator = lock(&self.simulator).clone();
            for k in (0..count).take_while(|_| !interrupted()) {
                simulator.integrate(&mut now, &u[k * dims.nu..(k + 1) * dims.nu], step_s)?;
                states.extend(&now);
            }
            Ok(())
        })?
        .map_err(|error: OdeError| crate::errors::of_run(&error.into()))?;
        array(py, states, Some(count + 1), &[dims.nx])
    }

    #[doc = doc!("Plant.model")]
    #[pyo3(signature = (method="rk4", step_s=None, substeps=None))]
    fn model(
        &self,
        method: &str,
        step_s: Option<f64>,
        substeps: Option<i64>,
    ) -> PyResult<IntegratorModel> {
        self.equation()?;
        let named = Integrator::ALL.into_iter().find(|integrator| integrator.name() == method);
        let integrator = named.ok_or_else(|| {
            let names = Integrator::ALL.map(Integrator::name).join(", ");
            input(format!("method: {method:?} given, expected one of {names}"))
        })?;
        let step_s = step(step_s.or(self.experiment.sample_time_s()))?;
        let own = self.experiment.control.as_ref().map(|control| control.own_substeps(integrator));
        let given = substeps.map(|given| whole("substeps", given, 1, 10_000)).transpose()?;
        let substeps = given.or(own).unwrap_or(4);
        let (source, in_loop) = (self.source.clone(), self.in_loop);
        IntegratorModel::make(self, Made { source, in_loop, integrator, step_s, substeps })
    }
}

/// The length of a step that is asked for.
fn step(given: Option<f64>) -> PyResult<f64> {
    match given {
        Some(step_s) if step_s > 0.0 && step_s.is_finite() => Ok(step_s),
        Some(step_s) => {
            Err(input(format!("step_s: {step_s} given, expected a positive time in s")))
        }
        None => Err(input("step_s: missing, and the config has no control step to take it from")),
    }
}

/// A plant of what another one was read from.
#[pyfunction]
pub(crate) fn restore_plant(source: crate::config::Parts, in_loop: bool) -> PyResult<Plant> {
    Plant::read(Source::from_parts(source), in_loop)
}

/// An integrator of what another one was made from.
#[pyfunction]
pub(crate) fn restore_integrator(
    source: crate::config::Parts,
    in_loop: bool,
    method: &str,
    step_s: f64,
    substeps: i64,
) -> PyResult<IntegratorModel> {
    let plant = Plant::read(Source::from_parts(source), in_loop)?;
    plant.model(method, Some(step_s), Some(substeps))
}

#[pymethods]
impl IntegratorModel {
    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let (Made { source, in_loop, integrator, step_s, substeps }, py) =
            (slf.get().made.clone(), slf.py());
        let make = py.import("pinc_nmpc._native")?.getattr("restore_integrator")?;
        let parts = (source.parts(), in_loop, integrator.name(), step_s, substeps);
        Ok((make, parts.into_pyobject(py)?))
    }

    fn __repr__(&self) -> String {
        let Made { integrator, step_s, substeps, .. } = &self.made;
        format!("<pinc.IntegratorModel: {} x{substeps}; T = {step_s} s>", integrator.name())
    }

    #[doc = doc!("IntegratorModel.states")]
    #[getter]
    fn states(&self) -> Vec<String> {
        self.discrete.states.clone()
    }

    #[doc = doc!("IntegratorModel.inputs")]
    #[getter]
    fn inputs(&self) -> Vec<String> {
        self.discrete.inputs.clone()
    }

    #[doc = doc!("IntegratorModel.sample_time_s")]
    #[getter]
    fn sample_time_s(&self) -> f64 {
        self.discrete.sample_time_s
    }

    #[doc = doc!("IntegratorModel.substeps")]
    #[getter]
    fn substeps(&self) -> usize {
        self.made.substeps
    }

    #[doc = doc!("IntegratorModel.step")]
    fn step<'py>(&self, py: Python<'py>, x: Given<'py>, u: Given<'py>) -> PyResult<Array<'py>> {
        self.discrete.step(py, &x, &u, None)
    }

    #[doc = doc!("IntegratorModel.linearize")]
    fn linearize<'py>(
        &self,
        py: Python<'py>,
        x: Given<'py>,
        u: Given<'py>,
    ) -> PyResult<(Array<'py>, Array<'py>, Array<'py>)> {
        self.discrete.linearize(py, &x, &u, None)
    }

    #[doc = doc!("IntegratorModel.predict")]
    fn predict<'py>(&self, py: Python<'py>, x: Given<'py>, u: Given<'py>) -> PyResult<Array<'py>> {
        self.discrete.predict(py, &x, &u, None)
    }
}
