//! Arrays in and out.

use crate::errors::input;
use numpy::{
    AllowTypeChange, PyArray1, PyArrayDyn, PyArrayLikeDyn, PyArrayMethods, PyReadonlyArrayDyn,
    PyUntypedArrayMethods,
};
use pyo3::prelude::*;

/// Numbers as a caller gives them: an array, or what `numpy` makes one of.
pub(crate) type Given<'py> = PyArrayLikeDyn<'py, f64, AllowTypeChange>;

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
    let array: &PyReadonlyArrayDyn<'_, f64> = given;
    match array.as_array().as_slice() {
        Some(values) => values.to_vec(),
        // By columns, or with gaps.
        None => array.as_array().iter().copied().collect(),
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
