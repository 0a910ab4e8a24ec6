//! Steady states: where f(x, u) = 0, with some of the states held at given values.

use super::Subject;
use faer::Mat;
use faer::linalg::solvers::Solve;

/// Levenberg-Marquardt iterations from one start, and starts.
const ITERATIONS: usize = 200;
const STARTS: usize = 16;

/// How much the velocity counts against the distance from the values to be held: where both cannot be,
/// a steady state near them is wanted.
const REST: f64 = 100.0;

/// Movement in a step T, in widths of the box, that counts as rest.
const AT_REST: f64 = 1e-9;

/// Distance from a value to be held, in widths of the box, that still counts as held.
const HELD: f64 = 1e-3;

/// A state and an input.
#[derive(Clone, Debug)]
pub(super) struct Point {
    pub(super) x: Vec<f64>,
    pub(super) u: Vec<f64>,
}

impl Point {
    pub(super) fn joined(&self) -> Vec<f64> {
        [&self.x[..], &self.u].concat()
    }
}

/// Where a reference can be held.
#[derive(Debug)]
pub(super) enum SteadyStateResult {
    /// In a steady state within the controller's bounds.
    Within(Point),
    /// Only in one outside of them.
    Outside(Point),
    /// In none; the nearest steady state found, if any was.
    Nowhere(Option<Point>),
}

/// What is asked of a steady state.
struct Wanted {
    /// States, by their places, and their values.
    held: Vec<(usize, f64)>,
    /// Ends of x and u.
    low: Vec<f64>,
    high: Vec<f64>,
}

/// Where each reference of the config can be held.
pub(super) fn holds(subject: &Subject<'_>) -> Vec<SteadyStateResult> {
    let Some(control) = &subject.experiment.control else {
        return Vec::new();
    };
    let places = subject.controlled();
    let hold = |value: &Vec<f64>| {
        let held: Vec<_> = places.iter().copied().zip(value.iter().copied()).collect();
        let bounds = bounds(subject);
        if let Ok(point) = search(subject, &Wanted { held: held.clone(), ..bounds }) {
            return SteadyStateResult::Within(point);
        }
        match search(subject, &Wanted { held, ..unbounded(subject) }) {
            Ok(point) => SteadyStateResult::Outside(point),
            Err(nearest) => SteadyStateResult::Nowhere(nearest.and_then(|p| settle(subject, &p))),
        }
    };
    control.references.iter().map(|reference| hold(&reference.value)).collect()
}

/// The steady state for the input in the middle of the region.
pub(super) fn of_centre(subject: &Subject<'_>) -> Option<Point> {
    settle(subject, &subject.region.centre())
}

/// The steady state under the input of `start`, near its state.
pub(super) fn settle(subject: &Subject<'_>, start: &Point) -> Option<Point> {
    let mut wanted = Wanted { held: Vec::new(), ..unbounded(subject) };
    let n = start.x.len();
    wanted.low[n..].copy_from_slice(&start.u);
    wanted.high[n..].copy_from_slice(&start.u);
    let others = subject.region.points(subject.experiment.seed).take(STARTS);
    let starts =
        std::iter::once(start.clone()).chain(others.map(|p| Point { x: p.x, ..start.clone() }));
    let mut found = starts.map(|start| descend(subject, &wanted, start.joined()));
    let point = found.find(|v| is_met(subject, &wanted, v))?;
    Some(subject.region.split(point))
}

/// What the controller may use.
fn bounds(subject: &Subject<'_>) -> Wanted {
    let mut wanted = unbounded(subject);
    if let Some(control) = &subject.experiment.control {
        let n = subject.region.dims.nx;
        for (side, states, inputs) in [
            (&mut wanted.low, &control.state_low, &control.input_low),
            (&mut wanted.high, &control.state_high, &control.input_high),
        ] {
            if let Some(states) = states {
                side[..n].copy_from_slice(states);
            }
            side[n..].copy_from_slice(inputs);
        }
    }
    wanted
}

fn unbounded(subject: &Subject<'_>) -> Wanted {
    let size = subject.region.low.len();
    Wanted { held: Vec::new(), low: vec![f64::NEG_INFINITY; size], high: vec![f64::INFINITY; size] }
}

/// A steady state as wanted, or the best that was found.
fn search(subject: &Subject<'_>, wanted: &Wanted) -> Result<Point, Option<Point>> {
    let mut best: Option<(f64, Vec<f64>)> = None;
    let starts = std::iter::once(subject.region.centre())
        .chain(subject.region.points(subject.experiment.seed));
    for mut start in starts.take(STARTS) {
        for &(i, value) in &wanted.held {
            start.x[i] = value;
        }
        let v = descend(subject, wanted, start.joined());
        if is_met(subject, wanted, &v) {
            return Ok(subject.region.split(v));
        }
        let cost = squares(&residuals(subject, wanted, &v));
        if cost.is_finite() && best.as_ref().is_none_or(|(least, _)| cost < *least) {
            best = Some((cost, v));
        }
    }
    Err(best.map(|(_, v)| subject.region.split(v)))
}

fn is_met(subject: &Subject<'_>, wanted: &Wanted, v: &[f64]) -> bool {
    let r = residuals(subject, wanted, v);
    let (rest, held) = r.split_at(subject.region.dims.nx);
    rest.iter().all(|r| r.abs() <= REST * AT_REST) && held.iter().all(|r| r.abs() <= HELD)
}

/// The velocities, in widths per T, and the distances from what is to be held, in widths.
fn residuals(subject: &Subject<'_>, wanted: &Wanted, v: &[f64]) -> Vec<f64> {
    let region = &subject.region;
    let (x, u) = v.split_at(region.dims.nx);
    let velocity = subject.rhs(x, u).into_iter().enumerate();
    let rest = velocity.map(|(i, f)| REST * f * subject.step_s() / region.width(i));
    let held = wanted.held.iter().map(|&(i, value)| (v[i] - value) / region.width(i));
    rest.chain(held).collect()
}

/// Their Jacobian in the variables, these in widths.
fn residual_jacobian(subject: &Subject<'_>, wanted: &Wanted, v: &[f64]) -> Mat<f64> {
    let region = &subject.region;
    let n = region.dims.nx;
    let (x, u) = v.split_at(n);
    let f = subject.jacobian(x, u);
    Mat::from_fn(n + wanted.held.len(), v.len(), |row, column| {
        if row < n {
            let scale = REST * subject.step_s() / region.width(row);
            scale * f[(row, column)] * region.width(column)
        } else if wanted.held[row - n].0 == column {
            1.0
        } else {
            0.0
        }
    })
}

fn squares(r: &[f64]) -> f64 {
    r.iter().map(|r| r * r).sum()
}

/// Levenberg-Marquardt with variables kept between their ends: a local minimum of the residuals.
fn descend(subject: &Subject<'_>, wanted: &Wanted, start: Vec<f64>) -> Vec<f64> {
    let ends = wanted.low.iter().zip(&wanted.high);
    let mut v: Vec<f64> =
        start.iter().zip(ends).map(|(v, (low, high))| v.max(*low).min(*high)).collect();
    let mut r = residuals(subject, wanted, &v);
    let mut damping = 1e-3;
    for _ in 0..ITERATIONS {
        let cost = squares(&r);
        let j = residual_jacobian(subject, wanted, &v);
        let finite = cost.is_finite() && j.col_iter().all(|c| c.iter().all(|a| a.is_finite()));
        if !finite || cost < 1e-26 || damping > 1e10 {
            break;
        }
        let next = step(subject, wanted, &v, &r, &j, damping);
        let next_r = residuals(subject, wanted, &next);
        if squares(&next_r) < cost {
            (v, r) = (next, next_r);
            damping = f64::max(damping / 5.0, 1e-14);
        } else {
            damping *= 6.0;
        }
    }
    v
}

/// v + d, where d solves (J'J + damping) d = -J'r in the variables that may move.
fn step(
    subject: &Subject<'_>,
    wanted: &Wanted,
    v: &[f64],
    r: &[f64],
    j: &Mat<f64>,
    damping: f64,
) -> Vec<f64> {
    let gradient: Vec<f64> =
        j.col_iter().map(|c| c.iter().zip(r).map(|(a, r)| a * r).sum()).collect();
    let may_move = |&k: &usize| {
        let held_down = v[k] <= wanted.low[k] && gradient[k] >= 0.0;
        let held_up = v[k] >= wanted.high[k] && gradient[k] <= 0.0;
        !held_down && !held_up
    };
    let free: Vec<usize> = (0..v.len()).filter(may_move).collect();
    let dot = |a: usize, b: usize| -> f64 { (0..r.len()).map(|i| j[(i, a)] * j[(i, b)]).sum() };
    let largest = free.iter().map(|&k| dot(k, k)).fold(0.0, f64::max);
    let matrix = Mat::from_fn(free.len(), free.len(), |a, b| {
        dot(free[a], free[b]) + if a == b { damping * largest } else { 0.0 }
    });
    let right = Mat::from_fn(free.len(), 1, |a, _| -gradient[free[a]]);
    let mut next = v.to_vec();
    if free.is_empty() || largest <= 0.0 {
        return next;
    }
    let d = matrix.partial_piv_lu().solve(&right);
    for (a, &k) in free.iter().enumerate() {
        let moved = v[k] + d[(a, 0)] * subject.region.width(k);
        next[k] = moved.max(wanted.low[k]).min(wanted.high[k]);
    }
    next
}
