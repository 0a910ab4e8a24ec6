//! Results of the analysis against answers that are known from theory, by hand, or published.

mod irregularities;
mod linear;
mod stability;
mod steady_states;

use pinc_analysis::Region;
use pinc_expr::{Equations, ExpressionPlant};
use pinc_ode::Dims;

/// Equations of a plant with these states, inputs and derivatives.
fn equations(states: &[&str], inputs: &[&str], derivatives: &[&str]) -> Equations {
    let variables = |names: &[&str]| {
        names
            .iter()
            .map(|name| serde_json::from_value(serde_json::json!({"name": name})).unwrap())
            .collect::<Vec<_>>()
    };
    let derivatives =
        states.iter().zip(derivatives).map(|(s, d)| ((*s).to_owned(), (*d).to_owned()));
    Equations {
        states: variables(states),
        inputs: variables(inputs),
        derivatives: derivatives.collect(),
        ..Equations::default()
    }
}

fn plant(states: &[&str], inputs: &[&str], derivatives: &[&str]) -> ExpressionPlant {
    equations(states, inputs, derivatives).compile().unwrap()
}

fn region(states: usize, low: &[f64], high: &[f64]) -> Region {
    Region::new(Dims::new(states, low.len() - states), low.to_vec(), high.to_vec())
}

/// The chemostat X' = (mu - D) X, S' = D (10 - S) - 2 mu X with mu = 0.4 S / (0.1 + S), in hours.
fn chemostat(mu: &str) -> Equations {
    equations(&["X", "S"], &["D"], &[&format!("({mu} - D)*X"), &format!("D*(10 - S) - 2*{mu}*X")])
}
