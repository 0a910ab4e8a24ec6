//! The Jacobian of a plant's equation, and several points of it at once.
//!
//! `cargo run -p pinc-ad --example 02_jacobian`
#![expect(clippy::print_stdout, reason = "an example shows what it computes")]

use pinc_ad::{Lanes, Scalar, jacobian};

/// A pendulum with friction, pushed by a torque: v = (angle, rate, torque).
fn pendulum<S: Scalar>(v: &[S], velocity: &mut [S]) {
    velocity[0] = v[1];
    velocity[1] = v[2] - v[0].sin() * 9.81 - v[1] * 0.1;
}

pub(crate) fn main() {
    // Hanging at rest; two rows (velocities) of three columns (angle, rate, torque).
    let hanging = jacobian(pendulum, &[0.0, 0.0, 0.0], 2);
    for row in hanging.chunks(3) {
        println!("{row:8.2?}");
    }
    let expected = [0.0, 1.0, 0.0, -9.81, -0.1, 1.0];
    assert!(hanging.iter().zip(expected).all(|(found, known)| (found - known).abs() < 1e-14));

    // The same equation at four angles side by side, in a form that becomes vector instructions.
    let angles = Lanes([0.0, 0.5, 1.0, 1.5]);
    let still = angles.constant(0.0);
    let mut velocity = [still; 2];
    pendulum(&[angles, still, still], &mut velocity);
    println!("accelerations at {:?}: {:.3?}", angles.0, velocity[1].0);
    for (angle, acceleration) in angles.0.iter().zip(velocity[1].0) {
        assert!((acceleration + 9.81 * angle.sin()).abs() < 1e-12);
    }
}
