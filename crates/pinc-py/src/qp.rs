//! Quadratic programs by the controllers' solvers.

use crate::arrays::{Array, Given, array, values};
use crate::errors::input;
use numpy::PyUntypedArrayMethods;
use pinc_qp::{ChosenQp, Limits, OcpDims, Qp, QpMethod, QpSolver, QpStatus, QpStep};
use pyo3::prelude::*;

/// Solution and multipliers of inequalities, equalities and bounds.
type Solution<'py> = (Array<'py>, Array<'py>, Array<'py>, Array<'py>);

/// None of these may be NaN, as what is left out but must be there.
fn numbers(values: Vec<f64>, name: &str) -> PyResult<Vec<f64>> {
    match values.iter().any(|value| value.is_nan()) {
        true => Err(input(format!("{name}: NaN or nothing given, expected numbers"))),
        false => Ok(values),
    }
}

/// A matrix with rows of `n` numbers, and how many rows it has.
fn matrix(given: Option<&Given<'_>>, name: &str, n: usize) -> PyResult<(Vec<f64>, usize)> {
    match given.map(|given| (given.shape(), given)) {
        None => Ok((Vec::new(), 0)),
        Some(([rows, width], given)) if *width == n => Ok((numbers(values(given), name)?, *rows)),
        Some(_) => Err(input(format!("{name}: expected a matrix with {n} columns"))),
    }
}

fn vector(given: Option<&Given<'_>>, name: &str, n: usize, absent: f64) -> PyResult<Vec<f64>> {
    match given.map(|given| (given.shape(), given)) {
        None => numbers(vec![absent; n], name),
        Some(([found], given)) if *found == n => numbers(values(given), name),
        Some(_) => Err(input(format!("{name}: expected a vector of {n} numbers"))),
    }
}

/// min x'P x / 2 + q'x s.t. G x <= h, A x = b, lb <= x <= ub; None if there is no solution. The
/// unknowns are the inputs of a single stage, whose one state does not move.
#[pyfunction]
#[pyo3(signature = (p, q, g=None, h=None, a=None, b=None, lb=None, ub=None))]
#[expect(clippy::too_many_arguments, reason = "the names that qpsolvers has for them")]
pub(crate) fn solve_dense_qp<'py>(
    py: Python<'py>,
    p: Given<'py>,
    q: Given<'py>,
    g: Option<Given<'py>>,
    h: Option<Given<'py>>,
    a: Option<Given<'py>>,
    b: Option<Given<'py>>,
    lb: Option<Given<'py>>,
    ub: Option<Given<'py>>,
) -> PyResult<Option<Solution<'py>>> {
    let n = q.shape().iter().product();
    let (p, rows) = matrix(Some(&p), "P", n)?;
    if rows != n || n == 0 {
        return Err(input(format!("P: expected a matrix of shape ({n}, {n}), as long as q")));
    }
    let (g, inequalities) = matrix(g.as_ref(), "G", n)?;
    let (a, equalities) = matrix(a.as_ref(), "A", n)?;
    let dims = OcpDims { inequalities, equalities, ..OcpDims::new(1, n, 1) };
    let mut qp = Qp::new(dims, vec![1.0], vec![0.0; n * n]);
    qp.w = p;
    qp.gradient[1..].copy_from_slice(&numbers(values(&q), "q")?);
    qp.rows_u = [g, a].concat();
    let b = vector(b.as_ref(), "b", equalities, f64::NAN)?;
    qp.rows.low[inequalities..].copy_from_slice(&b);
    qp.rows.high[..inequalities].copy_from_slice(&vector(h.as_ref(), "h", inequalities, f64::NAN)?);
    qp.rows.high[inequalities..].copy_from_slice(&b);
    qp.bounds.low[1..].copy_from_slice(&vector(lb.as_ref(), "lb", n, f64::NEG_INFINITY)?);
    qp.bounds.high[1..].copy_from_slice(&vector(ub.as_ref(), "ub", n, f64::INFINITY)?);
    // The methods take lower ends that are no higher than the upper ones, and numbers within them.
    let crossed = |of: &Limits| {
        let mut ends = of.low.iter().zip(&of.high);
        ends.any(|(low, high)| low > high || *low == f64::INFINITY || *high == f64::NEG_INFINITY)
    };
    if crossed(&qp.rows) || crossed(&qp.bounds) {
        return Ok(None);
    }
    let mut step = QpStep::new(dims);
    let status = py.detach(|| {
        let mut status = QpStatus::Failed;
        // The memory of a method that is not needed would take longer than the solution.
        for method in [QpMethod::Condensed, QpMethod::Clarabel] {
            if status == QpStatus::Failed {
                step = QpStep::new(dims);
                status = ChosenQp::new(&qp, method)?.solve(&qp, &mut step, &mut || false);
            }
        }
        Ok(status)
    });
    let status = status.map_err(|error: pinc_qp::QpError| input(error.to_string()))?;
    if status != QpStatus::Solved {
        return Ok(None);
    }
    let list = |of: &[f64]| array(py, of.to_vec(), None, &[of.len()]);
    let (z, y) = step.multipliers.rows.split_at(inequalities);
    Ok(Some((list(&step.d[1..])?, list(z)?, list(y)?, list(&step.multipliers.bounds[1..])?)))
}
