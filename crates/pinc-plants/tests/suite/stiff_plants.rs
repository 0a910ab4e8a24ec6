//! The servo axis, the car and the arm: what physics says of them, and their derivatives.

use pinc_ad::{Dual, central_difference, jacobian};
use pinc_ode::{Dopri5, Plant};
use pinc_plants::{HydraulicServo, SingleTrackCar, TwoLinkArm};
use proptest::prelude::*;

fn rhs(plant: &impl Plant, x: &[f64], u: &[f64]) -> Vec<f64> {
    let mut dx = vec![0.0; x.len()];
    plant.rhs(x, u, &[], &mut dx);
    dx
}

/// Against differences, with every variable and rate in its own unit. Differences are good to about
/// 1e-10 of the largest value, which the units bring near 1.
fn check_derivatives(
    plant: &impl Plant,
    at: &[f64],
    scale: &[f64],
    rate: &[f64],
) -> Result<(), TestCaseError> {
    let n = rate.len();
    let exact = jacobian(|v, dx| plant.rhs(&v[..n], &v[n..], &[], dx), at, n);
    let scaled: Vec<_> = at.iter().zip(scale).map(|(v, s)| v / s).collect();
    for (k, exact) in exact.iter().enumerate() {
        let (i, j) = (k / at.len(), k % at.len());
        let f = |v: &[f64]| {
            let v: Vec<_> = v.iter().zip(scale).map(|(v, s)| v * s).collect();
            rhs(plant, &v[..n], &v[n..])[i] / rate[i]
        };
        let exact = exact * scale[j] / rate[i];
        let difference = central_difference(f, &scaled, j);
        prop_assert!(
            (exact - difference).abs() < 1e-7 * (1.0 + exact.abs()),
            "{i} {j}: {exact} {difference}"
        );
    }
    Ok(())
}

proptest! {
    #[test]
    fn derivatives_of_the_servo(
        x in -0.02..0.02, v in -0.2..0.2, p in -16.0..16.0, s in -0.8..0.8, u in -0.8..0.8,
    ) {
        let scale = [0.02, 0.02, 1.0, 0.01, 0.8];
        check_derivatives(&HydraulicServo::default(), &[x, v, p, s, u], &scale, &[0.2, 8.0, 5e4, 800.0])?;
    }

    #[test]
    fn derivatives_of_the_car(
        vx in 4.0..10.0, vy in -2.5..2.5, r in -1.5..1.5, k in -0.4..0.8, d in -0.5..0.5, m in -500.0..1000.0,
    ) {
        let scale = [1.0, 1.0, 1.0, 0.1, 0.1, 500.0];
        check_derivatives(&SingleTrackCar::default(), &[vx, vy, r, k, d, m], &scale, &[6.0, 17.0, 4.0, 80.0])?;
    }

    #[test]
    fn derivatives_of_the_arm(
        q1 in -2.2..1.2, q2 in -2.0..2.0, w1 in -4.0..4.0, w2 in -5.0..5.0, u1 in -15.0..15.0, u2 in -5.0..5.0,
    ) {
        check_derivatives(&TwoLinkArm::default(), &[q1, q2, w1, w2, u1, u2], &[1.0; 6], &[4.0, 5.0, 200.0, 500.0])?;
    }

    /// The power of the joints is the change of kinetic and potential energy. The energy is
    /// computed from the positions and speeds of the rods' centres, not from the matrices of the
    /// plant.
    #[test]
    fn energy_of_the_arm(
        q1 in -2.2..1.2, q2 in -2.0..2.0, w1 in -4.0..4.0, w2 in -5.0..5.0, u1 in -15.0..15.0, u2 in -5.0..5.0,
    ) {
        let x = [q1, q2, w1, w2];
        let dx = rhs(&TwoLinkArm::default(), &x, &[u1, u2]);
        let along: [Dual<f64>; 4] = std::array::from_fn(|i| Dual { re: x[i], eps: [dx[i]] });
        let change = arm_energy(along).eps[0];
        let power = u1 * w1 + u2 * w2;
        // Roundings of powers up to some thousand W, near stretched or folded arms.
        prop_assert!((change - power).abs() < 1e-9, "{change} {power}");
    }
}

/// Two rods of 1 kg and 0.5 m: m |v|^2 / 2 + (m l^2 / 12) w^2 / 2 + m g h of each.
fn arm_energy([q1, q2, w1, w2]: [Dual<f64>; 4]) -> Dual<f64> {
    use pinc_ad::Scalar;
    let rod = |vx: Dual<f64>, vy: Dual<f64>, w: Dual<f64>, h: Dual<f64>| {
        (vx * vx + vy * vy) / 2.0 + w * w * (0.25 / 24.0) + h * 9.81
    };
    let (q, w) = (q1 + q2, w1 + w2);
    let elbow = (-q1.sin() * w1 * 0.5, q1.cos() * w1 * 0.5, q1.sin() * 0.5);
    let first = rod(elbow.0 * 0.5, elbow.1 * 0.5, w1, elbow.2 * 0.5);
    let vx = elbow.0 - q.sin() * w * 0.25;
    let vy = elbow.1 + q.cos() * w * 0.25;
    first + rod(vx, vy, w, elbow.2 + q.sin() * 0.25)
}

/// Hanging down, the arm is at rest.
#[test]
fn the_arm_hangs_down() {
    let down = -std::f64::consts::FRAC_PI_2;
    for rate in rhs(&TwoLinkArm::default(), &[down, 0.0, 0.0, 0.0], &[0.0, 0.0]) {
        // cos of the rounded -pi/2 is 6e-17, times accelerations of some hundred.
        assert!(rate.abs() < 1e-13, "{rate}");
    }
}

/// A car that goes straight with its wheel rolling feels nothing; on the driven wheel M = R X makes
/// the car accelerate by X / m without the slip's wheel speeding up, R w' = (1 + k) vx'.
#[test]
fn the_car_goes_straight() {
    let car = SingleTrackCar::default();
    for rate in rhs(&car, &[7.0, 0.0, 0.0, 0.0], &[0.0, 0.0]) {
        assert!(rate.abs() < 1e-15, "{rate}");
    }
    // The tyre's force at the slip 0.1 by hand: s^2 = 0.1^2 + 0.01^2, load m g lf / (lf + lr).
    let s = (0.01_f64 + 0.0001).sqrt();
    let force = 0.6 * 1450.0 * 9.81 * 1.1 / 2.7 * (1.6 * (7.0 * s).atan()).sin() * 0.1 / s;
    let dx = rhs(&car, &[7.0, 0.0, 0.0, 0.1], &[0.0, 0.3 * force]);
    let expected = [force / 1450.0, 0.0, 0.0, -1.1 * force / 1450.0 / 7.0];
    for (found, expected) in dx.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-13, "{dx:?}");
    }
}

/// The mirror image of a drive is a drive: left and right exchanged, every lateral quantity changes
/// its sign.
#[test]
fn the_car_is_symmetric() {
    let car = SingleTrackCar::default();
    let one = rhs(&car, &[7.0, 1.2, -0.4, 0.3], &[0.2, 500.0]);
    let other = rhs(&car, &[7.0, -1.2, 0.4, 0.3], &[-0.2, 500.0]);
    for ((a, b), sign) in one.iter().zip(&other).zip([1.0, -1.0, -1.0, 1.0]) {
        assert!((a - sign * b).abs() < 1e-13, "{one:?} {other:?}");
    }
}

/// A tyre pulls most at tan(pi / (2 C)) / B = 0.214, and less beyond.
#[test]
fn the_tyre_has_a_peak() {
    let car = SingleTrackCar::default();
    let pull = |k: f64| rhs(&car, &[7.0, 0.0, 0.0, k], &[0.0, 0.0])[0];
    let best = (1..800).map(|i| f64::from(i) / 1000.0).max_by(|a, b| pull(*a).total_cmp(&pull(*b)));
    let expected = (std::f64::consts::PI / 3.2).tan() / 7.0;
    // A step of the search, and s^2 = k^2 + 0.01^2.
    assert!((best.unwrap_or_default() - expected).abs() < 2e-3, "{best:?} {expected}");
    assert!(pull(0.8) < 0.95 * pull(expected));
}

/// Under a constant command the axis comes to a constant speed. There the force of the oil is the
/// friction, and the flow, by sqrt(ps - p) far from its laminar part, balances the speed and the
/// leak.
#[test]
fn steady_speed_of_the_servo() {
    let mut x = vec![0.0; 4];
    Dopri5::new(HydraulicServo::default(), 1e-10)
        .integrate(&mut x, &[0.2], 2.0)
        .expect("a solution");
    let (v, p) = (x[1], x[2]);
    assert!((x[3] - 0.2).abs() < 1e-9, "{x:?}");
    let friction = 2000.0 * v + 400.0 * (v / 0.02).tanh();
    assert!((1000.0 * p - friction).abs() < 1e-6 * friction, "{x:?}");
    let flow = 0.2 * 3e-4 * (21.0 - p).sqrt();
    // d0^2 / (4 d^2) = 1.5e-4 of the flow, and 1e-6 / (4 s^2) = 6e-6 by the rounded-off spool.
    assert!((flow - 1e-3 * v - 4e-7 * p).abs() < 3e-4 * flow, "{x:?}");
}

/// Rest is rest, and the axis has no direction of its own.
#[test]
fn the_servo_is_symmetric() {
    let servo = HydraulicServo::default();
    let one = rhs(&servo, &[0.01, 0.1, 5.0, 0.3], &[0.5]);
    let other = rhs(&servo, &[-0.01, -0.1, -5.0, -0.3], &[-0.5]);
    for (a, b) in one.iter().zip(&other) {
        assert!((a + b).abs() < 1e-12 * (1.0 + a.abs()), "{one:?} {other:?}");
    }
    for rate in rhs(&servo, &[0.01, 0.0, 0.0, 0.0], &[0.0]) {
        assert!(rate.abs() < 1e-15, "{rate}");
    }
}

/// At a pressure of 5 MPa, from 21 MPa on one side and to none on the other.
#[test]
fn the_closed_valve_leaks_through_a_thousandth_of_its_opening() {
    let orifice = |d: f64| d / (d * d + 0.5 * 0.5).powf(0.25);
    let flow = 0.5 * 3e-4 * 1e-3 * (orifice(21.0 - 5.0) - orifice(21.0 + 5.0));
    let expected = 4.0 * 1400.0 / 6e-5 * (flow - 4e-7 * 5.0);
    let found = rhs(&HydraulicServo::default(), &[0.0, 0.0, 5.0, 0.0], &[0.0])[2];
    assert!((found - expected).abs() < 1e-9 * expected.abs(), "{found} {expected}");
}
