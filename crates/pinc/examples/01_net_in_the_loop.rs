//! From an equation to a net to the controller, with the libraries alone: the plant of the README,
//! its net as the model, and RK4 beside it.
//!
//! `cargo run --release -p pinc --example 01_net_in_the_loop`
#![expect(clippy::print_stdout, reason = "an example shows what it computes")]

use pinc_ad::Scalar;
use pinc_loop::ClosedLoop;
use pinc_mpc::{Bounds, Nmpc, NmpcProblem, Reference, SqpConfig, SqpStatus, Weights};
use pinc_net::optim::SelfScaledBroydenConfig;
use pinc_net::{Domain, NetConfig, NetError, Phase, PincModel, PincNet, Training, TrainingConfig};
use pinc_ode::{Dopri5, Model, Plant, Rk4, Variable};
use std::error::Error;

/// A cart with quadratic drag, pushed by a force: v' = u - v^2.
#[derive(Clone, Debug)]
struct Cart;

impl Plant for Cart {
    fn states(&self) -> &[Variable] {
        static STATES: [Variable; 1] = [Variable::new("v", "m/s")];
        &STATES
    }

    fn inputs(&self) -> &[Variable] {
        static INPUTS: [Variable; 1] = [Variable::new("u", "N/kg")];
        &INPUTS
    }

    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        dx[0] = u[0] - x[0] * x[0];
    }
}

/// A net for steps of 0.5 s, from the equation alone.
fn trained() -> Result<PincNet, NetError> {
    let training = Training {
        config: TrainingConfig {
            phases: vec![Phase::new(SelfScaledBroydenConfig::default(), 600)],
            ..TrainingConfig::recommended()
        },
        ..Training::new(NetConfig::new(0.5, 2, 10), Domain::new([0.0..=2.0], [0.0..=2.0]))
    };
    let trained = training.run(&Cart)?;
    println!("error of a step: {:.1e} m/s", trained.validation.one_step_mse.sqrt());
    Ok(trained.net)
}

/// The IAE at the steps of a loop with this model: from rest to 1 m/s, then to 0.5 m/s.
fn iae(model: Box<dyn Model>) -> Result<f64, Box<dyn Error>> {
    let problem = NmpcProblem {
        input_bounds: Bounds { low: vec![0.0], high: vec![2.0] },
        ..NmpcProblem::new(model.dims(), 5, Weights::uniform(vec![10.0], vec![1.0]))
    };
    let mut nmpc = Nmpc::new(problem, model, SqpConfig::default())?;
    let reference = Reference::new([[1.0; 20], [0.5; 20]].concat(), 1)?;
    let mut run = ClosedLoop::new(&mut nmpc, Dopri5::new(Cart, 1e-10), reference, &[0.0])?;
    let (record, ended) = run.run_recorded();
    ended?;
    assert!(record.steps.iter().all(|step| step.status == SqpStatus::Converged));
    Ok(run.tracking_at_steps().iae_mean())
}

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let with_net = iae(Box::new(PincModel::new(&trained()?)?))?;
    let with_rk4 = iae(Box::new(Rk4::new(Cart, 0.5, 4)))?;
    println!("IAE {with_net:.5} with the net, {with_rk4:.5} with RK4");
    assert!((with_net / with_rk4 - 1.0).abs() < 1e-2);
    Ok(())
}
