//! Nets distilled from an integrator with and without its derivatives, by the number of points at
//! which it is asked: errors of one step and of its Jacobian.
//!
//! `cargo run --release -p pinc-net --example 06_derivatives`; `-- 3` for the third seed.
#![expect(clippy::print_stdout, reason = "an example shows what it computes")]

#[path = "01_train.rs"]
#[expect(dead_code, reason = "its `main` is not needed")]
mod train;

use pinc_net::optim::AutoConfig;
use pinc_net::{
    Domain, NetError, Phase, PincModel, PincNet, Sampler, Training, TrainingConfig, TrainingTarget,
};
use pinc_ode::{LinearizationBuffer, Model, Rk4, Stages};
use pinc_plants::VanDerPol;

/// Points that no net is trained on.
const POINTS: u16 = 2048;

/// A net of two layers of 16 neurons, fitted to the steps from so many points.
fn distilled(
    (points, iterations, seed): (usize, u64, u64),
    derivatives: Option<f64>,
) -> Result<PincNet, NetError> {
    let config = TrainingConfig {
        source: TrainingTarget::Integrator,
        derivatives,
        collocation_points: points,
        growth: None,
        phases: vec![Phase::new(AutoConfig::default(), iterations)],
        ..TrainingConfig::recommended()
    };
    Ok(Training { config, seed, ..train::training() }.run(&VanDerPol::default())?.net)
}

/// The errors of one step, in widths of the domain, and of its derivatives by x and u, in widths of
/// the domain too: root mean square over the domain.
fn errors(net: &PincNet, domain: &Domain) -> Result<[f64; 2], NetError> {
    let (mut model, mut truth) =
        (PincModel::new(net)?, Rk4::new(VanDerPol::default(), net.sample_time_s(), 32));
    let widths: Vec<f64> = domain.ends().map(|(low, high)| high - low).collect();
    let points = Sampler::Sobol.collocation(usize::from(POINTS), 0.5, domain, 1, 12345);
    let (mut of_step, mut of_jacobian) = (0.0, 0.0);
    for k in 0..points.len() {
        let at = Stages { x: points.state(k), u: points.input(k), p: &[] };
        let linearize = |model: &mut dyn Model| {
            let mut out = LinearizationBuffer::new(model.dims(), 1);
            model.linearize(at, out.as_mut());
            out
        };
        let (found, exact) = (linearize(&mut model), linearize(&mut truth));
        for i in 0..2 {
            of_step += ((found.next[i] - exact.next[i]) / widths[i]).powi(2);
            for j in 0..2 {
                let error = found.a[2 * i + j] - exact.a[2 * i + j];
                of_jacobian += (error * widths[j] / widths[i]).powi(2);
            }
            of_jacobian += ((found.b[i] - exact.b[i]) * widths[2] / widths[i]).powi(2);
        }
    }
    let count = f64::from(POINTS);
    Ok([(of_step / (2.0 * count)).sqrt(), (of_jacobian / (6.0 * count)).sqrt()])
}

/// Prints a line per net, and returns the errors of the last two.
fn compare(points: &[usize], iterations: u64, seed: u64) -> Result<[[f64; 2]; 2], NetError> {
    let mut last = [[0.0; 2]; 2];
    println!("{:>6} {:>11} {:>9} {:>9}", "points", "derivatives", "step", "Jacobian");
    for &points in points {
        for (to, derivatives) in last.iter_mut().zip([None, Some(0.1)]) {
            let net = distilled((points, iterations, seed), derivatives)?;
            *to = errors(&net, net.domain())?;
            let weight = derivatives.map_or("none".to_owned(), |weight| weight.to_string());
            println!("{points:>6} {weight:>11} {:>9.1e} {:>9.1e}", to[0], to[1]);
        }
    }
    Ok(last)
}

fn main() -> Result<(), NetError> {
    let seed = std::env::args().nth(1).and_then(|seed| seed.parse().ok()).unwrap_or(1);
    compare(&[64, 256, 1024, 4096], 4000, seed).map(|_| ())
}

/// A short run: with few points the derivatives are what keeps the net from fitting these alone.
#[cfg(test)]
pub(crate) fn short() -> Result<(), NetError> {
    let [without, with] = compare(&[64], 500, 1)?;
    assert!(with[0] < without[0] / 1.5 && with[1] < without[1] / 1.5, "{without:?} {with:?}");
    Ok(())
}
