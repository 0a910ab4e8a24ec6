//! Derivatives of plans, by the names of what they are in.

use crate::arrays::{Given, array, values};
use crate::errors::input;
use numpy::PyArrayDyn;
use pinc_sensitivity::{Given as Number, ProblemDerivative, Regularity};
use pyo3::prelude::*;
use pyo3::types::PyDict;

#[doc = doc!("PlanGradient")]
#[pyclass(module = "pinc_nmpc", frozen, get_all)]
#[derive(Debug)]
pub(crate) struct PlanGradient {
    #[doc = doc!("PlanGradient.regularity")]
    regularity: String,
    #[doc = doc!("PlanGradient.values")]
    values: Py<PyDict>,
}

#[doc = doc!("PlanChange")]
#[pyclass(module = "pinc_nmpc", frozen, get_all)]
#[derive(Debug)]
pub(crate) struct PlanChange {
    #[doc = doc!("PlanChange.regularity")]
    regularity: String,
    #[doc = doc!("PlanChange.states")]
    states: Py<PyArrayDyn<f64>>,
    #[doc = doc!("PlanChange.inputs")]
    inputs: Py<PyArrayDyn<f64>>,
}

impl PlanGradient {
    pub(crate) fn new(
        py: Python<'_>,
        regularity: Regularity,
        gradient: &ProblemDerivative,
    ) -> PyResult<Self> {
        let values = by_name(py, std::slice::from_ref(gradient), None)?;
        Ok(Self { regularity: regularity.to_string(), values })
    }
}

impl PlanChange {
    pub(crate) fn new(
        py: Python<'_>,
        regularity: Regularity,
        [states, inputs]: [(&[f64], usize); 2],
    ) -> PyResult<Self> {
        let rows = |(values, width): (&[f64], usize)| -> PyResult<Py<PyArrayDyn<f64>>> {
            Ok(array(py, values.to_vec(), Some(values.len() / width), &[width])?.unbind())
        };
        Ok(Self {
            regularity: regularity.to_string(),
            states: rows(states)?,
            inputs: rows(inputs)?,
        })
    }
}

/// The numbers of some gradients by kind; a kind that the problem does not have is left out.
pub(crate) fn by_name(
    py: Python<'_>,
    gradients: &[ProblemDerivative],
    rows: Option<usize>,
) -> PyResult<Py<PyDict>> {
    let all = PyDict::new(py);
    for kind in Number::ALL {
        let numbers: Vec<f64> = gradients.iter().flat_map(|g| g.get(kind)).copied().collect();
        let width = numbers.len() / gradients.len().max(1);
        if width > 0 {
            all.set_item(kind.name(), array(py, numbers, rows, &[width])?)?;
        }
    }
    Ok(all.unbind())
}

/// Reads a change of some kinds of numbers.
pub(crate) fn read_change(change: &Bound<'_, PyDict>, to: &mut ProblemDerivative) -> PyResult<()> {
    for (name, numbers) in change {
        let name: String = name.extract()?;
        let Some(kind) = Number::ALL.into_iter().find(|kind| kind.name() == name) else {
            let known = Number::ALL.map(Number::name).join(", ");
            return Err(input(format!("change: {name:?} given, expected some of {known}")));
        };
        let numbers = values(&numbers.extract::<Given<'_>>()?);
        let (expected, found) = (to.get(kind).len(), numbers.len());
        if found != expected {
            return Err(input(format!(
                "change[{name:?}]: {found} numbers given, expected {expected}"
            )));
        }
        to.get_mut(kind).copy_from_slice(&numbers);
    }
    Ok(())
}
