//! Levenberg-Marquardt for small dense problems with bounds.

use faer::Mat;
use faer::linalg::solvers::SolveLstsq;

const ITERATIONS: usize = 200;

/// A sum of squares to be made small, in variables of a like size.
pub(crate) trait LeastSquares {
    /// Their values at `v`.
    fn residuals(&self, v: &[f64]) -> Vec<f64>;
    /// Their derivatives in `v`, a row per residual.
    fn jacobian(&self, v: &[f64]) -> Mat<f64>;
    /// The ends of variable `k`.
    fn ends(&self, k: usize) -> (f64, f64);
}

pub(crate) fn squares(r: &[f64]) -> f64 {
    r.iter().map(|r| r * r).sum()
}

/// A local minimum, from `start`; the last point that is finite where there is none.
pub(crate) fn minimize(problem: &impl LeastSquares, start: &[f64]) -> Vec<f64> {
    let clamped = |k: usize, v: f64| {
        let (low, high) = problem.ends(k);
        v.max(low).min(high)
    };
    let mut v: Vec<f64> = start.iter().enumerate().map(|(k, &v)| clamped(k, v)).collect();
    let mut r = problem.residuals(&v);
    let mut damping = 1e-3;
    for _ in 0..ITERATIONS {
        let cost = squares(&r);
        let j = problem.jacobian(&v);
        let finite = cost.is_finite() && j.col_iter().all(|c| c.iter().all(|a| a.is_finite()));
        if !finite || cost < 1e-30 || damping > 1e10 {
            break;
        }
        let step = step(problem, &v, &r, &j, damping);
        let next: Vec<f64> = (0..v.len()).map(|k| clamped(k, v[k] + step[k])).collect();
        let moved = next.iter().zip(&v).any(|(a, b)| (a - b).abs() > 1e-15 * (1.0 + b.abs()));
        if !moved {
            break;
        }
        let next_r = problem.residuals(&next);
        if squares(&next_r) < cost {
            (v, r) = (next, next_r);
            damping = f64::max(damping / 5.0, 1e-14);
        } else {
            damping *= 6.0;
        }
    }
    v
}

/// The d that minimizes |J d + r|^2 + damping |J|^2 |d|^2 in the variables that may move, by a QR
/// decomposition: the normal equations would square the condition number, and rates of stiff plants
/// are far apart.
fn step(problem: &impl LeastSquares, v: &[f64], r: &[f64], j: &Mat<f64>, damping: f64) -> Vec<f64> {
    let slope = |k: usize| j.col(k).iter().zip(r).map(|(a, r)| a * r).sum::<f64>();
    let may_move = |&k: &usize| {
        let (low, high) = problem.ends(k);
        let slope = slope(k);
        !(v[k] <= low && slope >= 0.0 || v[k] >= high && slope <= 0.0)
    };
    let free: Vec<usize> = (0..v.len()).filter(may_move).collect();
    let length = |k: usize| j.col(k).iter().map(|a| a * a).sum::<f64>();
    let largest = free.iter().map(|&k| length(k)).fold(0.0, f64::max);
    let mut step = vec![0.0; v.len()];
    if free.is_empty() || largest <= 0.0 {
        return step;
    }
    let (rows, weight) = (r.len(), (damping * largest).sqrt());
    let matrix = Mat::from_fn(rows + free.len(), free.len(), |i, a| {
        if i < rows {
            j[(i, free[a])]
        } else if i - rows == a {
            weight
        } else {
            0.0
        }
    });
    let right = Mat::from_fn(rows + free.len(), 1, |i, _| if i < rows { -r[i] } else { 0.0 });
    let solution = matrix.qr().solve_lstsq(&right);
    for (a, &k) in free.iter().enumerate() {
        step[k] = solution[(a, 0)];
    }
    step
}
