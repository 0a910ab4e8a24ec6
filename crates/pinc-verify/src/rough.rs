//! The error of a step in plain arithmetic: where large errors are, not how large they surely are.

use crate::map::Map;
use crate::problem::StepError;
use crate::rounding::to_f64;
use pinc_expr::{Instruction, Listing};
use pinc_net::FoldedNet;
use pinc_ode::Tableau;

/// Steps of the method of order 5 that stands for the exact solution.
const STEPS: usize = 64;

impl StepError {
    /// About what each state's error is at a point; 0 where that is no number.
    pub(crate) fn rough(&self, point: &[f64]) -> Vec<f64> {
        let listing = self.flow.equation.listing();
        let h = self.flow.sample_time_s / to_f64(STEPS);
        let truth = advance(listing, Tableau::DORMAND_PRINCE, h, STEPS, point);
        let found = match &self.map {
            Map::Net(net) => forward(net, point),
            Map::RungeKutta { equation, tableau, h, substeps } => {
                advance(equation.listing(), *tableau, *h, *substeps, point)
            }
        };
        let pairs = found.iter().zip(&truth);
        pairs.map(|(y, z)| (y - z).abs()).map(|e| if e.is_finite() { e } else { 0.0 }).collect()
    }
}

fn forward(net: &FoldedNet, point: &[f64]) -> Vec<f64> {
    let mut values = point.to_vec();
    for (i, layer) in net.layers.iter().enumerate() {
        let rows = layer.weights.iter().zip(&layer.bias);
        let sums =
            rows.map(|(row, b)| row.iter().zip(&values).map(|(w, v)| w * v).sum::<f64>() + b);
        let last = i + 1 == net.layers.len();
        values = sums.map(|z| if last { z } else { z.tanh() }).collect();
    }
    if net.adds_initial_state {
        values.iter_mut().zip(point).for_each(|(value, x)| *value += x);
    }
    values
}

/// The states after `steps` steps of `h` seconds.
fn advance(listing: &Listing, tableau: Tableau, h: f64, steps: usize, point: &[f64]) -> Vec<f64> {
    let n = listing.results.len();
    let mut variables = point.to_vec();
    let mut values = vec![0.0; listing.instructions.len()];
    let mut slopes = vec![vec![0.0; n]; tableau.rows().len()];
    for _ in 0..steps {
        let start = variables[..n].to_vec();
        for (stage, row) in tableau.rows().iter().enumerate() {
            for i in 0..n {
                let along: f64 = row.iter().zip(&slopes).map(|(a, k)| a * k[i]).sum();
                variables[i] = start[i] + h * along;
            }
            evaluate(listing, &variables, &mut values);
            for (slope, place) in slopes[stage].iter_mut().zip(&listing.results) {
                *slope = values[*place];
            }
        }
    }
    variables.truncate(n);
    variables
}

/// All values of a listing.
fn evaluate(listing: &Listing, variables: &[f64], values: &mut [f64]) {
    for (i, instruction) in listing.instructions.iter().enumerate() {
        values[i] = match *instruction {
            Instruction::Variable(index) => variables[index],
            Instruction::Constant(number) => number,
            Instruction::Add(a, b) => values[a] + values[b],
            Instruction::Sub(a, b) => values[a] - values[b],
            Instruction::Mul(a, b) => values[a] * values[b],
            Instruction::Div(a, b) => values[a] / values[b],
            Instruction::Min(a, b) => values[a].min(values[b]),
            Instruction::Max(a, b) => values[a].max(values[b]),
            Instruction::Where(a, b, c) => values[if values[a] <= 0.0 { b } else { c }],
            Instruction::Neg(a) => -values[a],
            Instruction::Power(a, p) => values[a].powf(p),
            Instruction::Function(function, a) => function.of(values[a]),
        };
    }
}
