//! A step T of the Van der Pol oscillator by RK4 with more and more substeps, against an accurate
//! integration: what a net has to beat.
//!
//! `cargo run -p pinc-ode --example 02_integrators`
#![expect(clippy::print_stdout, reason = "an example shows what it computes")]

use pinc_ode::{Dopri5, Model, Rk4};
use pinc_plants::VanDerPol;
use std::error::Error;

/// The length T of a step, in s.
const HORIZON_S: f64 = 0.5;

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let (plant, x, u) = (VanDerPol::default(), [2.0, -1.0], [0.5]);
    let mut truth = x;
    Dopri5::new(plant, 1e-13).integrate(&mut truth, &u, HORIZON_S)?;

    let mut errors = Vec::new();
    for substeps in [1, 2, 4, 8, 16] {
        let mut model = Rk4::new(plant, HORIZON_S, substeps);
        let mut next = [0.0; 2];
        model.step(&x, &u, &[], &mut next);
        let error = (next[0] - truth[0]).hypot(next[1] - truth[1]);
        println!("{substeps:2} substeps: error {error:.2e}");
        errors.push(error);
    }
    // Order 4: half the substep, a sixteenth of the error.
    let ratio = errors[3] / errors[4];
    println!("from 8 to 16 substeps the error falls by {ratio:.1}");
    assert!((14.0..18.0).contains(&ratio));
    Ok(())
}
