//! The training on plans and their derivatives.

use crate::net::{Net, Pass};
use crate::policy::Scale;
use crate::samples::Label;
use pinc_net::Workers;
use pinc_net::optim::{
    AutoConfig, Iterate, LeastSquares, Objective, Optimizer, OptimizerConfig, Outcome,
};
use rayon::prelude::*;

/// How much a derivative counts beside a value.
const SLOPE_WEIGHT: f64 = 0.1;

/// Labels that one thread takes at a time; sums are formed in the order of these blocks.
const BLOCK: usize = 64;

/// A label as the net sees it.
#[derive(Debug)]
struct Target {
    at: Vec<f64>,
    direction: Vec<f64>,
    plan: Vec<f64>,
    slope: Vec<f64>,
    /// What the errors of the derivatives count.
    slope_weights: Vec<f64>,
    sides: Vec<i8>,
}

/// The mean over labels of
///
/// ```text
/// sum_i (N_i - u_i)^2 + 0.1 (dN_i - du_i)^2
/// ```
///
/// in units in which the plans go from -1 to 1. An input at its bound is met by any value beyond
/// it, since plans are moved into their bounds, and has no derivative to be met.
#[derive(Debug)]
pub(crate) struct Loss<'a> {
    net: &'a Net,
    targets: Vec<Target>,
}

impl<'a> Loss<'a> {
    pub(crate) fn new(net: &'a Net, labels: &[Label], [inputs, outputs]: [&Scale; 2]) -> Self {
        let target = |label: &Label| {
            let per_half = |values: &[f64], scale: &Scale| -> Vec<f64> {
                values.iter().zip(&scale.half).map(|(value, half)| value / half).collect()
            };
            let free = |side: &i8| f64::from(u8::from(*side == 0 && label.slope.is_some()));
            Target {
                at: inputs.scaled(&label.at),
                direction: per_half(&label.direction, inputs),
                plan: outputs.scaled(&label.plan),
                slope: match &label.slope {
                    Some(slope) => per_half(slope, outputs),
                    None => vec![0.0; label.plan.len()],
                },
                slope_weights: label.sides.iter().map(|side| SLOPE_WEIGHT * free(side)).collect(),
                sides: label.sides.clone(),
            }
        };
        Self { net, targets: labels.iter().map(target).collect() }
    }

    /// The errors of values and derivatives where the net was evaluated.
    fn errors(target: &Target, pass: &Pass, errors: [&mut [f64]; 2]) {
        let [values, slopes] = errors;
        for (i, error) in values.iter_mut().enumerate() {
            let left = pass.outputs()[i] - target.plan[i];
            *error = match target.sides[i] {
                -1 => left.max(0.0),
                1 => left.min(0.0),
                _ => left,
            };
            slopes[i] = pass.slopes()[i] - target.slope[i];
        }
    }

    fn block(&self, targets: &[Target], x: &[f64]) -> (f64, Vec<f64>) {
        let (mut pass, outputs) = (self.net.pass(), targets[0].plan.len());
        let (mut sum, mut gradient) = (0.0, vec![0.0; x.len()]);
        let (mut values, mut slopes) = (vec![0.0; outputs], vec![0.0; outputs]);
        for target in targets {
            self.net.forward(x, [&target.at, &target.direction], &mut pass);
            Self::errors(target, &pass, [&mut values, &mut slopes]);
            for (i, weight) in target.slope_weights.iter().enumerate() {
                sum += values[i] * values[i] + weight * slopes[i] * slopes[i];
                values[i] *= 2.0;
                slopes[i] *= 2.0 * weight;
            }
            self.net.backward(x, [&values, &slopes], &mut pass, &mut gradient);
        }
        (sum, gradient)
    }

    #[expect(clippy::cast_precision_loss, reason = "far below 2^53 labels")]
    fn count(&self) -> f64 {
        self.targets.len() as f64
    }
}

impl Objective for Loss<'_> {
    fn evaluate(&mut self, x: &[f64], gradient: &mut [f64]) -> f64 {
        let blocks: Vec<_> =
            self.targets.par_chunks(BLOCK).map(|targets| self.block(targets, x)).collect();
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
        let mut pass = self.net.pass();
        for target in &self.targets {
            self.net.forward(x, [&target.at, &target.direction], &mut pass);
            let outputs = target.plan.len();
            let (mut values, mut slopes) = (vec![0.0; outputs], vec![0.0; outputs]);
            Self::errors(target, &pass, [&mut values, &mut slopes]);
            for row in 0..2 * outputs {
                let i = row % outputs;
                // An input beyond its bound has no error, and no derivative of one.
                let beyond = target.sides[i] != 0 && values[i].abs() <= 0.0;
                let weight = match row < outputs {
                    true => f64::from(u8::from(!beyond)),
                    false => target.slope_weights[i],
                };
                if weight <= 0.0 {
                    continue;
                }
                let mut units = [vec![0.0; outputs], vec![0.0; outputs]];
                units[row / outputs][i] = 1.0;
                let mut derivative = vec![0.0; size];
                self.net.forward(x, [&target.at, &target.direction], &mut pass);
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

/// Trains the net; `see` is told the iterations done and the loss. Returns the loss.
pub(crate) fn train(
    net: &mut Net,
    labels: &[Label],
    scales: [&Scale; 2],
    (iterations, workers): (usize, &Workers),
    see: &mut dyn FnMut(usize, f64),
) -> f64 {
    let start = net.weights.clone();
    let mut loss = Loss::new(net, labels, scales);
    let mut iterate = Iterate::new(&mut loss, start);
    let config = OptimizerConfig::Auto(AutoConfig::default());
    let mut optimizer = Optimizer::new(&config, iterate.x.len());
    for iteration in 0..iterations {
        if optimizer.step(&mut loss, &mut iterate, workers) != Outcome::Moved {
            break;
        }
        see(iteration + 1, iterate.value);
    }
    net.weights = iterate.x;
    iterate.value
}
