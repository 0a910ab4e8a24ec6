//! Stability of integrators against what they do.

use super::plant;
use pinc_analysis::{Complex, OneStepSamples, Region, StabilityFunction};
use pinc_ode::{Dims, Integrator};

const EXPLICIT: [Integrator; 2] = [Integrator::Rk4, Integrator::Rk5];

/// Whether |x| falls in a step of x' = re x - im y, y' = im x + re y from (1, 0).
fn factor(method: Integrator, z: Complex) -> f64 {
    let text = [format!("{}*x - {}*y + 0*u", z.re, z.im), format!("{}*x + {}*y", z.im, z.re)];
    let plant = plant(&["x", "y"], &["u"], &[&text[0], &text[1]]);
    let mut step = plant.into_dyn().model(method, 1.0, 1).unwrap();
    let mut next = [0.0; 2];
    step.step(&[1.0, 0.0], &[0.0], &[], &mut next);
    next[0].hypot(next[1])
}

#[test]
fn amplification_is_what_a_step_does() {
    for method in EXPLICIT {
        let stability = StabilityFunction::of(method).unwrap();
        for z in [(-0.5, 0.0), (-2.7, 0.0), (-3.3, 0.0), (-1.0, 2.5), (-0.01, 2.9), (0.3, 1.0)] {
            let z = Complex { re: z.0, im: z.1 };
            let (found, done) = (stability.amplification(z).abs(), factor(method, z));
            assert!((found - done).abs() < 1e-12 * (1.0 + done), "{method:?} {z:?}");
        }
    }
}

#[test]
fn limits_on_the_real_axis_are_the_published_ones() {
    // Hairer and Wanner II, section IV.2, figure 2.1 and 2.2: 2.785 and 3.307.
    let [rk4, rk5] = EXPLICIT.map(|method| StabilityFunction::of(method).unwrap().real_limit());
    assert!((rk4 - 2.7853).abs() < 1e-4);
    assert!((rk5 - 3.3066).abs() < 1e-3);
    assert_eq!(StabilityFunction::of(Integrator::Rosenbrock), None);
}

#[test]
fn substeps_are_the_least_that_are_stable() {
    let modes = [(-500.0, 0.0), (-20.0, 700.0)].map(|(re, im)| Complex { re, im });
    for method in EXPLICIT {
        let n = StabilityFunction::of(method).unwrap().stable_substeps(&modes, 0.05).unwrap();
        assert!(n > 1);
        for (n, stable) in [(n, true), (n - 1, false)] {
            let h = 0.05 / f64::from(u32::try_from(n).unwrap());
            let done = modes.iter().all(|mode| factor(method, mode.times(h)) <= 1.0 + 1e-6);
            assert_eq!(done, stable, "{method:?} with {n}");
        }
    }
    // A mode that grows may do so.
    let rk4 = StabilityFunction::of(Integrator::Rk4).unwrap();
    let grows = [Complex { re: 5.0, im: 0.0 }];
    assert_eq!(rk4.stable_substeps(&grows, 1.0), Some(1));
    // An oscillation without damping may not: RK4 is stable up to 2.828 on the imaginary axis.
    for (rate, needed) in [(2.82, 1), (2.84, 2), (5.64, 2), (5.68, 3)] {
        let undamped = [rate, -rate].map(|im| Complex { re: 0.0, im });
        assert_eq!(rk4.stable_substeps(&undamped, 1.0), Some(needed), "{rate}");
    }
}

#[test]
fn the_error_of_a_step_of_a_linear_plant_matches_its_polynomial() {
    // x' = -x: a step of 1 leaves 3/8 instead of 1/e; x is equally distributed in [0, 1].
    let plant = plant(&["x"], &["u"], &["-x + 0*u"]);
    let region = Region::new(Dims::new(1, 1), vec![0.0, 0.0], vec![1.0, 1.0]);
    let samples = OneStepSamples::draw(&plant, &region, 1, 2000, 1.0);
    assert_eq!((samples.len(), samples.missing()), (2000, 0));
    let found =
        samples.rms_error(&mut *plant.into_dyn().model(Integrator::Rk4, 1.0, 1).unwrap(), &[1.0]);
    let expected = (0.375 - (-1.0_f64).exp()) / 3.0_f64.sqrt();
    // A mean over 2000 points: 1 % in two standard deviations.
    assert!((found / expected - 1.0).abs() < 0.03, "{found} {expected}");
}

#[test]
fn points_without_a_solution_are_counted() {
    // x' = x^2 from above 1 is gone before 1 s.
    let plant = plant(&["x"], &["u"], &["x^2 + 0*u"]);
    let region = Region::new(Dims::new(1, 1), vec![1.5, 0.0], vec![2.0, 1.0]);
    let samples = OneStepSamples::draw(&plant, &region, 1, 10, 1.0);
    assert!(samples.is_empty() && samples.missing() == 10);
}
