//! Jacobians agree with differences.

use crate::candidates::{Candidate, candidates};
use crate::harness::{Point, linearize, linearize_output, output, step};
use pinc_ode::{Dims, LinearizationBuffer, Model};
use proptest::prelude::*;
use proptest::test_runner::TestCaseError;

/// Steps of the differences, in widths of the variable's range.
const STEP: f64 = 1e-4;

/// The derivatives of `f` in variable `j`, by Richardson's extrapolation of central differences
/// with steps of `h` and 2 `h`: good to h^4 times the fifth derivatives, and to the rounding of the
/// values by h.
fn differences(mut f: impl FnMut(&[f64]) -> Vec<f64>, at: &[f64], j: usize, h: f64) -> Vec<f64> {
    let mut shifted = |steps: f64| {
        let mut at = at.to_vec();
        at[j] += steps * h;
        f(&at)
    };
    let values = [-2.0, -1.0, 1.0, 2.0].map(&mut shifted);
    let derivative = |i: usize| {
        let [far_left, left, right, far_right] = [0, 1, 2, 3].map(|k| values[k][i]);
        (8.0 * (right - left) - (far_right - far_left)) / (12.0 * h)
    };
    (0..values[0].len()).map(derivative).collect()
}

/// Compares the Jacobian `exact(i, j)` of `f` with differences. Everything is in widths of the
/// ranges, so that units do not matter: an entry counts by what its variable can change, relative
/// to the `sizes` of the values.
fn check_columns(
    candidate: &Candidate,
    at: &Point,
    mut f: impl FnMut(&[f64]) -> Vec<f64>,
    exact: impl Fn(usize, usize) -> f64,
    sizes: &[f64],
) -> Result<(), TestCaseError> {
    for (j, [low, high]) in candidate.ranges().into_iter().enumerate() {
        let width = high - low;
        let found = differences(&mut f, &at.variables(), j, STEP * width);
        for (i, (difference, size)) in found.into_iter().zip(sizes).enumerate() {
            let error = (exact(i, j) - difference).abs() * width;
            prop_assert!(error < 1e-8 * size, "{} {}: {} {}", i, j, exact(i, j), difference);
        }
    }
    Ok(())
}

/// Entry (i, j) of the Jacobian whose columns by x, u and p are in three matrices.
fn entry([by_x, by_u, by_p]: [&[f64]; 3], dims: Dims, i: usize, j: usize) -> f64 {
    let Dims { nx, nu, np, .. } = dims;
    if j < nx {
        by_x[i * nx + j]
    } else if j < nx + nu {
        by_u[i * nu + j - nx]
    } else {
        by_p[i * np + j - nx - nu]
    }
}

/// The largest magnitudes in the ranges of the states.
fn state_sizes(candidate: &Candidate, dims: Dims) -> Vec<f64> {
    let sizes = candidate.ranges().into_iter().map(|[low, high]| low.abs().max(high.abs()));
    sizes.take(dims.nx).collect()
}

#[test]
fn of_steps() {
    for candidate in candidates() {
        candidate.on_points(|model, at| {
            let dims = model.dims();
            let LinearizationBuffer { a, b, e, .. } = linearize(model, at);
            let f = |v: &[f64]| step(model, &Point::new(v, dims));
            let exact = |i, j| entry([&a, &b, &e], dims, i, j);
            check_columns(&candidate, at, f, exact, &state_sizes(&candidate, dims))
        });
    }
}

#[test]
fn of_outputs() {
    for candidate in candidates() {
        let sizes = output_sizes(&mut *candidate.build(), &candidate);
        candidate.on_points(|model, at| {
            let dims = model.dims();
            let outputs = linearize_output(model, at);
            let f = |v: &[f64]| output(model, &Point::new(v, dims));
            let exact = |i, j| entry([&outputs.c, &outputs.d, &outputs.e], dims, i, j);
            check_columns(&candidate, at, f, exact, &sizes)
        });
    }
}

/// What the outputs are where all variables are at the largest.
fn output_sizes(model: &mut dyn Model, candidate: &Candidate) -> Vec<f64> {
    let largest: Vec<_> = candidate.ranges().iter().map(|[_, high]| *high).collect();
    let at = Point::new(&largest, model.dims());
    let y = output(model, &at);
    y.into_iter().map(f64::abs).collect()
}
