//! The step of a model over boxes.

use crate::equation::Equation;
use crate::function::Smooth;
use crate::taylor::{Arithmetic, Taylor};
use pinc_net::FoldedNet;
use pinc_ode::Tableau;

/// A map from states, inputs and parameters to the states one step later.
#[derive(Clone, Debug)]
pub(crate) enum Map {
    Net(FoldedNet),
    RungeKutta { equation: Equation, tableau: Tableau, h: f64, substeps: usize },
}

impl Map {
    /// The states one step later.
    pub(crate) fn run(&self, over: &Arithmetic, variables: &[Taylor]) -> Vec<Taylor> {
        match self {
            Self::Net(net) => run_net(net, over, variables),
            Self::RungeKutta { equation, tableau, h, substeps } => {
                let mut variables = variables.to_vec();
                for _ in 0..*substeps {
                    runge_kutta_step(equation, *tableau, *h, over, &mut variables);
                }
                variables.truncate(equation.states());
                variables
            }
        }
    }
}

fn run_net(net: &FoldedNet, over: &Arithmetic, variables: &[Taylor]) -> Vec<Taylor> {
    let mut values = variables.to_vec();
    for (i, layer) in net.layers.iter().enumerate() {
        values = over.layer(&values, &layer.weights, &layer.bias);
        if i + 1 < net.layers.len() {
            values = values.iter().map(|z| over.compose(Smooth::Tanh, z)).collect();
        }
    }
    if net.adds_initial_state {
        values = values.iter().zip(variables).map(|(d, x)| over.add(d, x)).collect();
    }
    values
}

/// One substep of `h` seconds: replaces the states, the first of the variables.
fn runge_kutta_step(
    equation: &Equation,
    tableau: Tableau,
    h: f64,
    over: &Arithmetic,
    variables: &mut [Taylor],
) {
    let mut slopes: Vec<Vec<Taylor>> = Vec::new();
    let start = variables.to_vec();
    for row in tableau.rows() {
        for i in 0..equation.states() {
            let mut terms = vec![&start[i]];
            terms.extend(slopes.iter().map(|slope| &slope[i]));
            let mut factors = vec![1.0];
            factors.extend(row.iter().map(|a| h * a));
            variables[i] = over.combine(&terms, &factors, 0.0);
        }
        if slopes.len() + 1 < tableau.rows().len() {
            slopes.push(equation.evaluate(over, variables));
        }
    }
}
