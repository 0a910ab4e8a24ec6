//! Plants and data for the tests.

use pinc_expr::Equations;
use pinc_identify::{Channel, Criterion, InitialState, Measured, Problem, Unknown};
use pinc_ode::{DynPlant, Model, Variable};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

pub(crate) fn texts(pairs: &[(&str, &str)]) -> Vec<(String, String)> {
    pairs.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned())).collect()
}

/// A plant with these states and one input each, of which `varying` are the parameters.
pub(crate) fn plant(
    states: &[(&'static str, &str)],
    inputs: &[&'static str],
    parameters: &[(&str, f64)],
    varying: &[&str],
) -> Box<dyn DynPlant> {
    let equations = Equations {
        states: states.iter().map(|(name, _)| Variable::new(name, "")).collect(),
        inputs: inputs.iter().map(|name| Variable::new(name, "")).collect(),
        parameters: parameters.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect(),
        derivatives: texts(states).into_iter().collect(),
        ..Equations::default()
    };
    equations.compile_with(varying).unwrap().into_dyn()
}

/// The four tanks, of which all eight unknown numbers are parameters.
pub(crate) const TANKS: [&str; 8] = ["k1", "k2", "gamma1", "gamma2", "a1", "a2", "a3", "a4"];

pub(crate) fn tanks() -> Box<dyn DynPlant> {
    let values = [3.33, 3.35, 0.7, 0.6, 0.071, 0.057, 0.071, 0.057];
    let parameters: Vec<_> = TANKS.into_iter().zip(values).collect();
    plant(
        &[
            ("h1", "(u1*k1*gamma1 + a3*sqrt(max(h3, 0)*1962) - a1*sqrt(max(h1, 0)*1962))/28"),
            ("h2", "(u2*k2*gamma2 + a4*sqrt(max(h4, 0)*1962) - a2*sqrt(max(h2, 0)*1962))/32"),
            ("h3", "(u2*k2*(1 - gamma2) - a3*sqrt(max(h3, 0)*1962))/28"),
            ("h4", "(u1*k1*(1 - gamma1) - a4*sqrt(max(h4, 0)*1962))/32"),
        ],
        &["u1", "u2"],
        &parameters,
        &TANKS,
    )
}

pub(crate) fn oscillator() -> Box<dyn DynPlant> {
    let states = [("x1", "x2"), ("x2", "mu*(1 - x1^2)*x2 - k*x1 + u")];
    plant(&states, &["u"], &[("mu", 1.0), ("k", 1.0)], &["mu", "k"])
}

/// The states at these places are measured, all with noise of that standard deviation; these
/// parameters are unknown.
pub(crate) fn problem(
    plant: &dyn DynPlant,
    measured: &[usize],
    sd: Option<f64>,
    unknown: &[(f64, f64, f64)],
    initial_state: InitialState,
) -> Problem {
    let channel = |&place: &usize| Channel {
        name: plant.states()[place].name.to_string(),
        measured: Measured::State(place),
        sd,
        is_estimated: false,
    };
    let unknowns = unknown.iter().enumerate().map(|(place, &(initial, low, high))| Unknown {
        name: plant.parameters()[place].name.to_string(),
        place,
        initial,
        low,
        high,
        prior: None,
    });
    Problem {
        channels: measured.iter().map(channel).collect(),
        parameters: vec![0.0; plant.dims().np],
        unknown: unknowns.collect(),
        initial_state,
        states: plant.states().iter().map(|state| state.name.to_string()).collect(),
        inputs: plant.inputs().iter().map(|input| input.name.to_string()).collect(),
        criterion: Criterion::Chosen,
    }
}

/// The states of a model under some inputs, `[rows, nx]`.
pub(crate) fn simulated(model: &mut dyn Model, x0: &[f64], u: &[f64], p: &[f64]) -> Vec<f64> {
    let (nx, nu) = (model.dims().nx, model.dims().nu);
    let mut x = x0.to_vec();
    for u in u.chunks_exact(nu) {
        let mut next = vec![0.0; nx];
        model.step(&x[x.len() - nx..], u, p, &mut next);
        x.extend(next);
    }
    x.truncate(x.len() - nx);
    x
}

/// Normal noise.
pub(crate) fn noise(seed: u64, sd: f64, count: usize) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut draw = || {
        let normal: f64 = StandardNormal.sample(&mut rng);
        sd * normal
    };
    (0..count).map(|_| draw()).collect()
}

/// Steps of random heights, `rows` in all, each held for `hold` rows.
pub(crate) fn steps(seed: u64, rows: usize, hold: usize, (low, high): (f64, f64)) -> Vec<f64> {
    let heights = noise(seed, 1.0, rows.div_ceil(hold));
    let height = |k: usize| low + (high - low) * (0.5 + heights[k / hold] / 4.0).clamp(0.0, 1.0);
    (0..rows).map(height).collect()
}
