//! Weights of measurements whose noise is not known.

use crate::support::{noise, plant, problem};
use pinc_identify::{InitialState, Prior, Problem, Recording, identify, weighed_by_residuals};
use pinc_ode::Integrator;

/// x' = c u under u = 1 from x = 0, so x = c t: a line with one unknown slope, of which the prior
/// says 1 +- 0.1 and the data 1.7. The answer solves c = (Sxy/s^2 + m/d^2)/(Sxx/s^2 + 1/d^2) with
/// s^2 the mean square of the residuals.
#[test]
fn a_prior_counts_beside_one_channel_by_its_residuals() {
    let plant = plant(&[("x", "c*u")], &["u"], &[("c", 1.0)], &["c"]);
    let mut model = plant.model(Integrator::Rk4, 0.1, 1).unwrap();
    let t: Vec<f64> = (0..80).map(|k| 0.1 * f64::from(k)).collect();
    let u = vec![1.0; t.len()];
    let y: Vec<f64> = t.iter().zip(noise(1, 0.3, t.len())).map(|(t, e)| 1.7 * t + e).collect();
    let (mean, sd): (f64, f64) = (1.0, 0.1);

    let sum = |of: &dyn Fn(f64, f64) -> f64| t.iter().zip(&y).map(|(t, y)| of(*t, *y)).sum::<f64>();
    let mut expected: f64 = 1.0;
    for _ in 0..200 {
        let variance = sum(&|t, y| (y - expected * t).powi(2)) / t.len() as f64;
        let precision = sum(&|t, _| t * t) / variance + sd.powi(-2);
        expected = (sum(&|t, y| t * y) / variance + mean * sd.powi(-2)) / precision;
    }

    let mut problem =
        problem(&*plant, &[0], None, &[(1.0, 0.1, 4.0)], InitialState::Fixed(vec![0.0]));
    problem.unknown[0].prior = Some(Prior { mean, sd });
    let recordings = [Recording { name: "line", before: None, u: &u, y: &y }];
    let fit = |problem: &Problem, _: usize| identify(&mut *model, problem, &recordings);
    let (_, found) = weighed_by_residuals(problem, &recordings, 1, fit).unwrap();
    let value = found.parameters[0].value;
    // Weights count as settled at 1 %.
    assert!((value - expected).abs() < 0.01 * (1.7 - expected), "{value} {expected}");
    assert!(
        (1.65..1.7).contains(&expected),
        "the prior is to count, and the data more: {expected}"
    );
}
