//! The training on plans and their derivatives.

use crate::net::Net;
use crate::policy::Scale;
use crate::samples::Label;
use crate::{ShrinkError, go_on};
use pinc_ad::simd::{Isa, Simd, Task};
use pinc_net::Workers;
use pinc_net::optim::{
    AutoConfig, Iterate, LeastSquares, Objective, Optimizer, OptimizerConfig, Outcome,
};
use rayon::prelude::*;
use std::ops::ControlFlow;

/// How much a derivative counts beside a value.
const SLOPE_WEIGHT: f64 = 0.1;

/// How much the inputs after the first of a plan count beside that, which is the one applied.
const LATER_WEIGHT: f64 = 0.3;

/// Labels that one thread takes at a time; sums are formed in the order of these blocks.
const BLOCK: usize = 256;

/// A label as the net sees it.
#[derive(Debug)]
struct Target {
    at: Vec<f64>,
    direction: Vec<f64>,
    plan: Vec<f64>,
    slope: Vec<f64>,
    /// How much the errors of the derivatives count, beside the errors of the values.
    slope_weights: Vec<f64>,
    /// How much errors count: below the plan's value, and above it.
    weights: [Vec<f64>; 2],
}

/// The mean over labels of
///
/// ```text
/// sum_i w_i ((N_i - u_i)^2 + 0.1 (dN_i - du_i)^2)
/// ```
///
/// in units in which the plans go from -1 to 1; w is 1 for the first input of a plan and 0.3 for the
/// others. An input at its bound is met by any value beyond it, since plans are moved into their
/// bounds, and has no derivative to be met.
#[derive(Debug)]
pub(crate) struct Loss<'a> {
    net: &'a Net,
    targets: Vec<Target>,
    isa: Isa,
}

impl<'a> Loss<'a> {
    /// The loss on labels of plans of `m` inputs each.
    pub(crate) fn new(
        (net, m, isa): (&'a Net, usize, Isa),
        labels: &[Label],
        [inputs, outputs]: [&Scale; 2],
    ) -> Self {
        let target = |label: &Label| {
            let per_half = |values: &[f64], scale: &Scale| -> Vec<f64> {
                values.iter().zip(&scale.half).map(|(value, half)| value / half).collect()
            };
            let weight = |i: usize| if i < m { 1.0 } else { LATER_WEIGHT };
            let weights = |open: i8| -> Vec<f64> {
                let sides = label.sides.iter().enumerate();
                sides.map(|(i, side)| if *side == open { 0.0 } else { weight(i) }).collect()
            };
            let free = |side: i8| f64::from(u8::from(side == 0 && label.slope.is_some()));
            let sides = label.sides.iter().enumerate();
            Target {
                at: inputs.scaled(&label.at),
                direction: per_half(&label.direction, inputs),
                plan: outputs.scaled(&label.plan),
                slope: match &label.slope {
                    Some(slope) => per_half(slope, outputs),
                    None => vec![0.0; label.plan.len()],
                },
                slope_weights: sides.map(|(i, s)| SLOPE_WEIGHT * weight(i) * free(*s)).collect(),
                weights: [weights(-1), weights(1)],
            }
        };
        Self { net, targets: labels.iter().map(target).collect(), isa }
    }

    fn count(&self) -> f64 {
        self.targets.len() as f64
    }
}

/// The loss of a block of targets and its gradient, several targets side by side.
struct Block<'a> {
    net: &'a Net,
    targets: &'a [Target],
    x: &'a [f64],
}

impl Task for Block<'_> {
    type Output = (f64, Vec<f64>);

    #[inline(always)]
    fn run<V: Simd>(self, zero: V) -> Self::Output {
        let Self { net, targets, x } = self;
        let (mut pass, outputs) = (net.pass(zero), targets[0].plan.len());
        let (mut sum, mut gradient) = (zero, vec![zero; x.len()]);
        let mut at = [vec![zero; targets[0].at.len()], vec![zero; targets[0].at.len()]];
        let mut errors = [vec![zero; outputs], vec![zero; outputs]];
        for side_by_side in targets.chunks(V::LANES) {
            // Lanes without a target repeat the first, and count nothing.
            let lane = |l: usize| side_by_side.get(l).unwrap_or(&side_by_side[0]);
            let used = zero.generate(|l| f64::from(u8::from(l < side_by_side.len())));
            let [points, directions] = &mut at;
            for (i, (point, direction)) in points.iter_mut().zip(directions).enumerate() {
                *point = zero.generate(|l| lane(l).at[i]);
                *direction = zero.generate(|l| lane(l).direction[i]);
            }
            net.forward(x, [&at[0], &at[1]], &mut pass);
            let [by_values, by_slopes] = &mut errors;
            for (i, (by_value, by_slope)) in by_values.iter_mut().zip(by_slopes).enumerate() {
                let left = pass.outputs()[i] - zero.generate(|l| lane(l).plan[i]);
                let [below, above] = [0, 1].map(|s| zero.generate(|l| lane(l).weights[s][i]));
                let weight = left.where_nonpositive(below, above) * used;
                let slope = pass.slopes()[i] - zero.generate(|l| lane(l).slope[i]);
                let slope_weight = zero.generate(|l| lane(l).slope_weights[i]) * used;
                sum = sum + weight * left * left + slope_weight * slope * slope;
                *by_value = weight * left * 2.0;
                *by_slope = slope_weight * slope * 2.0;
            }
            net.backward(x, [&errors[0], &errors[1]], &mut pass, &mut gradient);
        }
        (sum.sum(), gradient.into_iter().map(Simd::sum).collect())
    }
}

impl Objective for Loss<'_> {
    fn evaluate(&mut self, x: &[f64], gradient: &mut [f64]) -> f64 {
        let block = |targets| self.isa.dispatch(Block { net: self.net, targets, x });
        let blocks: Vec<_> = self.targets.par_chunks(BLOCK).map(block).collect();
        let count = self.count();
        gradient.fill(0.0);
        let mut value = 0.0;
        for (sum, part) in blocks {
            value += sum / count;
            gradient.iter_mut().zip(part).for_each(|(total, part)| *total += part / count);
        }
        value
    }
}

impl LeastSquares for Loss<'_> {
    fn normal_matrix(&mut self, x: &[f64], out: &mut [f64]) {
        let (size, count) = (x.len(), self.count());
        out.fill(0.0);
        let mut pass = self.net.pass(0.0);
        for target in &self.targets {
            self.net.forward(x, [&target.at, &target.direction], &mut pass);
            let outputs = target.plan.len();
            let left = pass.outputs().iter().zip(&target.plan).map(|(output, u)| output - u);
            let side = left.map(|left| usize::from(left > 0.0)).enumerate();
            let values: Vec<f64> = side.map(|(i, side)| target.weights[side][i]).collect();
            for (row, weight) in values.iter().chain(&target.slope_weights).enumerate() {
                if *weight <= 0.0 {
                    continue;
                }
                let mut units = [vec![0.0; outputs], vec![0.0; outputs]];
                units[row / outputs][row % outputs] = 1.0;
                let mut derivative = vec![0.0; size];
                self.net.backward(x, [&units[0], &units[1]], &mut pass, &mut derivative);
                for (j, column) in out.chunks_exact_mut(size).enumerate() {
                    let factor = weight * derivative[j] / count;
                    let below = column[j..].iter_mut().zip(&derivative[j..]);
                    below.for_each(|(sum, value)| *sum += factor * value);
                }
            }
        }
    }
}

/// The training of a net on plans, which may become more.
pub(crate) struct Training {
    optimizer: Optimizer,
}

impl Training {
    /// The training of a net with so many weights.
    pub(crate) fn new(weights: usize) -> Self {
        let config = OptimizerConfig::Auto(AutoConfig::default());
        Self { optimizer: Optimizer::new(&config, weights) }
    }

    /// Trains on plans of `m` inputs each; `see` is told the iterations done and the loss. What was
    /// learnt of the curvature is used the next time. Returns the loss.
    ///
    /// # Errors
    ///
    /// [`ShrinkError::Stopped`] if `see` breaks off.
    pub(crate) fn run(
        &mut self,
        (net, m): (&mut Net, usize),
        labels: &[Label],
        scales: [&Scale; 2],
        (iterations, workers): (usize, &Workers),
        see: &mut dyn FnMut(usize, f64) -> ControlFlow<()>,
    ) -> Result<f64, ShrinkError> {
        let start = net.weights.clone();
        let mut loss = Loss::new((net, m, workers.isa()), labels, scales);
        let mut iterate = Iterate::new(&mut loss, start);
        self.optimizer.refresh(&iterate, workers);
        for iteration in 0..iterations {
            if self.optimizer.step(&mut loss, &mut iterate, workers) != Outcome::Moved {
                break;
            }
            go_on(see(iteration + 1, iterate.value))?;
        }
        net.weights = iterate.x;
        Ok(iterate.value)
    }
}
