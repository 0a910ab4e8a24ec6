//! The Rosenbrock method: order, stability on stiff problems, sensitivities.

use crate::common::{Oscillator, distance, flows, linearize, order, predict};
use pinc_ad::{Scalar, central_difference};
use pinc_ode::{Dopri5, Integrator, Model, Plant, Rk4, Variable};
use pinc_plants::{FourTanks, HydraulicServo, SingleTrackCar};

fn rosenbrock(plant: impl Plant, sample_time_s: f64, substeps: usize) -> Box<dyn Model> {
    pinc_expr::into_dyn(plant).model(Integrator::Rosenbrock, sample_time_s, substeps).unwrap()
}

#[test]
fn order_4_on_a_linear_system() {
    let plant = Oscillator { damping: 0.2 };
    let (x, u, t) = ([1.0, -0.5], 0.7, 3.0);
    let slope = order(|n| rosenbrock(plant.clone(), t, n), &x, &[u], &plant.exact(&x, u, t));
    assert!((slope - 4.0).abs() < 0.15, "{slope}");
}

#[test]
fn order_4_on_the_tanks() {
    for flow in flows("johansson-nonminimum") {
        let plant = FourTanks::johansson_nonminimum();
        let method = |n| rosenbrock(plant, flow.duration_s, n);
        let slope = order(method, &flow.x, &flow.u, &flow.end);
        assert!((slope - 4.0).abs() < 0.15, "{slope}");
    }
}

/// x' = rate (u - x): a mode as fast as one likes.
#[derive(Clone, Debug)]
struct Lag {
    rate: f64,
}

impl Plant for Lag {
    fn states(&self) -> &[Variable] {
        static VARIABLES: [Variable; 1] = [Variable::new("x", "")];
        &VARIABLES
    }
    fn inputs(&self) -> &[Variable] {
        static VARIABLES: [Variable; 1] = [Variable::new("u", "")];
        &VARIABLES
    }
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        dx[0] = (u[0] - x[0]) * self.rate;
    }
}

/// In one step over h the distance to the rest position u is multiplied by R(-h rate): that never
/// grows (A-stability), and goes to 0 as the mode becomes infinitely fast (L-stability), as O(1 /
/// (h rate)). An explicit method blows up there.
#[test]
fn fast_modes_die_out_at_any_step() {
    for power in -2..=12 {
        let rate = 10.0_f64.powi(power);
        let x = predict(&mut *rosenbrock(Lag { rate }, 1.0, 1), &[3.0], &[2.0])[0];
        assert!((x - 2.0).abs() <= 1.0, "rate {rate}: {x}");
        // The constant of the O is a product of the coefficients, some tens.
        assert!((x - 2.0).abs() < 100.0 / rate, "rate {rate}: {x}");
    }
    let explicit = predict(&mut Rk4::new(Lag { rate: 1e3 }, 1.0, 1), &[3.0], &[2.0])[0];
    assert!(explicit.abs() > 1e9, "{explicit}");
}

/// An undamped oscillation is not amplified either: on the imaginary axis |R| <= 1, to rounding.
#[test]
fn oscillations_do_not_grow_at_any_step() {
    for step in [0.1, 0.5, 1.0, 2.0, 5.0, 20.0, 1e3] {
        let mut method = rosenbrock(Oscillator { damping: 0.0 }, step, 1);
        let [x, v] = predict(&mut *method, &[1.0, 0.0], &[0.0])[..] else { panic!("two states") };
        assert!(x.hypot(v) <= 1.0 + 1e-12, "step {step}: {x} {v}");
    }
}

/// Over a mode that is 1e6 times faster than the step, the slow one is still integrated: x' = -1e6
/// (x - y), y' = -y; after the transient x = y / (1 - 1e-6).
#[derive(Clone, Debug)]
struct FastAndSlow;

impl Plant for FastAndSlow {
    fn states(&self) -> &[Variable] {
        static VARIABLES: [Variable; 2] = [Variable::new("x", ""), Variable::new("y", "")];
        &VARIABLES
    }
    fn inputs(&self) -> &[Variable] {
        &[]
    }
    fn rhs<S: Scalar>(&self, x: &[S], _u: &[S], _p: &[S], dx: &mut [S]) {
        dx[0] = (x[0] - x[1]) * -1e6;
        dx[1] = -x[1];
    }
}

#[test]
fn a_slow_mode_beside_a_fast_one() {
    let end = predict(&mut *rosenbrock(FastAndSlow, 1.0, 20), &[5.0, 1.0], &[]);
    let slow = (-1.0_f64).exp();
    // Order 4 with h = 1/20: 20 h^5 of a constant below 1e-2; the fast state follows to 1/(h 1e6).
    assert!((end[1] - slow).abs() < 1e-7, "{end:?}");
    assert!((end[0] - slow).abs() < 1e-4, "{end:?}");
}

/// A single substep on the stiff plants, where the derivatives of J matter: against differences of
/// the method itself, scaled by the units of the variables. Differences are good to about 1e-9 of
/// the scale.
#[test]
fn jacobians_match_the_method() {
    check_jacobians(
        &mut *rosenbrock(HydraulicServo::default(), 0.01, 2),
        &[(vec![0.01, 0.05, 3.0, 0.2], vec![0.4]), (vec![0.0, -0.1, -10.0, -0.5], vec![0.6])],
        &[0.02, 0.2, 16.0, 1.0, 1.0],
    );
    check_jacobians(
        &mut *rosenbrock(SingleTrackCar::default(), 0.05, 2),
        &[
            (vec![7.0, -1.0, 0.7, 0.4], vec![-0.2, 600.0]),
            (vec![5.0, 0.1, 0.1, 0.05], vec![0.1, 50.0]),
        ],
        &[5.0, 1.0, 1.0, 0.5, 0.5, 500.0],
    );
}

fn check_jacobians(method: &mut dyn Model, points: &[(Vec<f64>, Vec<f64>)], scale: &[f64]) {
    for (x, u) in points {
        let (n, m) = (x.len(), u.len());
        let [_, a, b] = linearize(method, x, u);
        let unscaled =
            |v: &[f64]| -> Vec<f64> { v.iter().zip(scale).map(|(v, s)| v * s).collect() };
        let at: Vec<_> = x.iter().chain(u).zip(scale).map(|(v, s)| v / s).collect();
        for i in 0..n {
            for j in 0..n + m {
                let f = |v: &[f64]| {
                    let v = unscaled(v);
                    predict(method, &v[..n], &v[n..])[i] / scale[i]
                };
                let difference = central_difference(f, &at, j);
                let exact = if j < n { a[i * n + j] } else { b[i * m + j - n] };
                let exact = exact * scale[j] / scale[i];
                let tolerance = 1e-7 * (1.0 + exact.abs());
                assert!((exact - difference).abs() < tolerance, "{i} {j}: {exact} {difference}");
            }
        }
    }
}

/// Both methods, with many substeps, and the accurate integrator find the same on the stiff axis.
#[test]
fn agrees_with_the_truth_on_the_servo() {
    let plant = HydraulicServo::default();
    let (x, u) = ([0.01, 0.05, 3.0, 0.2], [0.4]);
    let mut truth = x.to_vec();
    Dopri5::new(plant, 1e-12).integrate(&mut truth, &u, 0.01).expect("it can be integrated");
    let implicit = predict(&mut *rosenbrock(plant, 0.01, 400), &x, &u);
    let explicit = predict(&mut Rk4::new(plant, 0.01, 4000), &x, &u);
    // Of pressures of some MPa, the largest of the states.
    assert!(distance(&implicit, &truth) < 1e-6, "{implicit:?} {truth:?}");
    assert!(distance(&explicit, &truth) < 1e-7, "{explicit:?} {truth:?}");
}
