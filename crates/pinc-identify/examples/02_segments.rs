//! The Lorenz system, which forgets where it began: a fit along the whole of the record is
//! hopeless, and one in segments finds all three parameters.
//!
//! `cargo run -p pinc-identify --example 02_segments`
#![expect(clippy::print_stdout, reason = "an example shows what it computes")]

use pinc_ad::Scalar;
use pinc_identify::{
    Channel, Criterion, FitStatus, IdentifyError, InitialState, Measured, Method, Problem,
    Recording, Unknown, identify,
};
use pinc_ode::{Model, Plant, Rk4, Variable};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

/// x' = sigma (y - x), y' = x (rho - z) - y + u, z' = x y - beta z (Lorenz, "Deterministic
/// nonperiodic flow", Journal of the Atmospheric Sciences 20 (1963)).
#[derive(Clone, Copy, Debug)]
struct Lorenz;

impl Plant for Lorenz {
    fn states(&self) -> &[Variable] {
        const { &[Variable::new("x", ""), Variable::new("y", ""), Variable::new("z", "")] }
    }
    fn inputs(&self) -> &[Variable] {
        const { &[Variable::new("u", "")] }
    }
    fn parameters(&self) -> &[Variable] {
        const { &[Variable::new("sigma", ""), Variable::new("rho", ""), Variable::new("beta", "")] }
    }
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], dx: &mut [S]) {
        dx[0] = p[0] * (x[1] - x[0]);
        dx[1] = x[0] * (p[1] - x[2]) - x[1] + u[0];
        dx[2] = x[0] * x[1] - p[2] * x[2];
    }
}

pub(crate) fn main() -> Result<(), IdentifyError> {
    let mut model = Rk4::new(Lorenz, 0.05, 5);
    let truth = [10.0, 28.0, 8.0 / 3.0];
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let noise = Normal::new(0.0, 0.1).expect("a positive standard deviation");
    let (mut x, u, mut y) = ([-8.0, 7.0, 27.0], vec![0.0; 300], Vec::new());
    for u in &u {
        y.extend(x.map(|x| x + noise.sample(&mut rng)));
        let mut next = [0.0; 3];
        model.step(&x, &[*u], &truth, &mut next);
        x = next;
    }

    let names = ["x", "y", "z"].map(str::to_owned);
    let channel = |(i, name): (usize, &String)| Channel {
        name: name.clone(),
        measured: Measured::State(i),
        sd: Some(0.1),
        is_estimated: false,
    };
    let starts = [("sigma", 8.0), ("rho", 24.0), ("beta", 2.0)];
    let unknown = |(place, (name, initial)): (usize, (&str, f64))| Unknown {
        name: name.to_owned(),
        place,
        initial,
        low: 0.1,
        high: 60.0,
        prior: None,
    };
    let problem = Problem {
        channels: names.iter().enumerate().map(channel).collect(),
        parameters: starts.map(|(_, initial)| initial).to_vec(),
        unknown: starts.into_iter().enumerate().map(unknown).collect(),
        initial_state: InitialState::Free(vec![-7.0, 6.0, 25.0]),
        states: names.to_vec(),
        inputs: vec!["u".to_owned()],
        criterion: Criterion::Chosen,
    };
    let record = Recording { name: "record", before: None, u: &u, y: &y };
    let found = identify(&mut model, &problem, &[record])?;
    println!("{}: {}", found.method.name(), found.method);
    assert_eq!(found.status, FitStatus::Converged);
    assert!(matches!(found.method, Method::MultipleShooting(_)));
    for (estimate, truth) in found.parameters.iter().zip(truth) {
        let half_width = estimate.half_width.expect("an interval");
        println!("{} = {:.5} +- {half_width:.5}, truly {truth}", estimate.name, estimate.value);
        assert!((estimate.value - truth).abs() < 2.0 * half_width);
    }
    Ok(())
}
