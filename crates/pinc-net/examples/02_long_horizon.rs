//! A net over a horizon longer than its T: step after step, each from where the last one led, under
//! an input that changes.
//!
//! `cargo run --release -p pinc-net --example 02_long_horizon`
#![expect(clippy::print_stdout, reason = "an example shows what it computes")]

#[path = "01_train.rs"]
#[expect(dead_code, reason = "its `main` is not needed")]
mod train;

use pinc_net::PincModel;
use pinc_ode::{Dopri5, Model, PiecewiseConstant};
use pinc_plants::VanDerPol;
use std::error::Error;

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let net = train::trained()?.net;
    let mut model = PincModel::new(&net)?;
    let mut plant = Dopri5::new(VanDerPol::default(), 1e-10);
    let input =
        PiecewiseConstant::new(vec![0.0, 2.0, 4.0], vec![vec![0.5], vec![-0.5], vec![0.8]])?;

    let (mut x, mut truth) = ([1.0, 0.0], [1.0, 0.0]);
    let mut next = [0.0; 2];
    for k in 0..12 {
        let t = f64::from(k) * model.sample_time_s();
        // Between the steps the net has a value for any time.
        let halfway = net.evaluate(0.5 * model.sample_time_s(), &x, input.at(t), &[]);
        model.step(&x, input.at(t), &[], &mut next);
        plant.integrate(&mut truth, input.at(t), model.sample_time_s())?;
        println!("t {t:3.1} s: halfway {halfway:7.4?}, then {next:7.4?}, truth {truth:7.4?}");
        x = next;
    }
    let error = (x[0] - truth[0]).hypot(x[1] - truth[1]);
    println!("after 12 steps the net is off by {error:.1e}");
    // Steps are accurate to 5e-3; a trajectory that is late by little is off by much where it is
    // fast.
    assert!(error < 0.3);
    Ok(())
}
