//! An inverse problem: the oscillator's damping is trained with the net, from measurements.
//!
//! `cargo run --release -p pinc-net --example 05_unknown_parameter`
#![expect(clippy::print_stdout, reason = "an example shows what it computes")]

#[path = "04_measured_data.rs"]
#[expect(dead_code, reason = "its `main` is not needed")]
mod measured;

use measured::{steps, training};
use pinc_ad::Scalar;
use pinc_net::Trainer;
use pinc_ode::{Plant, Variable};
use pinc_plants::VanDerPol;
use std::error::Error;

/// The oscillator with its damping as the parameter.
#[derive(Clone, Debug)]
struct Damped {
    states: [Variable; 2],
    inputs: [Variable; 1],
    parameters: [Variable; 1],
}

impl Plant for Damped {
    fn states(&self) -> &[Variable] {
        &self.states
    }

    fn inputs(&self) -> &[Variable] {
        &self.inputs
    }

    fn parameters(&self) -> &[Variable] {
        &self.parameters
    }

    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], p: &[S], dx: &mut [S]) {
        dx[0] = x[1];
        dx[1] = p[0] * (x[0] * x[0] * -1.0 + 1.0) * x[1] - x[0] + u[0];
    }
}

/// Trains from mu = 0.8 on; the measured plant has mu = 1.
pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let start = VanDerPol { mu: 0.8 };
    let family = Damped {
        states: [Variable::new("x1", ""), Variable::new("x2", "")],
        inputs: [Variable::new("u", "")],
        parameters: [Variable::new("mu", "")],
    };
    let training = training();
    let mut trainer = Trainer::new(&start, &training, training.validation_set(&start)?)?
        .with_unknown(&family, &[start.mu])?
        .with_measurements(&steps(64)?, 1.0)?;
    let end = trainer.run()?;
    let mu = trainer.estimates()[0];
    println!("{end}: mu = {mu:.4}");
    // As near as so small a net is to the equation.
    assert!((mu - 1.0).abs() < 0.03, "{mu}");
    Ok(())
}
