//! Constraints of one's own, beside bounds: h(x, u) <= 0 and g(x, u) = 0, with exact derivatives.
//!
//! `cargo run -p pinc-mpc --example 02_constraints`
#![expect(clippy::print_stdout, reason = "an example shows what it computes")]

use pinc_ad::Scalar;
use pinc_mpc::{
    Bounds, Constraints, MpcError, Nmpc, NmpcProblem, Softness, SqpConfig, SqpStatus,
    StageConstraints, Weights,
};
use pinc_ode::{Model, Rk4};
use pinc_plants::VanDerPol;

/// x1^2 + x2^2 <= radius^2.
#[derive(Debug)]
struct Disc {
    radius: f64,
}

impl StageConstraints for Disc {
    fn inequalities(&self) -> usize {
        1
    }

    fn evaluate<S: Scalar>(&self, x: &[S], _u: &[S], h: &mut [S], _g: &mut [S]) {
        h[0] = x[0] * x[0] + x[1] * x[1] - self.radius * self.radius;
    }
}

/// x1 + x2 <= 0.5.
#[derive(Debug)]
struct HalfPlane;

impl StageConstraints for HalfPlane {
    fn inequalities(&self) -> usize {
        1
    }

    fn evaluate<S: Scalar>(&self, x: &[S], _u: &[S], h: &mut [S], _g: &mut [S]) {
        h[0] = x[0] + x[1] - 0.5;
    }
}

/// x2 = x1 - 0.25 after the step.
#[derive(Debug)]
struct Line;

impl StageConstraints for Line {
    fn equalities(&self) -> usize {
        1
    }

    fn evaluate<S: Scalar>(&self, x: &[S], _u: &[S], _h: &mut [S], g: &mut [S]) {
        g[0] = x[1] - x[0] + 0.25;
    }
}

/// A controller of the Van der Pol oscillator over `last` steps of 0.5 s.
fn controller(
    last: usize,
    constraints: Constraints,
    constraint_softness: Softness,
) -> Result<Nmpc, MpcError> {
    let model = Rk4::new(VanDerPol::default(), 0.5, 4);
    let problem = NmpcProblem {
        input_bounds: Bounds { low: vec![-1.0], high: vec![1.0] },
        constraints: Some(constraints),
        constraint_softness,
        ..NmpcProblem::new(model.dims(), last, Weights::uniform(vec![10.0; 2], vec![1.0]))
    };
    Nmpc::new(problem, Box::new(model), SqpConfig::default())
}

/// The distance of the planned states from the origin.
fn distances(nmpc: &Nmpc) -> Vec<f64> {
    nmpc.plan().states().chunks(2).map(|x| x[0].hypot(x[1])).collect()
}

pub(crate) fn main() -> Result<(), MpcError> {
    // The reference is outside of the disc: the plan goes to its edge and not beyond.
    let mut nmpc = controller(5, Constraints::new(Disc { radius: 0.6 }), Softness::Hard)?;
    let step = nmpc.step(&[0.5, 0.0], &[0.9, 0.0].repeat(5))?;
    assert_eq!(step.status, SqpStatus::Converged);
    println!("hard: distances {:.6?}", distances(&nmpc));
    assert!(distances(&nmpc).iter().all(|r| *r < 0.6 + 1e-7));
    assert!(distances(&nmpc).iter().any(|r| *r > 0.6 - 1e-6));

    // From far outside no input leads back within a step: a hard constraint is named, and a soft
    // one is violated as little as possible.
    let far = [2.0, 2.0];
    let mut hard = controller(5, Constraints::new(HalfPlane), Softness::Hard)?;
    let step = hard.step(&far, &[0.0; 10])?;
    let violated = step.violated.map(|constraint| constraint.to_string()).unwrap_or_default();
    println!("from far outside: {}, {violated}", step.status);
    assert_eq!(step.status, SqpStatus::InfeasibleQp);
    assert!(violated.starts_with("h[0]"));
    let mut soft = controller(5, Constraints::new(HalfPlane), Softness::Exact)?;
    let step = soft.step(&far, &[0.0; 10])?;
    println!("with a soft constraint: {}, u {:.3}", step.status, step.u[0]);
    assert_eq!(step.status, SqpStatus::Converged);

    // One input can satisfy one equation per step.
    let mut nmpc = controller(1, Constraints::new(Line), Softness::Hard)?;
    let step = nmpc.step(&[0.4, 0.1], &[0.4, 0.0])?;
    assert_eq!(step.status, SqpStatus::Converged);
    let next = nmpc.plan().states();
    println!("on the line: {next:.6?}");
    assert!((next[1] - next[0] + 0.25).abs() < 1e-7);
    Ok(())
}
