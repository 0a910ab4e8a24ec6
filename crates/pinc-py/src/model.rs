//! A trained net as a model.

use crate::arrays::{Array, Given, array};
use crate::config::Source;
use crate::discrete::Discrete;
use crate::errors::{input, of_run};
use crate::work::lock;
use pinc_net::{FoldedNet, PincModel, PincNet, TrainingTarget};
use pinc_record::{read_file, write_output};
use pinc_runs::{ErrorEstimate, RunError, certificate, error_estimate};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict, PyTuple};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

#[doc = doc!("Model")]
#[pyclass(module = "pinc_nmpc", frozen)]
#[derive(Debug)]
pub(crate) struct Model {
    net: PincNet,
    discrete: Discrete,
    /// The estimate of the error, against the plant of the config that was given last.
    estimate: Mutex<Option<(Source, ErrorEstimate)>>,
}

impl Model {
    pub(crate) fn of(net: PincNet) -> PyResult<Self> {
        let model = PincModel::new(&net).map_err(|error| input(error.to_string()))?;
        let parameters = net.parameter_names().map(str::to_owned).collect();
        let names = [net.state_names().to_vec(), net.input_names().to_vec(), parameters];
        Ok(Self {
            discrete: Discrete::new(names, move || Box::new(model.clone())),
            estimate: Mutex::new(None),
            net,
        })
    }

    fn parse(path: &Path, bytes: &[u8]) -> PyResult<Self> {
        let net = PincNet::from_bytes(bytes)
            .map_err(|source| of_run(&RunError::Model { path: path.to_owned(), source }))?;
        Self::of(net)
    }

    /// The content of its file, with its certificate if it has one.
    pub(crate) fn bytes(&self) -> Vec<u8> {
        self.net.to_bytes()
    }
}

#[pymethods]
impl Model {
    #[doc = doc!("Model.load")]
    #[staticmethod]
    pub(crate) fn load(path: PathBuf) -> PyResult<Self> {
        let bytes = read_file(&path).map_err(|error| of_run(&error.into()))?;
        Self::parse(&path, &bytes)
    }

    #[doc = doc!("Model.from_bytes")]
    #[staticmethod]
    fn from_bytes(data: &[u8]) -> PyResult<Self> {
        Self::parse(Path::new("model"), data)
    }

    #[doc = doc!("Model.save")]
    fn save(&self, path: PathBuf) -> PyResult<()> {
        write_output(&path, &self.bytes()).map_err(|error| of_run(&error.into()))
    }

    #[doc = doc!("Model.to_bytes")]
    fn to_bytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.bytes())
    }

    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let make = slf.get_type().getattr("from_bytes")?;
        Ok((make, PyTuple::new(slf.py(), [slf.get().to_bytes(slf.py())])?))
    }

    fn __repr__(&self) -> String {
        format!(
            "<pinc.Model: states {}; inputs {}; T = {} s>",
            self.net.state_names().join(", "),
            self.net.input_names().join(", "),
            self.net.sample_time_s()
        )
    }

    #[doc = doc!("Model.states")]
    #[getter]
    fn states(&self) -> Vec<String> {
        self.net.state_names().to_vec()
    }

    #[doc = doc!("Model.inputs")]
    #[getter]
    fn inputs(&self) -> Vec<String> {
        self.net.input_names().to_vec()
    }

    #[doc = doc!("Model.parameters")]
    #[getter]
    fn parameters(&self) -> Vec<String> {
        self.discrete.parameters.clone()
    }

    #[doc = doc!("Model.sample_time_s")]
    #[getter]
    fn sample_time_s(&self) -> f64 {
        self.net.sample_time_s()
    }

    #[doc = doc!("Model.domain")]
    #[getter]
    fn domain<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let names = self.net.state_names().iter().chain(self.net.input_names());
        let domain = PyDict::new(py);
        for (name, ends) in names.chain(&self.discrete.parameters).zip(self.net.domain().ends()) {
            domain.set_item(name, ends)?;
        }
        Ok(domain)
    }

    #[doc = doc!("Model.proven_error")]
    #[getter]
    fn proven_error(&self) -> Option<BTreeMap<String, f64>> {
        certificate(&self.net).map(|of| of.proven)
    }

    #[doc = doc!("Model.error_estimate")]
    #[pyo3(signature = (config, x, u, p=None))]
    fn error_estimate<'py>(
        &self,
        py: Python<'py>,
        config: &Bound<'py, PyAny>,
        x: Given<'py>,
        u: Given<'py>,
        p: Option<Given<'py>>,
    ) -> PyResult<Array<'py>> {
        let source = Source::of(config, None)?;
        let mut known = lock(&self.estimate);
        let estimate = match known.take().filter(|(of, _)| *of == source) {
            Some((_, estimate)) => estimate,
            None => {
                let found = error_estimate(&source.experiment()?, &self.net);
                found.map_err(|error| of_run(&error))?
            }
        };
        let (_, estimate) = known.insert((source, estimate));
        let at = self.discrete.arguments(&x, &u, p.as_ref())?;
        let nx = self.discrete.dims.nx;
        let mut errors = vec![0.0; at.count * nx];
        for (k, error) in errors.chunks_exact_mut(nx).enumerate() {
            let [x, u, p] = at.point(self.discrete.dims, k);
            estimate.write(x, u, p, error);
        }
        array(py, errors, at.rows, &[nx])
    }

    #[doc = doc!("Model.layers")]
    #[getter]
    fn layers<'py>(&self, py: Python<'py>) -> PyResult<Vec<(Array<'py>, Array<'py>)>> {
        let folded = FoldedNet::new(&self.net).map_err(|error| input(error.to_string()))?;
        let layers = folded.layers.into_iter().map(|layer| {
            let shape = [layer.bias.len(), layer.weights.first().map_or(0, Vec::len)];
            let weights = array(py, layer.weights.concat(), None, &shape)?;
            Ok((weights, array(py, layer.bias, None, &shape[..1])?))
        });
        layers.collect()
    }

    #[doc = doc!("Model.adds_initial_state")]
    #[getter]
    fn adds_initial_state(&self) -> PyResult<bool> {
        let folded = FoldedNet::new(&self.net).map_err(|error| input(error.to_string()))?;
        Ok(folded.adds_initial_state)
    }

    #[doc = doc!("Model.step")]
    #[pyo3(signature = (x, u, p=None))]
    fn step<'py>(
        &self,
        py: Python<'py>,
        x: Given<'py>,
        u: Given<'py>,
        p: Option<Given<'py>>,
    ) -> PyResult<Array<'py>> {
        self.discrete.step(py, &x, &u, p.as_ref())
    }

    #[doc = doc!("Model.linearize")]
    #[pyo3(signature = (x, u, p=None))]
    fn linearize<'py>(
        &self,
        py: Python<'py>,
        x: Given<'py>,
        u: Given<'py>,
        p: Option<Given<'py>>,
    ) -> PyResult<(Array<'py>, Array<'py>, Array<'py>)> {
        self.discrete.linearize(py, &x, &u, p.as_ref())
    }

    #[doc = doc!("Model.evaluate")]
    #[pyo3(signature = (t, x, u, p=None))]
    fn evaluate<'py>(
        &self,
        py: Python<'py>,
        t: f64,
        x: Given<'py>,
        u: Given<'py>,
        p: Option<Given<'py>>,
    ) -> PyResult<Array<'py>> {
        let end = self.net.sample_time_s();
        if !(0.0..=end).contains(&t) {
            return Err(input(format!("t: {t} s given, expected from 0 to T = {end} s")));
        }
        if self.net.source() == TrainingTarget::Integrator && t < end {
            return Err(input(format!(
                "t: {t} s given, expected T = {end} s: a net distilled from an integrator knows \
                 the end of a step only"
            )));
        }
        let at = self.discrete.arguments(&x, &u, p.as_ref())?;
        let nx = self.discrete.dims.nx;
        let mut states = Vec::with_capacity(at.count * nx);
        for k in 0..at.count {
            let [x, u, p] = at.point(self.discrete.dims, k);
            states.extend(self.net.evaluate(t, x, u, p));
        }
        array(py, states, at.rows, &[nx])
    }

    #[doc = doc!("Model.predict")]
    #[pyo3(signature = (x, u, p=None))]
    fn predict<'py>(
        &self,
        py: Python<'py>,
        x: Given<'py>,
        u: Given<'py>,
        p: Option<Given<'py>>,
    ) -> PyResult<Array<'py>> {
        self.discrete.predict(py, &x, &u, p.as_ref())
    }

    #[doc = doc!("Model.casadi")]
    #[pyo3(signature = (name="pinc"))]
    fn casadi<'py>(slf: &Bound<'py, Self>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("pinc_nmpc._casadi")?.call_method1("function", (slf, name))
    }

    #[doc = doc!("Model.do_mpc")]
    fn do_mpc<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        slf.py().import("pinc_nmpc._casadi")?.call_method1("do_mpc", (slf,))
    }
}
