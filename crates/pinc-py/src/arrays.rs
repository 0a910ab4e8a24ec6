//! Arrays in and out.

use crate::errors::input;
use numpy::{
    AllowTypeChange, PyArray1, PyArrayDyn, PyArrayLikeDyn, PyArrayMethods, PyReadonlyArrayDyn,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use std::ops::Deref;

/// Numbers as a caller gives them: an array, or what `numpy` makes one of. Masked ones are NaN.
#[derive(Debug)]
pub(crate) struct Given<'py>(PyArrayLikeDyn<'py, f64, AllowTypeChange>);

impl<'py> Deref for Given<'py> {
    type Target = PyReadonlyArrayDyn<'py, f64>;

    fn deref(&self) -> &Self::Target {
        &self.0
    }
}

impl<'py> FromPyObject<'_, 'py> for Given<'py> {
    type Error = PyErr;

    /// `pyo3` adds a note with the argument's name to the error.
    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let py = given.py();
        let numpy = py.import("numpy")?;
        if numpy
            .call_method1("iscomplexobj", (&given,))
            .is_ok_and(|is| is.is_truthy().unwrap_or(false))
        {
            return Err(input("complex numbers given, expected real ones"));
        }
        let masked = numpy.getattr("ma")?.call_method1("isMaskedArray", (&given,))?.is_truthy()?;
        let array = match masked {
            true => given.call_method1("astype", ("f8",))?.call_method1("filled", (f64::NAN,))?,
            false => given.to_owned(),
        };
        let numbers = array.extract().map_err(|error: PyErr| input(error.value(py).to_string()));
        Ok(Self(numbers?))
    }
}

/// A whole number as a caller gives it for the argument `name`, from `least` to `most`.
pub(crate) fn whole(name: &str, given: i64, least: usize, most: usize) -> PyResult<usize> {
    let number = usize::try_from(given).ok().filter(|number| (least..=most).contains(number));
    number.ok_or_else(|| input(format!("{name}: {given} given, expected {least} to {most}")))
}

/// An array of numbers for a caller.
pub(crate) type Array<'py> = Bound<'py, PyArrayDyn<f64>>;

/// Points given as `[width]`, or as `[points, width]`.
#[derive(Debug)]
pub(crate) struct Points {
    /// Row by row.
    pub(crate) values: Vec<f64>,
    /// How many there are, if they are given as rows.
    pub(crate) rows: Option<usize>,
}

impl Points {
    /// Reads `given` for the argument `name`, which has a number per each of `names`.
    pub(crate) fn read(given: &Given<'_>, name: &str, names: &[String]) -> PyResult<Self> {
        let width = names.len();
        let rows = match *given.shape() {
            [] if width == 1 => None,
            [found] if found == width => None,
            [rows, found] if found == width => Some(rows),
            ref found => {
                return Err(input(format!(
                    "{name}: an array of shape {} given, expected {width} numbers ({}), or rows of \
                     them",
                    shape(found),
                    names.join(", ")
                )));
            }
        };
        Ok(Self { values: values(given), rows })
    }

    /// How many points there are.
    pub(crate) fn count(&self) -> usize {
        self.rows.unwrap_or(1)
    }

    /// Point `k` of `count`, whose rows have `width` numbers; one point stands for all.
    pub(crate) fn repeated(self, count: usize) -> Vec<f64> {
        match self.rows {
            None => self.values.repeat(count),
            Some(_) => self.values,
        }
    }
}

/// The numbers of an array, row by row.
pub(crate) fn values(given: &Given<'_>) -> Vec<f64> {
    match given.as_array().as_slice() {
        Some(values) => values.to_vec(),
        // By columns, or with gaps.
        None => given.as_array().iter().copied().collect(),
    }
}

/// The numbers of a vector, whose length the caller of this looks at; a number is a vector of one.
pub(crate) fn vector(given: &Given<'_>, name: &str) -> PyResult<Vec<f64>> {
    match *given.shape() {
        [] | [_] => Ok(values(given)),
        ref found => {
            let found = shape(found);
            Err(input(format!("{name}: an array of shape {found} given, expected a vector")))
        }
    }
}

/// A shape as Python writes it.
fn shape(of: &[usize]) -> String {
    match of {
        [one] => format!("({one},)"),
        all => format!("({})", all.iter().map(usize::to_string).collect::<Vec<_>>().join(", ")),
    }
}

/// An array of this shape, with the number of points in front where they were rows.
pub(crate) fn array<'py>(
    py: Python<'py>,
    values: Vec<f64>,
    rows: Option<usize>,
    shape: &[usize],
) -> PyResult<Array<'py>> {
    let shape: Vec<usize> = rows.into_iter().chain(shape.iter().copied()).collect();
    PyArray1::from_vec(py, values).reshape(shape)
}
