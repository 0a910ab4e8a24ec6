//! A horizon of 100 steps: the quadratic programs solved stage by stage, at a cost that is linear
//! in the horizon, and the same by elimination of the states.
//!
//! `cargo run -p pinc-mpc --example 04_long_horizon`
#![expect(clippy::print_stdout, reason = "an example shows what it computes")]

use pinc_mpc::{
    Bounds, MpcError, Nmpc, NmpcProblem, QpMethod, SqpConfig, SqpStatus, Tracked, Weights,
};
use pinc_ode::{Model, Rk4};
use pinc_plants::FourTanks;

const STEPS: usize = 100;

/// The first plan for the four tanks: both lower levels to the reference, 100 steps of 10 s ahead.
fn plan(qp: QpMethod) -> Result<Nmpc, MpcError> {
    let model = Rk4::new(FourTanks::antonelo(), 10.0, 2);
    let problem = NmpcProblem {
        tracked: Tracked::states([0, 1]),
        state_bounds: Bounds { low: vec![2.0, 2.0, 0.6, 0.6], high: vec![20.0, 20.0, 5.5, 5.5] },
        input_bounds: Bounds { low: vec![0.0; 2], high: vec![5.0; 2] },
        ..NmpcProblem::new(model.dims(), STEPS, Weights::uniform(vec![10.0; 2], vec![1.0; 2]))
    };
    let config = SqpConfig { qp, ..SqpConfig::default() };
    let mut nmpc = Nmpc::new(problem, Box::new(model), config)?;
    let step = nmpc.step(&[10.0, 10.0, 2.0, 2.0], &[9.0, 14.0].repeat(STEPS))?;
    println!("{qp}: {}, {} QPs, u {:.6?}", step.status, step.sqp_iterations, step.u);
    assert_eq!(step.status, SqpStatus::Converged);
    Ok(nmpc)
}

pub(crate) fn main() -> Result<(), MpcError> {
    let stage_by_stage = plan(QpMethod::Riccati)?;
    let condensed = plan(QpMethod::Condensed)?;
    let inputs = [&stage_by_stage, &condensed].map(|nmpc| nmpc.plan().inputs());
    let differences = inputs[0].iter().zip(inputs[1]).map(|(a, b)| (a - b).abs());
    let most = differences.fold(0.0, f64::max);
    println!("the {} planned inputs differ by {most:.1e} V at most", inputs[0].len());
    assert!(most < 1e-4);
    assert_eq!(QpMethod::Auto.resolve([4, 2], [STEPS; 2]), QpMethod::Riccati);
    Ok(())
}
