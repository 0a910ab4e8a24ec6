//! A net that plans.

use crate::ShrinkError;
use crate::net::{Net, Pass};
use pinc_mpc::{Bounds, Nmpc, NmpcProblem};
use pinc_ode::Dims;
use serde::{Deserialize, Serialize};

/// A net in place of a controller: from the state, the values to follow and the input applied last
/// to a plan's inputs, `[Nu, m]`, which are moved into their bounds.
#[derive(Clone, Debug)]
pub struct Policy {
    pub(crate) net: PolicyNet,
    pub(crate) limits: Limits,
    pass: Pass<f64>,
    at: Vec<f64>,
    along: Vec<f64>,
}

/// The numbers of a [`Policy`], to be kept in a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PolicyNet {
    pub(crate) layers: Net,
    pub(crate) inputs: Scale,
    pub(crate) outputs: Scale,
    /// Where steps of the controller's model lead: see [`model_steps`].
    pub(crate) steps: Vec<f64>,
}

/// How far a step of the same model may lead elsewhere, in half widths of the states, and how far outputs
/// may be off: vectors of other machines round differently.
const SAME_STEP: f64 = 1e-8;

/// Where one step of the model leads from two points amid the inputs of a net, and its outputs there if
/// the controller has any, `[2, n + ny]`, by which a model of another equation or accuracy is told apart;
/// empty where it has no value.
pub(crate) fn model_steps(nmpc: &mut Nmpc, inputs: &Scale) -> Vec<f64> {
    let (dims, looks) = (nmpc.model().dims(), nmpc.problem().uses_outputs());
    let mut program = nmpc.program();
    let (model, p) = program.model(0);
    let width = dims.nx + if looks { dims.ny } else { 0 };
    let mut next = vec![0.0; 2 * width];
    for (next, part) in next.chunks_exact_mut(width).zip([-0.5, 0.5]) {
        let parts = inputs.middle.iter().zip(&inputs.half);
        let at: Vec<f64> = parts.map(|(middle, half)| middle + part * half).collect();
        let (x, u) = (&at[..dims.nx], &at[at.len() - dims.nu..]);
        let (next, y) = next.split_at_mut(dims.nx);
        model.step(x, u, p, next);
        if looks {
            model.output(x, u, p, y);
        }
    }
    if next.iter().all(|x| x.is_finite()) { next } else { Vec::new() }
}

/// Numbers as middle + half width * (a number about -1 to 1).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
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

impl PolicyNet {
    /// Checks that the net is in place of a controller with so many numbers in and out.
    ///
    /// # Errors
    ///
    /// [`ShrinkError::Sizes`] if the net is not of these sizes, or damaged.
    pub fn check(&self, inputs: usize, outputs: usize) -> Result<(), ShrinkError> {
        match self.is_sound(inputs, outputs) {
            true => Ok(()),
            false => Err(ShrinkError::Sizes { inputs, outputs }),
        }
    }

    /// Checks that the controller plans with the model that the net's plans were made with.
    pub(crate) fn check_model(&self, nmpc: &mut Nmpc) -> Result<(), ShrinkError> {
        let steps = model_steps(nmpc, &self.inputs);
        let (width, halves) = (steps.len() / 2, &self.inputs.half[..nmpc.model().dims().nx]);
        let is_near = |(i, (a, b)): (usize, (&f64, &f64))| {
            // Of outputs there are no widths.
            let half = halves.get(i % width).copied().unwrap_or(1.0);
            (a - b).abs() <= SAME_STEP * (half + a.abs())
        };
        let same = steps.len() == self.steps.len()
            && steps.iter().zip(&self.steps).enumerate().all(is_near);
        if same { Ok(()) } else { Err(ShrinkError::Model) }
    }

    /// Whether the numbers are finite and as many as the sizes ask for.
    fn is_sound(&self, inputs: usize, outputs: usize) -> bool {
        let Self { layers: Net { widths, weights }, inputs: from, outputs: to, steps } = self;
        let ends = [(from, inputs, widths.first()), (to, outputs, widths.last())];
        let fits = |(scale, count, width): (&Scale, usize, Option<&usize>)| {
            [scale.middle.len(), scale.half.len()] == [count; 2] && width == Some(&count)
        };
        let pairs = widths.windows(2).map(|pair| (pair[0] + 1).saturating_mul(pair[1]));
        let scales = [&from.middle, &from.half, &to.middle, &to.half];
        widths.len() > 1
            && ends.into_iter().all(fits)
            && weights.len() == pairs.fold(0, usize::saturating_add)
            && scales.into_iter().chain([weights, steps]).flatten().all(|value| value.is_finite())
    }
}

impl Policy {
    /// A net in place of the controller `nmpc`.
    ///
    /// # Errors
    ///
    /// See [`PolicyNet::check`].
    pub fn new(net: PolicyNet, nmpc: &Nmpc) -> Result<Self, ShrinkError> {
        let (problem, dims) = (nmpc.problem(), nmpc.model().dims());
        let inputs = dims.nx + problem.tracked.len() + dims.nu;
        net.check(inputs, problem.control_horizon * dims.nu)?;
        Ok(Self::of(net, Limits::new(problem, dims)))
    }

    pub(crate) fn of(net: PolicyNet, limits: Limits) -> Self {
        let width = net.layers.widths[0];
        let (at, along) = (vec![0.0; width], vec![0.0; width]);
        Self { pass: net.layers.pass(0.0), net, limits, at, along }
    }

    /// Returns the numbers to be kept.
    #[must_use]
    pub fn net(&self) -> &PolicyNet {
        &self.net
    }

    /// Returns the number of weights and biases.
    #[must_use]
    pub fn weights(&self) -> usize {
        self.net.layers.weights.len()
    }

    /// Writes the net's plan, moved into its bounds, to `plan`, `[Nu, m]`.
    pub fn plan(&mut self, x: &[f64], reference: &[f64], u_before: &[f64], plan: &mut [f64]) {
        let Self { net: PolicyNet { layers, inputs, outputs, .. }, limits, pass, at, along } = self;
        let v = x.iter().chain(reference).chain(u_before);
        let scale = inputs.middle.iter().zip(&inputs.half);
        for (to, (value, (middle, half))) in at.iter_mut().zip(v.zip(scale)) {
            *to = (value - middle) / half;
        }
        layers.forward(&layers.weights, [at, along], pass);
        let scale = outputs.middle.iter().zip(&outputs.half);
        for (to, (y, (middle, half))) in plan.iter_mut().zip(pass.outputs().iter().zip(scale)) {
            *to = middle + half * y;
        }
        limits.project(u_before, plan);
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
