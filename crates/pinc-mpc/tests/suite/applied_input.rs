//! A controller that is told what the plant has been given.

use crate::problems::{four_tanks, van_der_pol};
use crate::support::{Linear, scalar_problem};
use pinc_loop::ClosedLoop;
use pinc_mpc::{Bounds, Nmpc, NmpcProblem, Reference, SqpConfig, SqpStatus, Weights};
use pinc_ode::{Dopri5, Model, Rk4};
use pinc_plants::{FourTanks, VanDerPol};

/// The tanks' levels at rest under (3, 3) V: from w3 = (1 - g2) k2 u2 and so on.
fn at_rest() -> [f64; 4] {
    let level = |flow: f64, outlet: f64| (flow / outlet).powi(2) / (2.0 * 981.0);
    let (first, second) = (0.5 * 3.33 * 3.0, 0.5 * 3.35 * 3.0);
    [
        level(first + second, 0.071),
        level(first + second, 0.057),
        level(second, 0.071),
        level(first, 0.057),
    ]
}

/// The controller of the tanks with R = 100.
fn reluctant() -> Nmpc {
    let mut problem = four_tanks();
    problem.weights = Weights::uniform(vec![10.0; 2], vec![100.0; 2]);
    let model = Rk4::new(FourTanks::antonelo(), 10.0, 4);
    Nmpc::new(problem, Box::new(model), SqpConfig::default()).unwrap()
}

#[test]
fn a_plant_at_rest_is_left_at_rest() {
    let x = at_rest();
    let mut nmpc = reluctant();
    nmpc.reset_to(&x, &[3.0, 3.0]).unwrap();
    let step = nmpc.step(&x, &x[..2].repeat(5)).unwrap();
    assert_eq!(step.status, SqpStatus::Converged);
    assert!(step.u.iter().all(|u| (u - 3.0).abs() < 1e-7), "{:?}", step.u);
    // From 0 V the same controller begins far below.
    nmpc.reset();
    let step = nmpc.step(&x, &x[..2].repeat(5)).unwrap();
    assert!(step.u.iter().all(|u| *u < 2.0), "{:?}", step.u);
}

#[test]
fn a_loop_begins_with_the_input_that_the_plant_has() {
    let x = at_rest();
    for delay in [0, 2] {
        let mut nmpc = reluctant();
        let problem = NmpcProblem { delay, ..nmpc.problem().clone() };
        let model = Rk4::new(FourTanks::antonelo(), 10.0, 4);
        nmpc = Nmpc::new(problem, Box::new(model), SqpConfig::default()).unwrap();
        let reference = Reference::new(x[..2].repeat(10), 2).unwrap();
        let plant = Dopri5::new(FourTanks::antonelo(), 1e-12);
        let run = ClosedLoop::new(&mut nmpc, plant, reference, &x).unwrap();
        let mut run = run.with_initial_input(&[3.0, 3.0]).unwrap();
        run.run().unwrap();
        for (found, expected) in run.state().iter().zip(x) {
            assert!((found - expected).abs() < 1e-6, "delay {delay}: {found} {expected}");
        }
        assert!(run.with_initial_input(&[3.0]).is_err());
    }
}

/// The first plan holds the input applied, also where the model has no value.
#[test]
fn without_a_model_the_applied_input_is_held() {
    let mut nmpc = reluctant();
    nmpc.reset_to(&at_rest(), &[3.0, 2.5]).unwrap();
    assert_eq!(nmpc.plan().inputs(), [3.0, 2.5].repeat(5));
    let step = nmpc.step_within(&[9.0; 4], &[9.0; 10], &mut || true).unwrap();
    assert_eq!(step.u, [3.0, 2.5]);
}

/// min q (a x + b u - y)^2 + r (u - applied)^2
#[test]
fn the_input_that_was_applied_counts() {
    let (a, b, q, r) = (1.3, 0.7, 2.0, 3.0);
    let model = Box::new(Linear::scalar(a, b));
    let mut nmpc = Nmpc::new(scalar_problem(1, 1), model, SqpConfig::default()).unwrap();
    nmpc.step(&[2.0], &[-1.5]).unwrap();
    nmpc.set_applied_input(&[0.8]).unwrap();
    let u = nmpc.step(&[0.4], &[0.9]).unwrap().u[0];
    let expected = (q * b * (0.9 - a * 0.4) + r * 0.8) / (q * b * b + r);
    assert!((u - expected).abs() < 1e-9, "{u} {expected}");
    assert!(nmpc.set_applied_input(&[f64::NAN]).is_err());
    assert!(nmpc.set_applied_input(&[]).is_err());
    assert!(nmpc.reset_to(&[f64::INFINITY], &[0.0]).is_err());
}

/// An input beyond its bounds was not applied: a controller that is told so says which, and goes on
/// as if it had not been told.
#[test]
fn an_applied_input_beyond_its_bounds_is_refused() {
    let problem =
        NmpcProblem { input_bounds: Bounds::new(vec![-1.0], vec![2.0]), ..scalar_problem(2, 2) };
    let model = || Box::new(Linear::scalar(1.3, 0.7));
    let begin = || Nmpc::new(problem.clone(), model(), SqpConfig::default()).unwrap();
    let [mut told, mut untold] = [begin(), begin()];
    let next = |nmpc: &mut Nmpc, x: f64| nmpc.step(&[x], &[0.9, 0.9]).unwrap().u[0];
    next(&mut told, 0.5);
    next(&mut untold, 0.5);
    for (u, said) in [
        (2.1, "u_applied[0] is 2.1, but must be within its bounds, -1 to 2"),
        (-1.00001, "u_applied[0] is -1.00001, but must be within its bounds, -1 to 2"),
        (1e5, "u_applied[0] is 100000, but must be within its bounds, -1 to 2"),
        (f64::INFINITY, "u_applied[0]"),
    ] {
        let error = told.set_applied_input(&[u]).unwrap_err().to_string();
        assert!(error.starts_with(said), "{u}: {error}");
        assert_eq!(told.check_applied_input(&[u]).unwrap_err().to_string(), error);
    }
    assert!(next(&mut told, 0.4).total_cmp(&next(&mut untold, 0.4)).is_eq());
    // What rounding adds to a bound is none of this.
    for u in [2.0, -1.0, 2.000_001, -1.000_001] {
        told.set_applied_input(&[u]).unwrap();
    }
}

/// The first plan is made at the state of the first step, wherever that is.
#[test]
fn an_input_can_be_known_before_the_state_is() {
    let x = at_rest();
    let [mut placed, mut waiting] = [reluctant(), reluctant()];
    placed.reset_to(&x, &[3.0, 2.5]).unwrap();
    waiting.reset_input(&[3.0, 2.5]).unwrap();
    let reference = [14.0, 15.0].repeat(5);
    let step = waiting.step_within(&x, &reference, &mut || true).unwrap();
    assert_eq!((step.status, step.u), (SqpStatus::Deadline, &[3.0, 2.5][..]));
    assert_eq!(waiting.plan().states(), x.repeat(5));
    waiting.reset_input(&[3.0, 2.5]).unwrap();
    for _ in 0..3 {
        let expected = placed.step(&x, &reference).unwrap();
        let found = waiting.step(&x, &reference).unwrap();
        assert_eq!((found.u, found.status), (expected.u, expected.status));
    }
    // What was begun is forgotten.
    waiting.reset_input(&[3.0, 2.5]).unwrap();
    waiting.reset();
    let step = waiting.step(&x, &x[..2].repeat(5)).unwrap();
    assert!(step.u.iter().all(|u| *u < 2.0), "{:?}", step.u);
    assert!(waiting.reset_input(&[f64::NAN, 0.0]).is_err());
    assert!(waiting.reset_input(&[0.0]).is_err());
}

/// Without a state the last input is held, within its bounds, and is under way as any other: after
/// two inputs the delayed controller sees the state to which both lead.
#[test]
fn without_a_state_the_last_input_is_held() {
    let mut problem = scalar_problem(1, 1);
    problem.input_bounds = Bounds::new(vec![-0.5], vec![0.5]);
    let model = Linear::scalar(1.1, 0.5);
    let delayed = NmpcProblem { delay: 2, ..problem.clone() };
    let mut delayed = Nmpc::new(delayed, Box::new(model.clone()), SqpConfig::default()).unwrap();
    let mut plain = Nmpc::new(problem, Box::new(model), SqpConfig::default()).unwrap();
    delayed.reset_input(&[0.3]).unwrap();
    let first = delayed.step(&[-0.2], &[0.6]).unwrap().u[0];
    assert!((first - 0.3).abs() > 0.01 && first.abs() < 0.5, "{first}");
    for missing in [f64::NAN, f64::INFINITY] {
        let held = delayed.step(&[missing], &[0.2]).unwrap();
        assert_eq!((held.status, held.followed), (SqpStatus::BadArgument, false));
        assert_eq!((held.u, held.sqp_iterations), (&[first][..], 0));
        assert!(held.kkt.max().is_infinite());
    }
    // Both under way are the one that was held, not the one applied before.
    plain.reset_input(&[first]).unwrap();
    let now: f64 = 0.1;
    let then = 1.1 * (1.1 * now + 0.5 * first) + 0.5 * first;
    let expected = plain.step(&[then], &[0.2]).unwrap().u[0];
    let found = delayed.step(&[now], &[0.2]).unwrap().u[0];
    assert!((found - expected).abs() < 1e-9, "{found} {expected}");
    // The input given so far may be out of bounds; what is held is not.
    plain.reset_input(&[3.0]).unwrap();
    assert_eq!(plain.step(&[f64::NAN], &[0.2]).unwrap().u, [0.5]);
    assert!(plain.step(&[f64::NAN, 0.0], &[0.2]).is_err());
    assert!(plain.step(&[0.0], &[f64::NAN]).is_err());
}

/// With a delay the input applied is the last one under way: the predicted state is the plant's.
#[test]
fn an_applied_input_is_under_way() {
    let problem = NmpcProblem { delay: 1, ..scalar_problem(1, 1) };
    let model = Linear::scalar(1.1, 0.5);
    let mut delayed = Nmpc::new(problem, Box::new(model.clone()), SqpConfig::default()).unwrap();
    delayed.step(&[1.0], &[0.3]).unwrap();
    delayed.set_applied_input(&[-0.6]).unwrap();
    let found = delayed.step(&[1.1], &[0.3]).unwrap().u[0];
    let mut plain = Nmpc::new(scalar_problem(1, 1), Box::new(model), SqpConfig::default()).unwrap();
    plain.set_applied_input(&[-0.6]).unwrap();
    let expected = plain.step(&[1.1 * 1.1 - 0.5 * 0.6], &[0.3]).unwrap().u[0];
    assert!((found - expected).abs() < 1e-9, "{found} {expected}");
}

/// Of two inputs under way the one applied takes the place of the later: the earlier acts first.
#[test]
fn an_applied_input_is_the_last_under_way() {
    let (a, b, q, r) = (1.1, 0.5, 2.0, 3.0);
    let problem = NmpcProblem { delay: 2, ..scalar_problem(1, 1) };
    let model = Box::new(Linear::scalar(a, b));
    let mut nmpc = Nmpc::new(problem, model, SqpConfig::default()).unwrap();
    nmpc.reset_input(&[0.7]).unwrap();
    nmpc.set_applied_input(&[-0.6]).unwrap();
    let found = nmpc.step(&[1.1], &[0.3]).unwrap().u[0];
    let start = a * (a * 1.1 + b * 0.7) - b * 0.6;
    let expected = (q * b * (0.3 - a * start) - r * 0.6) / (q * b * b + r);
    assert!((found - expected).abs() < 1e-9, "{found} {expected}");
}

/// A held input is under way as it was held: within its bounds.
#[test]
fn a_held_input_is_under_way_within_its_bounds() {
    let (a, b, q, r) = (1.1, 0.5, 2.0, 3.0);
    let input_bounds = Bounds::new(vec![-0.5], vec![0.5]);
    let problem = NmpcProblem { delay: 1, input_bounds, ..scalar_problem(1, 1) };
    let model = Box::new(Linear::scalar(a, b));
    let mut nmpc = Nmpc::new(problem, model, SqpConfig::default()).unwrap();
    nmpc.reset_input(&[3.0]).unwrap();
    assert_eq!(nmpc.step(&[f64::NAN], &[0.2]).unwrap().u, [0.5]);
    let found = nmpc.step(&[0.1], &[0.2]).unwrap().u[0];
    let start = a * 0.1 + b * 0.5;
    let expected = (q * b * (0.2 - a * start) + r * 0.5) / (q * b * b + r);
    assert!((found - expected).abs() < 1e-9 && found.abs() < 0.5, "{found} {expected}");
}

/// In a real-time iteration the plan of rest is prepared before anything is measured, and an input
/// that is set after that is counted from all the same.
#[test]
fn a_real_time_iteration_begins_where_the_plant_is() {
    let model = Rk4::new(VanDerPol::default(), 0.5, 4);
    let mut problem = van_der_pol();
    problem.increment_bounds.low = vec![-0.1];
    problem.increment_bounds.high = vec![0.1];
    let config = SqpConfig { real_time: true, ..SqpConfig::default() };
    let mut nmpc = Nmpc::new(problem, Box::new(model.clone()), config).unwrap();
    nmpc.reset_to(&[0.5, 0.0], &[0.5]).unwrap();
    nmpc.prepare();
    // (0.5, 0) under u = 0.5 is a steady state.
    let step = nmpc.step(&[0.5, 0.0], &[0.5, 0.0].repeat(5)).unwrap();
    assert!((step.u[0] - 0.5).abs() < 1e-9, "{}", step.u[0]);
    nmpc.prepare();
    nmpc.set_applied_input(&[-0.3]).unwrap();
    let step = nmpc.step(&[0.5, 0.0], &[0.5, 0.0].repeat(5)).unwrap();
    assert!((step.u[0] + 0.2).abs() < 1e-9, "{}", step.u[0]);
    assert_eq!(model.dims().nu, 1);
}
