//! A tank whose pump and outlet are unknown: both are found in a record of its level, with
//! intervals, and what the record cannot tell is said.
//!
//! `cargo run -p pinc-identify --example 01_pumps`
#![expect(clippy::print_stdout, reason = "an example shows what it computes")]

use pinc_ad::Scalar;
use pinc_identify::{
    Channel, Criterion, Diagnosis, FitStatus, IdentifyError, InitialState, Measured, Problem,
    Recording, Unknown, identify,
};
use pinc_ode::{Model, Plant, Rk4, Variable};
use rand::SeedableRng;
use rand::rngs::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

/// A tank with pump constant k and outlet a: 28 h' = k u - a sqrt(2 g h), in cm, s and V.
#[derive(Clone, Copy, Debug)]
struct Tank;

impl Plant for Tank {
    fn states(&self) -> &[Variable] {
        const { &[Variable::new("h", "cm")] }
    }
    fn inputs(&self) -> &[Variable] {
        const { &[Variable::new("u", "V")] }
    }
    fn parameters(&self) -> &[Variable] {
        const { &[Variable::new("k", "cm^3/(V s)"), Variable::new("a", "cm^2")] }
    }
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], dx: &mut [S]) {
        dx[0] = (p[0] * u[0] - p[1] * (x[0] * 1962.0).sqrt()) * (1.0 / 28.0);
    }
}

pub(crate) fn main() -> Result<(), IdentifyError> {
    let mut model = Rk4::new(Tank, 10.0, 4);

    // A record of 100 steps of 10 s, with noise; of each third one the level is missing.
    let truth = [3.1, 0.066];
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let noise = Normal::new(0.0, 0.05).expect("a positive standard deviation");
    let (mut h, mut u, mut y) = ([9.0], Vec::new(), Vec::new());
    for k in 0..100 {
        u.push(if (k / 10) % 2 == 0 { 3.5 } else { 2.0 });
        y.push(if k % 3 == 2 { f64::NAN } else { h[0] + noise.sample(&mut rng) });
        let mut next = [0.0];
        model.step(&h, &u[k..=k], &truth, &mut next);
        h = next;
    }

    let unknown = |name: &str, place, initial, low, high| Unknown {
        name: name.to_owned(),
        place,
        initial,
        low,
        high,
        prior: None,
    };
    let problem = Problem {
        channels: vec![Channel {
            name: "h".to_owned(),
            measured: Measured::State(0),
            sd: Some(0.05),
            is_estimated: false,
        }],
        parameters: vec![3.33, 0.071],
        unknown: vec![unknown("k", 0, 3.33, 0.5, 8.0), unknown("a", 1, 0.071, 0.01, 0.2)],
        initial_state: InitialState::Free(vec![8.0]),
        states: vec!["h".to_owned()],
        inputs: vec!["u".to_owned()],
        criterion: Criterion::Chosen,
    };
    let record = Recording { name: "record", before: None, u: &u, y: &y };
    let found = identify(&mut model, &problem, &[record])?;
    assert_eq!(found.status, FitStatus::Converged);
    println!("{}, as {}", found.method.name(), found.method);
    for (estimate, truth) in found.estimates().zip([truth[0], truth[1], 9.0]) {
        let half_width = estimate.half_width.expect("an interval");
        println!("{} = {:.4} +- {half_width:.4}, truly {truth}", estimate.name, estimate.value);
        assert!((estimate.value - truth).abs() < 1.5 * half_width);
    }

    // Without inflow the pump does not matter.
    let (idle, falling) = (vec![0.0; 12], (0..12).map(|k| 9.0 - 0.3 * f64::from(k)));
    let falling: Vec<f64> = falling.collect();
    let record = Recording { name: "pump off", before: None, u: &idle, y: &falling };
    let found = identify(&mut model, &problem, &[record])?;
    found.findings.iter().for_each(|finding| println!("{finding}"));
    assert!(found.findings.contains(&Diagnosis::NoInfluence { name: "k".to_owned() }));
    Ok(())
}
