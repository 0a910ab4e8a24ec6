//! The closed loops of the paper with each method for the QPs: the same inputs.

use crate::support::{four_tanks, van_der_pol};
use pinc_mpc::{Nmpc, NmpcProblem, QpMethod, SqpConfig, SqpStatus};
use pinc_ode::{Adaptive, FourTanks, Plant, Rk4, VanDerPol};

/// Runs the loop, in which every method is asked about every state; the largest difference of inputs.
fn disagreement<P: Plant>(
    plant: &P,
    horizon_s: f64,
    problem: &NmpcProblem,
    x0: &[f64],
    references: &[&[f64]],
) -> f64 {
    let methods = [QpMethod::Condensed, QpMethod::Riccati, QpMethod::Clarabel, QpMethod::Auto];
    let mut controllers = methods.map(|qp| {
        let model = Box::new(Rk4::new(plant.clone(), horizon_s, 4));
        Nmpc::new(problem.clone(), model, SqpConfig { qp, ..SqpConfig::default() }).unwrap()
    });
    let mut truth = Adaptive::new(plant.clone(), 1e-9);
    let mut x = x0.to_vec();
    let mut worst = 0.0_f64;
    for reference in references {
        let window = reference.repeat(problem.last);
        let inputs = controllers.each_mut().map(|nmpc| {
            let step = nmpc.step(&x, &window).unwrap();
            assert_eq!(step.status, SqpStatus::Converged);
            step.u.to_vec()
        });
        for other in &inputs {
            let apart = inputs[0].iter().zip(other).map(|(a, b)| (a - b).abs());
            worst = apart.fold(worst, f64::max);
        }
        truth.integrate(&mut x, &inputs[0], horizon_s).unwrap();
    }
    worst
}

#[test]
fn the_methods_control_the_tanks_alike() {
    let (low, high) = ([9.159_582_958_982_018, 14.211_590_549_777_885], [10.15, 15.75]);
    let references: Vec<&[f64]> =
        (0..80).map(|k| if k < 40 { &low } else { &high }).map(|r| &r[..]).collect();
    let x0 = [2.0, 2.0, 0.6, 0.6];
    let worst = disagreement(&FourTanks::antonelo(), 10.0, &four_tanks(), &x0, &references);
    assert!(worst < 1e-7, "{worst:e}");
}

/// At the end the reference is at both bounds: rows are active without force, where an interior point is off by the
/// root of its tolerance.
#[test]
fn the_methods_control_the_oscillator_alike() {
    let references: Vec<&[f64]> = (0..120)
        .map(|k| [&[0.0, 0.0], &[-0.5, 0.0], &[0.8, 0.0], &[1.0, 0.0]][k / 30])
        .map(|r| &r[..])
        .collect();
    let x0 = [1.0, 0.0];
    let worst = disagreement(&VanDerPol::default(), 0.5, &van_der_pol(), &x0, &references);
    assert!(worst < 1e-5, "{worst:e}");
}
