//! Single and multiple shooting.

use crate::support::{noise, oscillator, plant, problem, simulated, steps};
use pinc_identify::{FitStatus, InitialState, Method, Recording, Why, identify};
use pinc_ode::Integrator;

/// The Lorenz system: what single shooting sees of 15 time units is noise.
#[test]
fn a_chaotic_system_needs_multiple_shooting() {
    let names = ["beta", "rho", "sigma"];
    let values = [("beta", 8.0 / 3.0), ("rho", 28.0), ("sigma", 10.0)];
    let lorenz = plant(
        &[("x", "sigma*(y - x) + u"), ("y", "x*(rho - z) - y"), ("z", "x*y - beta*z")],
        &["u"],
        &values,
        &names,
    );
    let mut model = lorenz.model(Integrator::Rk4, 0.05, 5).unwrap();
    let u = vec![0.0; 300];
    let truth = [8.0 / 3.0, 28.0, 10.0];
    let x = simulated(&mut *model, &[-8.0, 7.0, 27.0], &u, &truth);
    let noise = noise(1, 0.1, 900);
    let y: Vec<f64> = x.iter().zip(&noise).map(|(x, noise)| x + noise).collect();
    let start = [(2.0, 0.5, 10.0), (20.0, 5.0, 60.0), (8.0, 1.0, 50.0)];
    let free = InitialState::Free(vec![-7.0, 6.0, 25.0]);
    let problem = problem(&*lorenz, &[0, 1, 2], Some(0.1), &start, free);
    let recording = Recording { name: "lorenz", before: None, u: &u, y: &y };
    let found = identify(&mut *model, &problem, &[recording]).unwrap();
    assert_eq!(found.status, FitStatus::Converged, "{:?}", found.work);
    assert!(matches!(found.method, Method::MultipleShooting(_)));
    for (estimate, truth) in found.parameters.iter().zip(truth) {
        let width = estimate.half_width.unwrap();
        assert!((estimate.value - truth).abs() < 2.0 * width, "{estimate:?}");
        assert!(width < 0.01 * truth, "{estimate:?}");
    }
    // What is left is the noise, less what the six unknowns take of it: a chi-square of six degrees
    // of freedom, which is below 28 in all but one of ten thousand.
    let drawn: f64 = noise.iter().map(|noise| (noise / 0.1).powi(2)).sum();
    let taken = drawn - 2.0 * found.cost;
    assert!((0.0..28.0).contains(&taken), "{taken} of {drawn}");
    assert_eq!(found.findings, []);
}

/// A model that is not finite to the end from the start, since it grows too fast there.
#[test]
fn a_model_that_explodes_at_the_start_is_cut_into_segments() {
    let growth = plant(&[("x", "r*x^2 - x + u")], &["u"], &[("r", 0.1)], &["r"]);
    let mut model = growth.model(Integrator::Rk4, 0.2, 2).unwrap();
    let u = steps(5, 100, 10, (0.0, 1.0));
    let x = simulated(&mut *model, &[1.0], &u, &[0.1]);
    assert!(x.iter().all(|x| x.is_finite()));
    let y: Vec<f64> = x.iter().zip(noise(2, 0.01, 100)).map(|(x, noise)| x + noise).collect();
    let free = InitialState::Free(vec![1.0]);
    let problem = problem(&*growth, &[0], Some(0.01), &[(3.0, 0.0, 5.0)], free);
    let recording = Recording { name: "growth", before: None, u: &u, y: &y };
    let found = identify(&mut *model, &problem, &[recording]).unwrap();
    assert_eq!(found.method, Method::MultipleShooting(Why::NotFinite));
    assert_eq!(found.status, FitStatus::Converged);
    let r = &found.parameters[0];
    assert!((r.value - 0.1).abs() < 2.0 * r.half_width.unwrap(), "{r:?}");
}

/// Where both ways work they end in the same place: the fit of segments, with everything that its
/// elimination does, has the minimum, the intervals and the correlations of the fit without.
#[test]
fn both_ways_have_the_same_answer() {
    let plant = oscillator();
    let mut model = plant.model(Integrator::Rk4, 0.1, 2).unwrap();
    let u = steps(7, 300, 15, (-1.0, 1.0));
    let x = simulated(&mut *model, &[1.0, 0.0], &u, &[0.8, 1.3]);
    let y: Vec<f64> =
        x.chunks(2).map(|x| x[0]).zip(noise(3, 0.05, 300)).map(|(x, e)| x + e).collect();
    let recording = [Recording { name: "oscillator", before: None, u: &u, y: &y }];
    let from = |mu: f64, k: f64, state: [f64; 2]| {
        let start = [(mu, 0.0, 5.0), (k, 0.1, 20.0)];
        problem(&*plant, &[0], Some(0.05), &start, InitialState::Free(state.to_vec()))
    };
    let near = identify(&mut *model, &from(0.8, 1.3, [1.0, 0.0]), &recording).unwrap();
    assert!(matches!(near.method, Method::SingleShooting { .. }), "{:?}", near.method);
    // Twice the frequency: single shooting ends in a minimum that fits worse.
    let far = identify(&mut *model, &from(0.3, 5.0, [1.0, 0.0]), &recording).unwrap();
    assert!(matches!(far.method, Method::MultipleShooting(_)), "{:?}", far.method);
    assert_eq!((near.status, far.status), (FitStatus::Converged, FitStatus::Converged));
    assert!((near.cost - far.cost).abs() < 1e-8 * near.cost);
    for (near, far) in near.estimates().zip(far.estimates()) {
        let (a, b) = (near.half_width.unwrap(), far.half_width.unwrap());
        assert!((near.value - far.value).abs() < 1e-4 * a, "{near:?} {far:?}");
        assert!((a - b).abs() < 1e-4 * a, "{near:?} {far:?}");
    }
    for (near, far) in near.correlation.iter().zip(&far.correlation) {
        assert!((near - far).abs() < 1e-4);
    }
}

/// The same fit gives the same bits.
#[test]
fn the_same_data_give_the_same_bits() {
    let plant = oscillator();
    let mut model = plant.model(Integrator::Rk4, 0.1, 2).unwrap();
    let u = steps(7, 100, 15, (-1.0, 1.0));
    let y = simulated(&mut *model, &[1.0, 0.0], &u, &[0.8, 1.3]);
    let start = [(0.5, 0.0, 5.0), (1.0, 0.1, 20.0)];
    let free = InitialState::Free(vec![1.0, 0.0]);
    let problem = problem(&*plant, &[0, 1], None, &start, free);
    let mut fit = || {
        let recording = Recording { name: "oscillator", before: None, u: &u, y: &y };
        let found = identify(&mut *model, &problem, &[recording]).unwrap();
        found.estimates().map(|estimate| estimate.value.to_bits()).collect::<Vec<_>>()
    };
    assert_eq!(fit(), fit());
}
