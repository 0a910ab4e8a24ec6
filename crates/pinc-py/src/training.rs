//! Training a net.

use crate::config::experiment;
use crate::errors::of_run;
use crate::model::Model;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::ops::ControlFlow;

#[doc = doc!("TrainingProgress")]
#[pyclass(module = "pinc_nmpc", frozen, get_all)]
#[derive(Debug, FromPyObject)]
pub(crate) struct TrainingProgress {
    #[doc = doc!("TrainingProgress.iteration")]
    iteration: u64,
    #[doc = doc!("TrainingProgress.iterations")]
    iterations: u64,
    #[doc = doc!("TrainingProgress.elapsed_s")]
    elapsed_s: f64,
    #[doc = doc!("TrainingProgress.loss")]
    loss: f64,
    #[doc = doc!("TrainingProgress.validation_mse")]
    validation_mse: Option<f64>,
}

#[pymethods]
impl TrainingProgress {
    fn __repr__(&self) -> String {
        let mse = self.validation_mse.map_or_else(String::new, |mse| format!(", MSE {mse:.2e}"));
        let Self { iteration, iterations, loss, .. } = self;
        format!("<pinc.TrainingProgress: {iteration}/{iterations}, loss {loss:.2e}{mse}>")
    }
}

#[doc = doc!("Trained")]
#[pyclass(module = "pinc_nmpc", frozen, get_all)]
#[derive(Debug, FromPyObject)]
pub(crate) struct Trained {
    #[doc = doc!("Trained.model")]
    model: Py<Model>,
    #[doc = doc!("Trained.validation")]
    validation: Py<PyDict>,
    #[doc = doc!("Trained.stop_reason")]
    stop_reason: String,
    #[doc = doc!("Trained.iterations")]
    iterations: u64,
    #[doc = doc!("Trained.loss_evaluations")]
    loss_evaluations: u64,
    #[doc = doc!("Trained.wall_s")]
    wall_s: f64,
}

#[pymethods]
impl Trained {
    fn __repr__(&self) -> String {
        let Self { stop_reason, iterations, wall_s, .. } = self;
        format!("<pinc.Trained: {stop_reason} after {iterations} iterations, {wall_s:.1} s>")
    }
}

#[doc = doc!("train")]
#[pyfunction]
#[pyo3(signature = (config, overrides=None, progress=None))]
pub(crate) fn train(
    py: Python<'_>,
    config: &Bound<'_, PyAny>,
    overrides: Option<&Bound<'_, PyAny>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Trained> {
    let experiment = experiment(config, overrides)?;
    let mut raised = None;
    let trained = py.detach(|| {
        pinc_runs::train_watched(&experiment, |now| {
            let shown = Python::attach(|py| show(py, progress.as_ref(), now));
            shown.unwrap_or_else(|error| {
                raised = Some(error);
                ControlFlow::Break(())
            })
        })
    });
    if let Some(error) = raised {
        return Err(error);
    }
    let trained = trained.map_err(|error| of_run(&error))?;
    let validation = PyDict::new(py);
    let errors = &trained.validation;
    validation.set_item("mse_gen", errors.mse_gen)?;
    validation.set_item("mse_gen_normalized", errors.mse_gen_normalized)?;
    validation.set_item("mse_all_normalized", errors.mse_all_normalized)?;
    validation.set_item("one_step_mse", errors.one_step_mse)?;
    validation.set_item("measured_mse", errors.measured_mse)?;
    Ok(Trained {
        model: Py::new(py, Model::of(trained.net)?)?,
        validation: validation.unbind(),
        stop_reason: trained.stop_reason,
        iterations: trained.totals.iterations,
        loss_evaluations: trained.totals.loss_evaluations,
        wall_s: trained.wall_s,
    })
}

/// Lets signals be handled, and calls the caller's function. It stops the training with `pinc.STOP`;
/// all else that it returns means nothing, since functions return `False` without meaning it.
fn show(
    py: Python<'_>,
    progress: Option<&Py<PyAny>>,
    now: &pinc_runs::TrainingProgress,
) -> PyResult<ControlFlow<()>> {
    py.check_signals()?;
    let Some(progress) = progress else { return Ok(ControlFlow::Continue(())) };
    let shown = TrainingProgress {
        iteration: now.iteration,
        iterations: now.iterations,
        elapsed_s: now.elapsed_s,
        loss: now.loss,
        validation_mse: now.validation_mse,
    };
    let answer = progress.bind(py).call1((shown,))?;
    let stops = answer.is(&py.import("pinc_nmpc._stop")?.getattr("STOP")?);
    Ok(if stops { ControlFlow::Break(()) } else { ControlFlow::Continue(()) })
}
