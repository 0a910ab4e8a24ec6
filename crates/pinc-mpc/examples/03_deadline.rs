//! What the controller does when there is no time: it stops where the caller's clock says so, and
//! gives an input within its bounds in any case.
//!
//! `cargo run -p pinc-mpc --example 03_deadline`
#![expect(clippy::print_stdout, reason = "an example shows what it computes")]

use pinc_mpc::{Bounds, MpcError, Nmpc, NmpcProblem, SqpConfig, SqpStatus, Weights};
use pinc_ode::{Model, Rk4};
use pinc_plants::VanDerPol;

pub(crate) fn main() -> Result<(), MpcError> {
    let model = Rk4::new(VanDerPol::default(), 0.5, 4);
    let problem = NmpcProblem {
        input_bounds: Bounds { low: vec![-1.0], high: vec![1.0] },
        ..NmpcProblem::new(model.dims(), 5, Weights::uniform(vec![10.0; 2], vec![50.0]))
    };
    let mut nmpc = Nmpc::new(problem, Box::new(model), SqpConfig::default())?;
    let reference = [0.0; 10];

    // With all the time that it takes.
    let step = nmpc.step(&[1.0, 0.0], &reference)?;
    println!("{}: u {:.5} after {} QPs", step.status, step.u[0], step.sqp_iterations);
    assert_eq!(step.status, SqpStatus::Converged);
    let planned = nmpc.plan().inputs()[1];

    // A clock enters as a closure, asked before each QP and within: on a machine,
    // `|| start.elapsed() > budget`. Here the time is up at once, and the input is the next one of
    // the last plan.
    let step = nmpc.step_within(&[0.9, -0.4], &reference, &mut || true)?;
    println!("{}: u {:.5}, planned before: {planned:.5}", step.status, step.u[0]);
    assert_eq!((step.status, step.followed), (SqpStatus::Deadline, false));
    assert!((step.u[0] - planned).abs() < 1e-12);

    // The time for one QP: the plan may not be optimal yet, and its input is within the bounds.
    let mut asked = 0;
    let step = nmpc.step_within(&[0.2, 0.6], &reference, &mut || {
        asked += 1;
        asked > 1
    })?;
    println!(
        "{}: u {:.5} after {} QP, followed: {}",
        step.status, step.u[0], step.sqp_iterations, step.followed
    );
    assert!(step.sqp_iterations == 1 && step.u[0].abs() <= 1.0);

    // And none of this is remembered for worse.
    let step = nmpc.step(&[0.1, 0.3], &reference)?;
    println!("{}: u {:.5} after {} QPs", step.status, step.u[0], step.sqp_iterations);
    assert_eq!(step.status, SqpStatus::Converged);
    Ok(())
}
