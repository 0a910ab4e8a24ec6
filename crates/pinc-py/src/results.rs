//! Results in pickles and copies: by their fields.

use crate::batch::{GradientBatch, LoopBatch, StepBatch};
use crate::controller::ControlStep;
use crate::errors::input;
use crate::estimator::Correction;
use crate::gradient::{PlanChange, PlanGradient};
use crate::training::{Trained, TrainingProgress};
use pyo3::prelude::*;

/// A result of the class of this name with these fields as attributes. `python/pinc_nmpc/_pickles.py` calls it.
#[pyfunction]
pub(crate) fn restore_result(class_name: &str, fields: &Bound<'_, PyAny>) -> PyResult<Py<PyAny>> {
    let py = fields.py();
    Ok(match class_name {
        "ControlStep" => Py::new(py, fields.extract::<ControlStep>()?)?.into_any(),
        "Correction" => Py::new(py, fields.extract::<Correction>()?)?.into_any(),
        "GradientBatch" => Py::new(py, fields.extract::<GradientBatch>()?)?.into_any(),
        "LoopBatch" => Py::new(py, fields.extract::<LoopBatch>()?)?.into_any(),
        "PlanChange" => Py::new(py, fields.extract::<PlanChange>()?)?.into_any(),
        "PlanGradient" => Py::new(py, fields.extract::<PlanGradient>()?)?.into_any(),
        "StepBatch" => Py::new(py, fields.extract::<StepBatch>()?)?.into_any(),
        "Trained" => Py::new(py, fields.extract::<Trained>()?)?.into_any(),
        "TrainingProgress" => Py::new(py, fields.extract::<TrainingProgress>()?)?.into_any(),
        _ => {
            return Err(input(format!(
                "class_name: {class_name:?} given, expected that of a result"
            )));
        }
    })
}
