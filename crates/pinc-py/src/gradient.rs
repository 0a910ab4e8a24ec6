//! Derivatives of plans, by the names of what they are in.

use crate::arrays::{Given, array, values};
use crate::errors::input;
use numpy::PyArrayDyn;
use pinc_sensitivity::{Given as Number, ProblemDerivative, Regularity};
use pyo3::prelude::*;
use pyo3::types::PyDict;

#[doc = doc!("PlanGradient")]
#[pyclass(module = "pinc_nmpc", frozen, get_all)]
#[derive(Debug, FromPyObject)]
pub(crate) struct PlanGradient {
    #[doc = doc!("PlanGradient.regularity")]
    regularity: String,
    #[doc = doc!("PlanGradient.values")]
    values: Py<PyDict>,
}

#[doc = doc!("PlanChange")]
#[pyclass(module = "pinc_nmpc", frozen, get_all)]
#[derive(Debug, FromPyObject)]
pub(crate) struct PlanChange {
    #[doc = doc!("PlanChange.regularity")]
    regularity: String,
    #[doc = doc!("PlanChange.states")]
    states: Py<PyArrayDyn<f64>>,
    #[doc = doc!("PlanChange.inputs")]
    inputs: Py<PyArrayDyn<f64>>,
}

/// How Python sees what gradients are in.
#[derive(Debug)]
pub(crate) struct Layout {
    /// How many quantities follow references.
    pub(crate) outputs: usize,
    /// The parameters that a step takes, by their names and by their places in p.
    pub(crate) parameters: Vec<(String, usize)>,
}

impl Layout {
    /// Of a controller with these parameters p, of which some are measured: a step takes these, or
    /// else all.
    pub(crate) fn new(outputs: usize, names: &[String], measured: &[String]) -> Self {
        let taken = if measured.is_empty() { names } else { measured };
        let place = |name: &String| names.iter().position(|known| known == name);
        let parameters = taken.iter().filter_map(|name| Some((name.clone(), place(name)?)));
        Self { outputs, parameters: parameters.collect() }
    }

    /// The names of the parameters.
    pub(crate) fn names(&self) -> Vec<String> {
        self.parameters.iter().map(|(name, _)| name.clone()).collect()
    }

    /// The parameters p that rows of those which a step takes make of `own`.
    pub(crate) fn insert(&self, rows: &[f64], own: &[f64]) -> Vec<f64> {
        let insert = |row: &[f64]| {
            let mut p = own.to_vec();
            self.parameters.iter().zip(row).for_each(|((_, place), value)| p[*place] = *value);
            p
        };
        rows.chunks_exact(self.parameters.len().max(1)).flat_map(insert).collect()
    }

    /// The places of the numbers of a kind that Python sees, of `count`.
    fn places(&self, kind: Number, count: usize) -> Vec<usize> {
        if kind == Number::Parameters {
            return self.parameters.iter().map(|(_, place)| *place).collect();
        }
        (0..count).collect()
    }
}

impl PlanGradient {
    pub(crate) fn new(
        py: Python<'_>,
        regularity: Regularity,
        (gradient, layout): (&ProblemDerivative, &Layout),
    ) -> PyResult<Self> {
        let values = by_name(py, (std::slice::from_ref(gradient), gradient), layout, None)?;
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

/// The numbers of some gradients, of none maybe, like `one` by kind; a kind that the problem does not have is
/// left out.
pub(crate) fn by_name(
    py: Python<'_>,
    (gradients, one): (&[ProblemDerivative], &ProblemDerivative),
    layout: &Layout,
    rows: Option<usize>,
) -> PyResult<Py<PyDict>> {
    let all = PyDict::new(py);
    for kind in Number::ALL {
        let places = layout.places(kind, one.get(kind).len());
        let of = |g: &ProblemDerivative| places.iter().map(|&i| g.get(kind)[i]).collect::<Vec<_>>();
        let numbers: Vec<f64> = gradients.iter().flat_map(of).collect();
        let mut shape = vec![places.len()];
        if kind == Number::Reference {
            shape = vec![places.len() / layout.outputs.max(1), layout.outputs];
        }
        if !places.is_empty() {
            all.set_item(kind.name(), array(py, numbers, rows, &shape)?)?;
        }
    }
    Ok(all.unbind())
}

/// Reads a change of some kinds of numbers.
pub(crate) fn read_change(
    change: &Bound<'_, PyDict>,
    layout: &Layout,
    to: &mut ProblemDerivative,
) -> PyResult<()> {
    for (name, numbers) in change {
        let name: String = name.extract()?;
        let Some(kind) = Number::ALL.into_iter().find(|kind| kind.name() == name) else {
            let known = Number::ALL.map(Number::name).join(", ");
            return Err(input(format!("change: {name:?} given, expected some of {known}")));
        };
        let numbers = values(&numbers.extract::<Given<'_>>()?);
        let places = layout.places(kind, to.get(kind).len());
        let (expected, found) = (places.len(), numbers.len());
        if found != expected {
            return Err(input(format!(
                "change[{name:?}]: {found} numbers given, expected {expected}"
            )));
        }
        let to = to.get_mut(kind);
        places.into_iter().zip(numbers).for_each(|(place, number)| to[place] = number);
    }
    Ok(())
}
