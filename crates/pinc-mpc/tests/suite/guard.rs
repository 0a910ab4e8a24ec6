//! A judge of the model, and the controller that takes over.

use crate::problems::van_der_pol;
use pinc_ad::Scalar;
use pinc_mpc::{Judge, MpcError, Nmpc, NmpcProblem, SqpConfig, Trust};
use pinc_ode::{Model, Plant, Rk4, Variable};
use pinc_plants::VanDerPol;

/// Trusts the model where the first state is at least `from`.
#[derive(Debug)]
struct Above(f64);

impl Judge for Above {
    fn trusts(&mut self, x: &[f64], u: &[f64], p: &[f64]) -> bool {
        assert!(u[0].abs() <= 1.0 && p.is_empty());
        x[0] >= self.0
    }
}

fn model(mu: f64) -> Box<dyn Model> {
    Box::new(Rk4::new(VanDerPol { mu }, 0.5, 4))
}

fn problem(delay: usize) -> NmpcProblem {
    NmpcProblem { delay, ..van_der_pol() }
}

fn plain(mu: f64, delay: usize) -> Nmpc {
    Nmpc::new(problem(delay), model(mu), SqpConfig::default()).unwrap()
}

/// A controller with a wrong model, which the right one takes over from below `from`.
fn guarded(from: f64, delay: usize, substitute: Option<Nmpc>) -> Result<Nmpc, MpcError> {
    let builder = Nmpc::builder(problem(delay)).model(model(0.2));
    builder.guard(Box::new(Above(from)), substitute).build()
}

/// The inputs and the trust of a loop with the oscillator from (0.8, 0.3).
fn run(nmpc: &mut Nmpc, steps: usize) -> Vec<(f64, Trust)> {
    let reference = vec![0.0; nmpc.problem().horizon * 2];
    let (mut plant, mut x) = (model(1.0), [0.8, 0.3]);
    let mut under_way = vec![0.0; nmpc.problem().delay];
    let step = |_| {
        let step = nmpc.step(&x, &reference).unwrap();
        let (u, trust) = (step.u[0], step.trust);
        under_way.push(u);
        let mut next = x;
        plant.step(&x, &[under_way.remove(0)], &[], &mut next);
        x = next;
        (u, trust)
    };
    (0..steps).map(step).collect()
}

fn inputs(of: &[(f64, Trust)]) -> Vec<u64> {
    of.iter().map(|(u, _)| u.to_bits()).collect()
}

/// A model that is never trusted leaves no trace: the loop is the substitute's own, bit for bit.
#[test]
fn the_substitute_makes_the_step_from_the_plan_before() {
    for delay in [0, 2] {
        let alone = run(&mut plain(1.0, delay), 30);
        let found = run(&mut guarded(f64::INFINITY, delay, Some(plain(1.0, delay))).unwrap(), 30);
        assert_eq!(inputs(&found), inputs(&alone), "delay {delay}");
        assert!(found.iter().all(|(_, trust)| *trust == Trust::Substituted));
        assert!(alone.iter().all(|(_, trust)| *trust == Trust::NotJudged));
    }
}

#[test]
fn a_trusted_model_is_followed() {
    let alone = run(&mut plain(0.2, 0), 20);
    for substitute in [Some(plain(1.0, 0)), None] {
        let found = run(&mut guarded(-9.0, 0, substitute).unwrap(), 20);
        assert_eq!(inputs(&found), inputs(&alone));
        assert!(found.iter().all(|(_, trust)| *trust == Trust::Trusted));
    }
    // Without a substitute it is followed all the same.
    let found = run(&mut guarded(f64::INFINITY, 0, None).unwrap(), 20);
    assert_eq!(inputs(&found), inputs(&alone));
    assert!(found.iter().all(|(_, trust)| *trust == Trust::Doubted));
}

/// Where only some steps are made over, the others start from the substitute's plan and take its
/// input for applied: with increments of at most 0.1, no two inputs are further apart.
#[test]
fn the_model_continues_from_the_substitutes_plan() {
    let bounded = |problem: NmpcProblem| {
        let mut problem = problem;
        (problem.increment_bounds.low, problem.increment_bounds.high) = (vec![-0.1], vec![0.1]);
        problem
    };
    let substitute = Nmpc::new(bounded(problem(0)), model(1.0), SqpConfig::default()).unwrap();
    let builder = Nmpc::builder(bounded(problem(0))).model(model(0.2));
    let mut nmpc = builder.guard(Box::new(Above(0.4)), Some(substitute)).build().unwrap();
    let found = run(&mut nmpc, 30);
    let count = |of: Trust| found.iter().filter(|(_, trust)| *trust == of).count();
    assert!(count(Trust::Trusted) >= 2 && count(Trust::Substituted) >= 5, "{found:?}");
    let mut before = 0.0;
    for (u, _) in &found {
        assert!((u - before).abs() <= 0.1 + 1e-9, "{found:?}");
        before = *u;
    }
}

#[test]
fn a_substitute_of_another_size_is_refused() {
    let other =
        Nmpc::new(NmpcProblem { delay: 1, ..van_der_pol() }, model(1.0), SqpConfig::default());
    let refused = guarded(0.0, 0, Some(other.unwrap())).unwrap_err().to_string();
    assert!(refused.contains("the substitute's delay"), "{refused}");
}

/// The oscillator, with an equation that has no value where x1 is above 0.7.
#[derive(Clone, Debug)]
struct Undefined(VanDerPol);

impl Plant for Undefined {
    fn states(&self) -> &[Variable] {
        self.0.states()
    }
    fn inputs(&self) -> &[Variable] {
        self.0.inputs()
    }
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], dx: &mut [S]) {
        self.0.rhs(x, u, p, dx);
        dx[0] = dx[0] + (-x[0] + 0.7).ln() * 0.0;
    }
}

/// A model without a value leads to no plan; the substitute makes one, and the loop goes on from it.
#[test]
fn a_step_without_a_plan_is_made_over() {
    let undefined: Box<dyn Model> = Box::new(Rk4::new(Undefined(VanDerPol { mu: 1.0 }), 0.5, 4));
    let builder = Nmpc::builder(van_der_pol()).model(undefined);
    let judge = Box::new(Above(f64::NEG_INFINITY));
    let mut nmpc = builder.guard(judge, Some(plain(1.0, 0))).build().unwrap();
    let found = run(&mut nmpc, 12);
    assert_eq!(found[0].1, Trust::Substituted);
    assert_eq!(found[11].1, Trust::Trusted);
    for ((u, _), (expected, _)) in found.iter().zip(run(&mut plain(1.0, 0), 12)) {
        assert!((u - expected).abs() < 1e-6, "{u} is not {expected}");
    }
}

/// A step whose time was up follows the plan before, which was judged then.
#[test]
fn a_plan_that_is_not_followed_is_not_judged() {
    let mut nmpc = guarded(f64::INFINITY, 0, None).unwrap();
    let reference = vec![0.0; nmpc.problem().horizon * 2];
    assert_eq!(nmpc.step(&[0.8, 0.3], &reference).unwrap().trust, Trust::Doubted);
    let late = nmpc.step_within(&[0.6, -0.2], &reference, &mut || true).unwrap();
    assert_eq!((late.followed, late.trust), (false, Trust::NotJudged));
}
