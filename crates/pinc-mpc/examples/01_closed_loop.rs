//! The paper's closed loop of the Van der Pol oscillator, with RK4 as the controller's model.
//!
//! `cargo run -p pinc-mpc --example 01_closed_loop`
#![expect(clippy::print_stdout, reason = "an example shows what it computes")]

use pinc_loop::ClosedLoop;
use pinc_mpc::{Bounds, Nmpc, NmpcProblem, Reference, SqpConfig, SqpStatus, Weights};
use pinc_ode::{Dopri5, Model, PiecewiseConstant, Rk4};
use pinc_plants::VanDerPol;
use std::error::Error;

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let plant = VanDerPol::default();
    let model = Rk4::new(plant, 0.5, 4);
    let problem = NmpcProblem {
        state_bounds: Bounds { low: vec![-1.0; 2], high: vec![1.0; 2] },
        input_bounds: Bounds { low: vec![-1.0], high: vec![1.0] },
        ..NmpcProblem::new(model.dims(), 5, Weights::uniform(vec![10.0; 2], vec![1.0]))
    };
    let mut nmpc = Nmpc::new(problem, Box::new(model), SqpConfig::default())?;

    // x1 is to be at 0, then at 0.5, known in advance; both are steady states with x2 = 0.
    let wanted = PiecewiseConstant::new(vec![0.0, 10.0], vec![vec![0.0, 0.0], vec![0.5, 0.0]])?;
    let reference = Reference::sample(&wanted, 40, 0.5)?;
    let mut run = ClosedLoop::new(&mut nmpc, Dopri5::new(plant, 1e-12), reference, &[1.0, 0.0])?;
    while let Some(control) = run.control()? {
        let (input, record) = (control.u()[0], *control.record());
        control.advance()?;
        println!(
            "u {input:8.5}   x {:8.5?}   {} QPs, {}",
            run.state(),
            record.sqp_iterations,
            record.status
        );
        assert_eq!(record.status, SqpStatus::Converged);
    }
    println!(
        "IAE {:.4}, RMSE {:.4}",
        run.tracking_at_steps().iae_mean(),
        run.tracking_at_steps().rmse()
    );
    assert!((run.state()[0] - 0.5).abs() < 1e-3);
    Ok(())
}
