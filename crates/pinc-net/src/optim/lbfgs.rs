//! Limited-memory BFGS.

use super::{
    GRADIENT_TOLERANCE, Iterate, LineSearch, Objective, Outcome, Scratch, check_gradient_tolerance,
    dot, norm, set,
};
use crate::NetError;
use crate::error::check_count;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Settings of limited-memory BFGS: Nocedal and Wright, *Numerical Optimization*, Algorithms 7.4
/// and 7.5.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LbfgsConfig {
    /// Number of stored pairs (step, change of the gradient).
    pub memory: usize,
    /// How the step length is chosen.
    pub line_search: LineSearch,
    /// Norm of the gradient below which the optimizer stops.
    pub gradient_tolerance: f64,
}

impl Default for LbfgsConfig {
    fn default() -> Self {
        let (line_search, gradient_tolerance) = (LineSearch::HagerZhang, GRADIENT_TOLERANCE);
        Self { memory: 10, line_search, gradient_tolerance }
    }
}

impl LbfgsConfig {
    pub(super) fn validate(&self) -> Result<(), NetError> {
        check_count("memory", self.memory)?;
        check_gradient_tolerance(self.gradient_tolerance)
    }
}

/// A step s, the change y of the gradient along it, and 1/(s'y).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct CurvaturePair {
    s: Vec<f64>,
    y: Vec<f64>,
    rho: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Lbfgs {
    config: LbfgsConfig,
    pairs: VecDeque<CurvaturePair>,
    #[serde(skip)]
    buffers: Scratch<Buffers>,
}

/// Memory of a step.
#[derive(Debug, Default)]
struct Buffers {
    next: Iterate,
    direction: Vec<f64>,
    alphas: Vec<f64>,
    /// Pairs for reuse.
    spare: Vec<CurvaturePair>,
}

impl Lbfgs {
    pub(super) fn new(config: &LbfgsConfig) -> Self {
        let pairs = VecDeque::with_capacity(config.memory + 1);
        Self { config: config.clone(), pairs, buffers: Scratch::default() }
    }

    pub(super) fn step(&mut self, objective: &mut impl Objective, at: &mut Iterate) -> Outcome {
        let norm = at.gradient_norm();
        if norm <= self.config.gradient_tolerance {
            return Outcome::Converged;
        }
        let Buffers { next, direction, alphas, spare } = &mut self.buffers.0;
        next.resize(at.x.len());
        let search = self.config.line_search;
        let mut found = None;
        if !self.pairs.is_empty() {
            newton(&self.pairs, &at.gradient, direction, alphas);
            found = search.search(objective, at, direction, 1.0, next);
        }
        if found.is_none() {
            // No pairs yet, or their direction is no descent: steepest descent, one unit long.
            spare.extend(self.pairs.drain(..));
            set(direction, at.gradient.iter().map(|g| -g));
            found = search.search(objective, at, direction, 1.0 / norm.max(1.0), next);
        }
        if found.is_none() {
            return Outcome::Stuck;
        }
        std::mem::swap(at, next);
        self.update(at);
        Outcome::Moved
    }

    /// Stores the step to `to`. The point before it is in the buffer of the next point.
    fn update(&mut self, to: &Iterate) {
        let Buffers { next: from, spare, .. } = &mut self.buffers.0;
        // The memory of the oldest pair is reused.
        let full = self.pairs.len() >= self.config.memory;
        let oldest = if full { self.pairs.pop_front() } else { None };
        let mut pair = oldest.or_else(|| spare.pop()).unwrap_or_default();
        set(&mut pair.s, to.x.iter().zip(&from.x).map(|(to, from)| to - from));
        set(&mut pair.y, to.gradient.iter().zip(&from.gradient).map(|(to, from)| to - from));
        let curvature = dot(&pair.s, &pair.y);
        // Below this, s'y is rounding, and so would be the directions that 1/(s'y) leads to.
        if curvature > f64::EPSILON * norm(&pair.s) * norm(&pair.y) {
            pair.rho = 1.0 / curvature;
            self.pairs.push_back(pair);
        } else {
            spare.push(pair);
        }
    }
}

/// `q` = - H g by the two-loop recursion, with `H_0` = (s'y / y'y) I of the last pair.
fn newton(
    pairs: &VecDeque<CurvaturePair>,
    gradient: &[f64],
    q: &mut Vec<f64>,
    alphas: &mut Vec<f64>,
) {
    set(q, gradient.iter().copied());
    alphas.clear();
    for CurvaturePair { s, y, rho } in pairs.iter().rev() {
        let alpha = rho * dot(s, q);
        add(q, -alpha, y);
        alphas.push(alpha);
    }
    if let Some(CurvaturePair { y, rho, .. }) = pairs.back() {
        let scale = 1.0 / (rho * dot(y, y));
        q.iter_mut().for_each(|q| *q *= scale);
    }
    for (CurvaturePair { s, y, rho }, alpha) in pairs.iter().zip(alphas.iter().rev()) {
        let beta = rho * dot(y, q);
        add(q, alpha - beta, s);
    }
    q.iter_mut().for_each(|q| *q = -*q);
}

/// a += factor b
fn add(a: &mut [f64], factor: f64, b: &[f64]) {
    for (a, b) in a.iter_mut().zip(b) {
        *a += factor * b;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The number of pairs stored after a step s along which the gradient changes by y.
    fn remembered(s: [f64; 2], y: [f64; 2]) -> usize {
        let mut lbfgs = Lbfgs::new(&LbfgsConfig::default());
        lbfgs.buffers.0.next = Iterate { x: vec![0.0; 2], value: 0.0, gradient: vec![0.0; 2] };
        lbfgs.update(&Iterate { x: s.to_vec(), value: 0.0, gradient: y.to_vec() });
        lbfgs.pairs.len()
    }

    #[test]
    fn the_latest_pairs_are_kept() {
        let mut lbfgs = Lbfgs::new(&LbfgsConfig { memory: 3, ..LbfgsConfig::default() });
        for k in 1..=5 {
            let x = vec![f64::from(k)];
            lbfgs.buffers.0.next = Iterate { x: vec![0.0], value: 0.0, gradient: vec![0.0] };
            lbfgs.update(&Iterate { gradient: x.clone(), x, value: 0.0 });
        }
        let steps: Vec<_> = lbfgs.pairs.iter().map(|pair| pair.s[0].to_bits()).collect();
        assert_eq!(steps, [3.0_f64, 4.0, 5.0].map(f64::to_bits));
    }

    /// A slope with the points where it was evaluated.
    struct Slope(f64, Vec<f64>);

    impl Objective for Slope {
        fn evaluate(&mut self, x: &[f64], gradient: &mut [f64]) -> f64 {
            self.1.push(x[0]);
            gradient[0] = self.0;
            self.0 * x[0]
        }
    }

    #[test]
    fn the_first_step_is_the_gradient_but_one_unit_long_at_most() {
        for (slope, first) in [(0.25, -0.25), (1.0, -1.0), (8.0, -1.0)] {
            let mut slope = Slope(slope, Vec::new());
            let mut at = Iterate::new(&mut slope, vec![0.0]);
            Lbfgs::new(&LbfgsConfig::default()).step(&mut slope, &mut at);
            assert_eq!(slope.1[1].to_bits(), f64::to_bits(first));
        }
    }

    #[test]
    fn a_pair_whose_curvature_is_rounding_is_not_remembered() {
        assert_eq!(remembered([1.0, 0.0], [1.0, 0.0]), 1);
        // Small numbers as such do not matter.
        assert_eq!(remembered([1e-30, 0.0], [1e-30, 0.0]), 1);
        assert_eq!(remembered([1.0, 0.0], [1e-12, 1.0]), 1);
        // cos(s, y) = 1e-17, 0 and below.
        assert_eq!(remembered([1.0, 0.0], [1e-17, 1.0]), 0);
        assert_eq!(remembered([1e20, 0.0], [1e3, 1e20]), 0);
        assert_eq!(remembered([1.0, 0.0], [0.0, 1.0]), 0);
        assert_eq!(remembered([1.0, 0.0], [-1.0, 0.0]), 0);
        assert_eq!(remembered([0.0, 0.0], [0.0, 0.0]), 0);
    }
}
