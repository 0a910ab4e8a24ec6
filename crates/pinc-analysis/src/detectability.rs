//! Whether measurements determine the states and disturbances of an estimator.

use crate::Complex;
use faer::Mat;

/// Singular values this far below the largest count as 0.
const RANK: f64 = 1e-7;
/// Modes that decay by less than this part per step count as lasting.
const LASTING: f64 = 1e-6;
/// An unseen deviation that is this small at the end of a trajectory has decayed.
const DECAYED: f64 = 0.5;
/// Eigenvalues nearer than this to each other count as one: eigenvalues of integrators scatter
/// about 1.
const ALIKE: f64 = 1e-4;

/// A mode of a linear model in discrete time that does not decay and cannot be seen in what is
/// measured: an estimator of it drifts or diverges.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct UnseenMode {
    /// Its eigenvalue; constants, such as disturbances, have 1.
    pub eigenvalue: Complex,
    /// The rank of [lambda - A; C], which is less than the number of states.
    pub rank: usize,
    /// How much each state takes part in it; the largest is 1.
    pub direction: Vec<f64>,
}

/// The modes of x+ = A x, y = C x that an estimator cannot find, by the test of Popov, Belevitch
/// and Hautus at all eigenvalues on and outside the unit circle, and at 1. With none the pair is
/// detectable. For a model augmented by disturbances d the test at 1 is
///
/// ```text
/// rank [A - 1, Bd; C, Cd] = n + nd
/// ```
///
/// `a`: `[states, states]`; `c`: `[ny, states]`, both row by row; the states and measurements
/// should be of like sizes.
///
/// ```
/// use pinc_analysis::unseen_modes;
///
/// // A level with two leaks, of which only the sum can be told.
/// let a = [0.9, 1.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
/// let unseen = unseen_modes(&a, &[1.0, 0.0, 0.0], 3);
/// assert_eq!((unseen.len(), unseen[0].rank), (1, 2));
/// assert!(unseen[0].direction[0] < 1e-9 && unseen[0].direction[2] > 0.99);
/// ```
///
/// # Panics
///
/// If a matrix has not whole rows, or `states` is 0.
#[must_use]
pub fn unseen_modes(a: &[f64], c: &[f64], states: usize) -> Vec<UnseenMode> {
    assert!(states > 0 && a.len() == states * states, "A is square");
    assert!(c.len().is_multiple_of(states), "whole rows");
    if a.iter().chain(c).any(|v| !v.is_finite()) {
        return Vec::new();
    }
    let matrix = Mat::from_fn(states, states, |i, k| a[i * states + k]);
    let mut candidates = vec![Complex { re: 1.0, im: 0.0 }];
    for value in matrix.eigenvalues().unwrap_or_default() {
        let value = Complex { re: value.re, im: value.im };
        let is_near = |other: &Complex| (value.re - other.re).hypot(value.im - other.im) < ALIKE;
        // Those with a negative imaginary part mirror the others.
        if value.abs() >= 1.0 - LASTING && value.im >= 0.0 && !candidates.iter().any(is_near) {
            candidates.push(value);
        }
    }
    candidates.into_iter().filter_map(|at| unseen(a, c, states, at)).collect()
}

/// A direction of the initial state that no measurement along a trajectory shows and that does not
/// decay. Each step of the trajectory has its own A and C. The test is the rank of the
/// observability matrix `[C_0; C_1 A_0; C_2 A_1 A_0; ..]`.
///
/// `steps`: A `[states, states]` and C `[ny, states]` of each step, row by row.
///
/// ```
/// use pinc_analysis::unseen_along;
///
/// // x2 shows only where the gain of x1 on it changes: with the same A twice it does not.
/// let step = |gain: f64| (vec![1.0, 0.0, gain, 1.0], vec![1.0, 0.0]);
/// assert_eq!(unseen_along(&[step(0.0), step(0.5)], 2).unwrap().rank, 1);
/// let seen = (vec![1.0, 0.3, 0.0, 1.0], vec![1.0, 0.0]);
/// assert!(unseen_along(&[step(0.0), seen.clone(), seen], 2).is_none());
/// ```
///
/// # Panics
///
/// If a matrix has not whole rows, or `states` is 0.
#[must_use]
pub fn unseen_along(steps: &[(Vec<f64>, Vec<f64>)], states: usize) -> Option<UnseenMode> {
    assert!(states > 0, "a state at least");
    let n = states;
    let mut flow = Mat::<f64>::identity(n, n);
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for (a, c) in steps {
        assert!(a.len() == n * n && c.len().is_multiple_of(n), "whole rows");
        let seen = Mat::from_fn(c.len() / n, n, |i, k| c[i * n + k]) * &flow;
        rows.extend(seen.row_iter().map(|row| row.iter().copied().collect::<Vec<_>>()));
        flow = Mat::from_fn(n, n, |i, k| a[i * n + k]) * &flow;
    }
    if rows.len() < n || rows.iter().flatten().any(|v| !v.is_finite()) {
        return None;
    }
    let svd = Mat::from_fn(rows.len(), n, |i, k| rows[i][k]).svd().ok()?;
    let values: Vec<f64> = svd.S().column_vector().iter().copied().collect();
    let largest = values.first().copied()?;
    let rank = values.iter().filter(|v| **v > RANK * largest).count();
    let unseen = (rank..n).map(|k| svd.V().col(k).iter().copied().collect::<Vec<f64>>());
    let lasting = unseen.into_iter().find(|direction| {
        let end = (0..n).map(|i| (0..n).map(|k| flow[(i, k)] * direction[k]).sum::<f64>().powi(2));
        end.sum::<f64>().sqrt() > DECAYED
    })?;
    let most = lasting.iter().fold(f64::MIN_POSITIVE, |m: f64, v| m.max(v.abs()));
    let direction = lasting.iter().map(|v| v.abs() / most).collect();
    Some(UnseenMode { eigenvalue: Complex { re: 1.0, im: 0.0 }, rank, direction })
}

/// The mode at an eigenvalue, if it is unseen. A complex matrix of rank r is a real one of rank
/// 2 r.
fn unseen(a: &[f64], c: &[f64], n: usize, at: Complex) -> Option<UnseenMode> {
    let outputs = c.len() / n;
    let is_real = at.im.abs() < RANK;
    let parts = if is_real { 1 } else { 2 };
    let entry = |row: usize, column: usize| {
        let unit = if row == column { 1.0 } else { 0.0 };
        let real =
            if row < n { at.re * unit - a[row * n + column] } else { c[(row - n) * n + column] };
        (real, if row < n { at.im * unit } else { 0.0 })
    };
    let height = n + outputs;
    let stacked = Mat::from_fn(parts * height, parts * n, |i, k| {
        let (real, imaginary) = entry(i % height, k % n);
        match (i < height, k < n) {
            (true, true) | (false, false) => real,
            (true, false) => -imaginary,
            (false, true) => imaginary,
        }
    });
    let svd = stacked.svd().ok()?;
    let values: Vec<f64> = svd.S().column_vector().iter().copied().collect();
    let largest = values.first().copied()?;
    let rank = values.iter().filter(|v| **v > RANK * largest).count() / parts;
    if rank == n {
        return None;
    }
    let last = svd.V().col(parts * n - 1);
    let size = |i: usize| (0..parts).map(|part| last[part * n + i].powi(2)).sum::<f64>().sqrt();
    let sizes: Vec<f64> = (0..n).map(size).collect();
    let most = sizes.iter().fold(f64::MIN_POSITIVE, |m: f64, v| m.max(*v));
    let direction = sizes.iter().map(|v| v / most).collect();
    Some(UnseenMode { eigenvalue: at, rank, direction })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_seen_or_decays_is_no_trouble() {
        // A double integrator by its position, and a stable state that nothing shows.
        assert!(unseen_modes(&[1.0, 1.0, 0.0, 1.0], &[1.0, 0.0], 2).is_empty());
        assert!(unseen_modes(&[0.9, 0.0, 0.0, 0.5], &[1.0, 0.0], 2).is_empty());
        // By its velocity the position is not known.
        let unseen = unseen_modes(&[1.0, 1.0, 0.0, 1.0], &[0.0, 1.0], 2);
        assert_eq!((unseen.len(), unseen[0].rank), (1, 1));
        assert!(unseen[0].direction[0] > 0.99 && unseen[0].direction[1] < 1e-6);
    }

    #[test]
    fn an_oscillation_that_grows_unseen_is_found() {
        let a = [1.1, -0.5, 0.0, 0.5, 1.1, 0.0, 0.0, 0.0, 0.2];
        let unseen = unseen_modes(&a, &[0.0, 0.0, 1.0], 3);
        assert_eq!((unseen.len(), unseen[0].rank), (1, 2));
        assert!((unseen[0].eigenvalue.im - 0.5).abs() < 1e-9);
        assert!(unseen_modes(&a, &[1.0, 0.0, 0.0], 3).is_empty());
    }

    /// What goes round without growth or decay lasts, whichever way it points in between: a quarter
    /// of a turn in each step, or a change of sign.
    #[test]
    fn an_oscillation_that_lasts_unseen_is_found() {
        let quarter = [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.5];
        let unseen = unseen_modes(&quarter, &[0.0, 0.0, 1.0], 3);
        assert_eq!((unseen.len(), unseen[0].rank), (1, 2));
        let UnseenMode { eigenvalue, direction, .. } = &unseen[0];
        assert!(eigenvalue.re.abs() < 1e-9 && (eigenvalue.im - 1.0).abs() < 1e-9, "{eigenvalue:?}");
        // Both states of the oscillation, and not the third.
        for (found, expected) in direction.iter().zip([1.0, 1.0, 0.0]) {
            assert!((found - expected).abs() < 1e-9, "{direction:?}");
        }
        assert!(unseen_modes(&quarter, &[1.0, 0.0, 0.0], 3).is_empty());
        let unseen = unseen_modes(&[-1.0, 0.0, 0.0, 0.5], &[0.0, 1.0], 2);
        assert_eq!((unseen.len(), unseen[0].rank), (1, 1));
        assert!((unseen[0].eigenvalue.re + 1.0).abs() < 1e-9, "{unseen:?}");
        // Slightly damped, it is gone some time.
        assert!(unseen_modes(&[-0.999, 0.0, 0.0, 0.5], &[0.0, 1.0], 2).is_empty());
    }

    /// Along a trajectory: of two states that stay, the sum alone is seen. The difference is not,
    /// unless it decays to less than half in the end.
    #[test]
    fn what_is_not_seen_along_a_trajectory_has_to_last() {
        let steps = |factor: f64, count: usize| {
            let a = vec![
                0.5 * (1.0 + factor),
                0.5 * (1.0 - factor),
                0.5 * (1.0 - factor),
                0.5 * (1.0 + factor),
            ];
            vec![(a, vec![1.0, 1.0]); count]
        };
        let unseen = unseen_along(&steps(1.0, 4), 2).unwrap();
        assert_eq!(unseen.rank, 1);
        assert!(unseen.direction.iter().all(|part| (part - 1.0).abs() < 1e-9), "{unseen:?}");
        // 0.9^6 = 0.53, and 0.9^7 = 0.48.
        assert!(unseen_along(&steps(0.9, 6), 2).is_some());
        assert!(unseen_along(&steps(0.9, 7), 2).is_none());
        // One measurement is too few to tell.
        assert!(unseen_along(&steps(1.0, 1), 2).is_none());
    }
}
