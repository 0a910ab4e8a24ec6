//! The linearized problem: all triangles together, with damping and bounds.

use crate::problem::Problem;
use crate::shooting::Shooting;
use crate::triangle::{Triangle, solve};

/// A step: the changes of the parameters and of the q of each recording.
#[derive(Clone, Debug)]
pub(crate) struct Step {
    pub(crate) dp: Vec<f64>,
    pub(crate) q: Vec<Vec<f64>>,
    /// The cost after it, according to the linearization.
    pub(crate) cost: f64,
}

/// Memory for the solution.
#[derive(Debug)]
pub(crate) struct Linear {
    /// The triangles of the recordings.
    factors: Vec<Vec<f64>>,
    /// The triangles with damping.
    damped: Vec<Triangle>,
    /// What they say of the parameters alone.
    reduced: Triangle,
    /// The reduced triangle without the parameters that are held at a bound.
    free: Triangle,
    /// The length of each parameter's column, in all rows.
    lengths: Vec<f64>,
    /// The slope of the cost.
    slope: Vec<f64>,
    pub(crate) step: Step,
}

impl Linear {
    pub(crate) fn new(unknown: usize, recordings: &[Shooting<'_>]) -> Self {
        let damped: Vec<_> =
            recordings.iter().map(|of| Triangle::new(of.triangle.width())).collect();
        Self {
            factors: recordings.iter().map(|of| vec![0.0; of.triangle.width().pow(2)]).collect(),
            damped,
            reduced: Triangle::new(unknown + 1),
            free: Triangle::new(unknown + 1),
            lengths: vec![0.0; unknown],
            slope: vec![0.0; unknown],
            step: Step {
                dp: vec![0.0; unknown],
                q: recordings.iter().map(|of| vec![0.0; of.nq]).collect(),
                cost: 0.0,
            },
        }
    }

    /// Takes over the triangles of the recordings. Gives whether all their numbers are finite.
    pub(crate) fn take(
        &mut self,
        problem: &Problem,
        p: &[f64],
        recordings: &mut [Shooting<'_>],
    ) -> bool {
        self.lengths.fill(0.0);
        self.slope.fill(0.0);
        let mut finite = true;
        for (of, factor) in recordings.iter_mut().zip(&mut self.factors) {
            factor.copy_from_slice(of.triangle.factor());
            finite &= factor.iter().all(|v| v.is_finite());
            let width = of.triangle.width();
            for row in factor.chunks_exact(width) {
                let by_p = &row[of.nq..width - 1];
                for ((length, slope), j) in self.lengths.iter_mut().zip(&mut self.slope).zip(by_p) {
                    *length += j * j;
                    *slope += j * row[width - 1];
                }
            }
        }
        for (i, unknown) in problem.unknown.iter().enumerate() {
            if let Some(prior) = unknown.prior {
                self.lengths[i] += prior.sd.powi(-2);
                self.slope[i] += prior.residual(p[unknown.place]) / prior.sd;
            }
        }
        self.lengths.iter_mut().for_each(|length| *length = length.sqrt());
        finite
    }

    /// The length of each parameter's column.
    pub(crate) fn lengths(&self) -> &[f64] {
        &self.lengths
    }

    /// The triangle of each recording.
    pub(crate) fn factors(&self) -> &[Vec<f64>] {
        &self.factors
    }

    /// Whether a parameter is at a bound that the cost pushes it against. One on which nothing
    /// depends is not pushed.
    pub(crate) fn held(&self, problem: &Problem, p: &[f64], i: usize) -> bool {
        let unknown = &problem.unknown[i];
        let (value, slope) = (p[unknown.place], self.slope[i]);
        value <= unknown.low && slope > 0.0 || value >= unknown.high && slope < 0.0
    }

    /// The step of Levenberg and Marquardt, with `damping` times the length of each column, that
    /// keeps the parameters within their bounds.
    pub(crate) fn solve(
        &mut self,
        problem: &Problem,
        p: &[f64],
        recordings: &[Shooting<'_>],
        damping: f64,
    ) {
        let root = damping.sqrt();
        self.reduced.clear();
        for ((of, factor), damped) in recordings.iter().zip(&self.factors).zip(&mut self.damped) {
            let (width, nq) = (of.triangle.width(), of.nq);
            damped.clear();
            for row in factor.chunks_exact(width) {
                damped.push().copy_from_slice(row);
            }
            for i in 0..nq {
                let column = factor.iter().skip(i).step_by(width);
                let length = column.map(|r| r * r).sum::<f64>().sqrt();
                damped.push()[i] = root * weight(length);
            }
            for row in damped.factor().chunks_exact(width).skip(nq) {
                self.reduced.push().copy_from_slice(&row[nq..]);
            }
        }
        for (i, unknown) in problem.unknown.iter().enumerate() {
            if let Some(prior) = unknown.prior {
                let row = self.reduced.push();
                row[i] = 1.0 / prior.sd;
                row[problem.unknown.len()] = prior.residual(p[unknown.place]);
            }
        }
        self.reduced.factor();
        self.parameters(problem, p, root);
        self.states(recordings);
        self.step.cost += prior_cost(problem, p, &self.step.dp);
    }

    fn parameters(&mut self, problem: &Problem, p: &[f64], root: f64) {
        let unknown = problem.unknown.len();
        let width = unknown + 1;
        let mut fixed: Vec<bool> = (0..unknown).map(|i| self.held(problem, p, i)).collect();
        self.step.dp.fill(0.0);
        loop {
            let free: Vec<usize> = (0..unknown).filter(|&i| !fixed[i]).collect();
            self.free.clear();
            for row in self.reduced.finished().chunks_exact(width) {
                let known = (0..unknown).filter(|&i| fixed[i]);
                let known: f64 = known.map(|i| row[i] * self.step.dp[i]).sum();
                let to = self.free.push();
                to[..free.len()].iter_mut().zip(&free).for_each(|(to, &i)| *to = row[i]);
                to[free.len()] = row[unknown] + known;
            }
            for (place, &i) in free.iter().enumerate() {
                self.free.push()[place] = root * weight(self.lengths[i]);
            }
            let factor = self.free.factor();
            let mut c: Vec<f64> =
                (0..free.len()).map(|row| factor[row * width + free.len()]).collect();
            solve(factor, width, free.len(), &mut c);
            let mut beyond = false;
            for (&i, dp) in free.iter().zip(&c) {
                let of = &problem.unknown[i];
                let (low, high) = (of.low - p[of.place], of.high - p[of.place]);
                fixed[i] = *dp < low || *dp > high;
                self.step.dp[i] = dp.max(low).min(high);
                beyond |= fixed[i];
            }
            if !beyond {
                break;
            }
        }
    }

    /// The q that belong to the parameters, and the cost there.
    fn states(&mut self, recordings: &[Shooting<'_>]) {
        let Step { dp, q, cost } = &mut self.step;
        *cost = 0.0;
        let parts = recordings.iter().zip(&self.factors).zip(&self.damped).zip(q);
        for (((of, factor), damped), q) in parts {
            let (width, nq) = (of.triangle.width(), of.nq);
            let constant = |row: &[f64]| -> f64 {
                row[width - 1] + row[nq..].iter().zip(&*dp).map(|(j, dp)| j * dp).sum::<f64>()
            };
            for (q, row) in q.iter_mut().zip(damped.finished().chunks_exact(width)) {
                *q = constant(row);
            }
            solve(damped.finished(), width, nq, q);
            for row in factor.chunks_exact(width) {
                let by_q: f64 = row[..nq].iter().zip(&*q).map(|(r, q)| r * q).sum();
                *cost += 0.5 * (by_q + constant(row)).powi(2);
            }
        }
    }
}

/// What the priors add to the cost after a step.
fn prior_cost(problem: &Problem, p: &[f64], dp: &[f64]) -> f64 {
    let residuals = problem.unknown.iter().zip(dp);
    let residuals = residuals.filter_map(|(of, dp)| Some(of.prior?.residual(p[of.place] + dp)));
    residuals.map(|residual| 0.5 * residual * residual).sum()
}

/// The damping of a column; some for one that is 0, so that its unknown stays where it is.
fn weight(length: f64) -> f64 {
    if length > 0.0 { length } else { 1.0 }
}
