//! Measurements beside an equation that is wrong: mu = 0.8 in the equation, mu = 1 in the measured
//! plant.
//!
//! `cargo run --release -p pinc-net --example 04_measured_data`
#![expect(clippy::print_stdout, reason = "an example shows what it computes")]

#[path = "01_train.rs"]
#[expect(dead_code, reason = "its `main` and `trained` are not needed")]
mod train;

use pinc_net::optim::AutoConfig;
use pinc_net::{
    Measurements, Phase, PincNet, Progress, SelectNet, Trainer, Training, TrainingConfig,
};
use pinc_ode::Dopri5;
use pinc_plants::VanDerPol;
use std::error::Error;

/// Measurements of the plant itself after single steps from `count` states.
///
/// # Errors
///
/// If the plant cannot be integrated.
pub(crate) fn steps(count: usize) -> Result<Measurements, Box<dyn Error>> {
    let mut measured = Measurements::new(pinc_ode::Dims::new(2, 1));
    let mut plant = Dopri5::new(VanDerPol { mu: 1.0 }, 1e-10);
    for k in 0..u32::try_from(count)? {
        let angle = 2.4 * f64::from(k);
        let radius = 2.5 * (f64::from(k + 1) / f64::from(u32::try_from(count)?)).sqrt();
        let (y0, u) = ([radius * angle.cos(), radius * angle.sin()], [(3.0 * angle).sin()]);
        let mut y = y0;
        plant.integrate(&mut y, &u, 0.5)?;
        // After every other step only the position is known.
        measured.push(0.5, &y0, &u, &[], &[Some(y[0]), (k % 2 == 0).then_some(y[1])]);
    }
    Ok(measured)
}

/// A training that keeps the last net.
pub(crate) fn training() -> Training {
    Training {
        config: TrainingConfig {
            collocation_points: 2048,
            phases: vec![Phase::new(AutoConfig::default(), 1000)],
            growth: None,
            keep: SelectNet::Last,
            ..TrainingConfig::recommended()
        },
        ..train::training()
    }
}

/// The net of the wrong equation, with measurements or without; a [`Trainer`] shows the progress.
fn fit(measured: Option<&Measurements>) -> Result<PincNet, Box<dyn Error>> {
    let wrong = VanDerPol { mu: 0.8 };
    let training = training();
    let mut trainer = Trainer::new(&wrong, &training, training.validation_set(&wrong)?)?;
    if let Some(measured) = measured {
        trainer = trainer.with_measurements(measured, 100.0)?;
    }
    while let Progress::Iterated(record) = trainer.step()? {
        if record.iteration.is_multiple_of(200) {
            println!("iteration {:4}: loss {:.2e}", record.iteration, record.loss);
        }
    }
    Ok(trainer.net())
}

/// The root of the mean squared error of positions on the measurements `of`.
fn error(net: &PincNet, of: &Measurements) -> f64 {
    let points = of.points();
    let squared = |k: usize| {
        let predicted = net.evaluate(points.time(k), points.state(k), points.input(k), &[])[0];
        of.state(k)[0].map(|measured| (predicted - measured).powi(2))
    };
    let squares: Vec<f64> = (0..of.len()).filter_map(squared).collect();
    (squares.iter().sum::<f64>() / f64::from(u32::try_from(squares.len()).unwrap_or(1))).sqrt()
}

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let held_out = steps(97)?;
    let alone = error(&fit(None)?, &held_out);
    println!("the equation alone: {alone:.1e}");
    let corrected = error(&fit(Some(&steps(150)?))?, &held_out);
    println!("with 150 measured steps: {corrected:.1e}");
    assert!(corrected < 0.6 * alone);
    Ok(())
}
