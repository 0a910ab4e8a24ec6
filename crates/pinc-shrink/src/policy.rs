//! A net that plans.

use crate::net::{Net, Pass};
use pinc_mpc::{Bounds, NmpcProblem};
use pinc_ode::Dims;

/// A net in place of a controller: from the state, the values to follow and the input applied last
/// to a plan's inputs, `[Nu, m]`, which are moved into their bounds.
#[derive(Clone, Debug)]
pub struct Policy {
    pub(crate) net: Net,
    pub(crate) inputs: Scale,
    pub(crate) outputs: Scale,
    pub(crate) limits: Limits,
    pass: Pass<f64>,
    at: Vec<f64>,
    along: Vec<f64>,
}

/// Numbers as middle + half width * (a number about -1 to 1).
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Scale {
    pub(crate) middle: Vec<f64>,
    pub(crate) half: Vec<f64>,
}

/// The bounds on inputs and increments, `[Nu, m]` each.
#[derive(Clone, Debug)]
pub(crate) struct Limits {
    pub(crate) bounds: Bounds,
    pub(crate) increments: Bounds,
}

impl Scale {
    /// The scale of rows of numbers, by their least and largest.
    pub(crate) fn of<'a>(rows: impl Iterator<Item = &'a [f64]>) -> Self {
        let mut ends: Vec<[f64; 2]> = Vec::new();
        for row in rows {
            ends.resize(row.len(), [f64::INFINITY, f64::NEG_INFINITY]);
            for (end, value) in ends.iter_mut().zip(row) {
                *end = [end[0].min(*value), end[1].max(*value)];
            }
        }
        let half = |[low, high]: &[f64; 2]| if high > low { 0.5 * (high - low) } else { 1.0 };
        Self {
            middle: ends.iter().map(|[low, high]| 0.5 * (low + high)).collect(),
            half: ends.iter().map(half).collect(),
        }
    }

    pub(crate) fn scaled(&self, values: &[f64]) -> Vec<f64> {
        let parts = values.iter().zip(self.middle.iter().zip(&self.half));
        parts.map(|(value, (middle, half))| (value - middle) / half).collect()
    }
}

impl Limits {
    pub(crate) fn new(problem: &NmpcProblem, dims: Dims) -> Self {
        let count = problem.control_horizon * dims.nu;
        let all = |bounds: &Bounds| {
            let side = |side: &[f64]| side.iter().cycle().take(count).copied().collect();
            Bounds::new(side(&bounds.low), side(&bounds.high))
        };
        Self { bounds: all(&problem.input_bounds), increments: all(&problem.increment_bounds) }
    }

    /// Moves a plan into the bounds. From outside them an input may go as far as to the nearest.
    pub(crate) fn project(&self, u_before: &[f64], plan: &mut [f64]) {
        let m = u_before.len();
        let Self { bounds, increments } = self;
        for v in 0..plan.len() {
            let before = if v < m { u_before[v] } else { plan[v - m] };
            let low = (before + increments.low[v]).min(bounds.high[v]);
            let high = (before + increments.high[v]).max(bounds.low[v]);
            plan[v] = plan[v].max(low).min(high).max(bounds.low[v]).min(bounds.high[v]);
        }
    }
}

impl Policy {
    pub(crate) fn new(net: Net, inputs: Scale, outputs: Scale, limits: Limits) -> Self {
        let width = net.widths[0];
        let (at, along) = (vec![0.0; width], vec![0.0; width]);
        Self { pass: net.pass(0.0), net, inputs, outputs, limits, at, along }
    }

    /// Returns the number of weights and biases.
    #[must_use]
    pub fn weights(&self) -> usize {
        self.net.weights.len()
    }

    /// Writes the net's plan, moved into its bounds, to `plan`, `[Nu, m]`.
    pub fn plan(&mut self, x: &[f64], reference: &[f64], u_before: &[f64], plan: &mut [f64]) {
        let v = x.iter().chain(reference).chain(u_before);
        let scale = self.inputs.middle.iter().zip(&self.inputs.half);
        for (to, (value, (middle, half))) in self.at.iter_mut().zip(v.zip(scale)) {
            *to = (value - middle) / half;
        }
        self.net.forward(&self.net.weights, [&self.at, &self.along], &mut self.pass);
        let scale = self.outputs.middle.iter().zip(&self.outputs.half);
        for (to, (y, (middle, half))) in plan.iter_mut().zip(self.pass.outputs().iter().zip(scale))
        {
            *to = middle + half * y;
        }
        self.limits.project(u_before, plan);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn projected(u_before: &[f64], plan: &[f64]) -> Vec<f64> {
        let limits = Limits {
            bounds: Bounds::new(vec![-1.0; plan.len()], vec![1.0; plan.len()]),
            increments: Bounds::new(vec![-0.3; plan.len()], vec![0.3; plan.len()]),
        };
        let mut plan = plan.to_vec();
        limits.project(u_before, &mut plan);
        plan
    }

    #[test]
    fn each_input_of_a_plan_is_within_the_rates_from_the_one_before() {
        let near = |found: &[f64], expected: &[f64]| {
            let off = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(found.len() == expected.len() && off < 1e-12, "{found:?} {expected:?}");
        };
        near(&projected(&[0.0], &[1.0, 1.0, -1.0]), &[0.3, 0.6, 0.3]);
        // Two inputs, each from its own.
        near(&projected(&[0.0, 0.9], &[1.0, -1.0, 1.0, 2.0]), &[0.3, 0.6, 0.6, 0.9]);
        near(&projected(&[0.9], &[2.0, 2.0]), &[1.0, 1.0]);
        // From outside the bounds an input goes back to the nearest at once.
        near(&projected(&[2.0], &[0.0, 0.0]), &[1.0, 0.7]);
    }
}
