//! Limited-memory BFGS.

use super::{Iterate, LineSearch, Objective, Outcome, check, dot};
use crate::NetError;
use crate::mlp::to_f64;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Settings of limited-memory BFGS: Nocedal and Wright, *Numerical Optimization*, Algorithms 7.4 and 7.5.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LbfgsConfig {
    /// Pairs of steps and gradient changes remembered.
    #[serde(default = "default_memory")]
    pub memory: usize,
    /// How the step length is chosen.
    #[serde(default = "default_line_search")]
    pub line_search: LineSearch,
    /// Stop when the norm of the gradient falls below this.
    #[serde(default = "default_gradient_tolerance")]
    pub gradient_tolerance: f64,
}

fn default_memory() -> usize {
    10
}

fn default_line_search() -> LineSearch {
    LineSearch::HagerZhang
}

pub(super) fn default_gradient_tolerance() -> f64 {
    1e-14
}

impl LbfgsConfig {
    pub(super) fn validate(&self) -> Result<(), NetError> {
        check("memory", to_f64(self.memory), |v| v > 0.0, "at least 1")?;
        let tolerance = self.gradient_tolerance;
        check("gradient_tolerance", tolerance, |v| v >= 0.0, "a number that is not negative")
    }
}

/// A step s, the change y of the gradient along it, and 1/(s'y).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Pair {
    s: Vec<f64>,
    y: Vec<f64>,
    rho: f64,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Lbfgs {
    config: LbfgsConfig,
    pairs: VecDeque<Pair>,
}

impl Lbfgs {
    pub(super) fn new(config: &LbfgsConfig) -> Self {
        Self { config: config.clone(), pairs: VecDeque::with_capacity(config.memory + 1) }
    }

    pub(super) fn step(&mut self, objective: &mut impl Objective, at: &mut Iterate) -> Outcome {
        let norm = at.gradient_norm();
        if norm <= self.config.gradient_tolerance {
            return Outcome::Converged;
        }
        let mut next = at.clone();
        let search = self.config.line_search;
        let mut found = None;
        if !self.pairs.is_empty() {
            found = search.search(objective, at, &self.direction(&at.gradient), 1.0, &mut next);
        }
        if found.is_none() {
            // Nothing learnt yet, or what was learnt misleads: steepest descent, one unit long.
            self.pairs.clear();
            let direction: Vec<f64> = at.gradient.iter().map(|g| -g).collect();
            found = search.search(objective, at, &direction, 1.0 / norm.max(1.0), &mut next);
        }
        if found.is_none() {
            return Outcome::Stuck;
        }
        self.learn(at, &next);
        std::mem::swap(at, &mut next);
        Outcome::Moved
    }

    /// - H g by the two-loop recursion, with `H_0` = (s'y / y'y) I of the last pair.
    fn direction(&self, gradient: &[f64]) -> Vec<f64> {
        let mut q = gradient.to_vec();
        let mut alphas = Vec::with_capacity(self.pairs.len());
        for Pair { s, y, rho } in self.pairs.iter().rev() {
            let alpha = rho * dot(s, &q);
            add(&mut q, -alpha, y);
            alphas.push(alpha);
        }
        if let Some(Pair { y, rho, .. }) = self.pairs.back() {
            let scale = 1.0 / (rho * dot(y, y));
            q.iter_mut().for_each(|q| *q *= scale);
        }
        for (Pair { s, y, rho }, alpha) in self.pairs.iter().zip(alphas.iter().rev()) {
            let beta = rho * dot(y, &q);
            add(&mut q, alpha - beta, s);
        }
        q.iter_mut().for_each(|q| *q = -*q);
        q
    }

    fn learn(&mut self, from: &Iterate, to: &Iterate) {
        // The oldest pair's memory is used again.
        let full = self.pairs.len() >= self.config.memory;
        let mut pair = if full { self.pairs.pop_front() } else { None }.unwrap_or_default();
        let difference = |into: &mut Vec<f64>, a: &[f64], b: &[f64]| {
            into.clear();
            into.extend(a.iter().zip(b).map(|(a, b)| a - b));
        };
        difference(&mut pair.s, &to.x, &from.x);
        difference(&mut pair.y, &to.gradient, &from.gradient);
        let curvature = dot(&pair.s, &pair.y);
        if curvature > 0.0 {
            pair.rho = 1.0 / curvature;
            self.pairs.push_back(pair);
        }
    }
}

/// a += factor b
fn add(a: &mut [f64], factor: f64, b: &[f64]) {
    for (a, b) in a.iter_mut().zip(b) {
        *a += factor * b;
    }
}
