//! The program `pinc` with one more plant: a pendulum with a motor at its pivot.
//!
//! It has all commands of `pinc`, and knows `[plant.own.pendulum]`:
//!
//! ```sh
//! cargo run --release --manifest-path examples/own-plant/Cargo.toml -- run examples/own-plant/pendulum.toml
//! ```

use pinc_ad::Scalar;
use pinc::Plants;
use pinc_ode::{Plant, Variable};
use serde::Deserialize;
use std::process::ExitCode;

/// Gravitational acceleration in m/s^2.
const GRAVITY: f64 = 9.81;

/// A pendulum: a mass on a rod without weight, turned by a torque at the pivot,
///
/// ```text
/// angle' = rate
/// m l^2 rate' = torque - friction rate - m g l sin(angle)
/// ```
///
/// The fields are the keys of `[plant.own.pendulum]`.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Pendulum {
    /// m, in kg.
    mass: f64,
    /// l, in m.
    length: f64,
    /// In N m s.
    friction: f64,
}

impl Plant for Pendulum {
    fn states(&self) -> &[Variable] {
        static STATES: [Variable; 2] =
            [Variable::new("angle", "rad"), Variable::new("rate", "rad/s")];
        &STATES
    }

    fn inputs(&self) -> &[Variable] {
        static INPUTS: [Variable; 1] = [Variable::new("torque", "N m")];
        &INPUTS
    }

    // Written once, for any number: it becomes part of the training kernel, of the Jacobians, of
    // the truth.
    #[inline(always)]
    fn rhs<S: Scalar>(&self, x: &[S], u: &[S], _p: &[S], dx: &mut [S]) {
        let Self { mass: m, length: l, friction } = *self;
        let (angle, rate, torque) = (x[0], x[1], u[0]);
        dx[0] = rate;
        dx[1] = (torque - rate * friction - angle.sin() * (m * GRAVITY * l)) / (m * l * l);
    }
}

fn main() -> ExitCode {
    pinc::program(&Plants::built_in().with::<Pendulum>("pendulum"))
}
